//! Path guiding at eight vertices: one-sample mixture of the BSDF and the guiding field.

use wide::bytemuck::cast;

use crate::bsdf::{BsdfSample, Core, Lobe, Parameters};
use crate::guiding::directions::steradians;
use crate::guiding::{Field, NO_CELL};
use crate::integrator::data::transport::Transport;
use crate::integrator::data::vertices::Vertices;
use crate::lanes::{F, LANES, Rows, U, V3, load_bits, mask, store, store_bits};
use crate::sampling::warp::ONE_MINUS_EPSILON;

/// Samples the BSDF or, with a probability by cell, the guiding field.
pub struct Mixture<'a> {
    field: &'a Field,
    cells: [u32; LANES],
    /// Probability of sampling the field.
    field_fraction: F,
}

/// Eight directions sampled from a mixture, or from the BSDF alone.
pub struct MixtureSample {
    /// The directions; `pdf` is the density of the mixture.
    pub sample: BsdfSample,
    /// Densities per solid angle of the BSDF and of the field.
    pub pdfs: [F; 2],
}

/// Samples directions from three uniform numbers in [0, 1): from the mixture, or from the BSDF alone.
#[inline(always)]
pub fn sample(mixture: Option<&Mixture>, bsdf: &impl Lobe, n: V3, wo: V3, [lobe, u, v]: [F; 3]) -> MixtureSample {
    let drawn = mixture.map(|mixture| (mixture, mixture.draw([lobe, u, v])));
    let (lobe, given) = drawn.map_or((lobe, (F::ZERO, V3::ZERO)), |(_, drawn)| (drawn.rest, drawn.given));
    // One call of the BSDF, whose code is large.
    let sample = bsdf.sample_or(n, wo, [lobe, u, v], given);
    let Some((mixture, drawn)) = drawn else { return MixtureSample { pdfs: [sample.pdf, F::ZERO], sample } };
    let density = drawn.density + mixture.field.density(mixture.cells, !drawn.given.0, sample.wi);
    let pdfs = [sample.pdf, density / steradians(sample.wi)];
    MixtureSample { sample: BsdfSample { pdf: mixture.mix(pdfs[0], pdfs[1]), ..sample }, pdfs }
}

/// Eight directions drawn from a field.
#[derive(Clone, Copy)]
struct Drawn {
    /// The number that chooses among lobes, where the BSDF is sampled.
    rest: F,
    /// Mask of the lanes that sample the field, and their directions.
    given: (F, V3),
    /// Density of the field there, in the unit of [`Field::draw`].
    density: F,
}

/// Mask of the lanes whose BSDF is diffuse enough to be guided.
#[inline(always)]
pub fn is_diffuse(bsdf: &impl Lobe) -> F {
    let [rough, sharp] = bsdf.albedos();
    rough.simd_ge(sharp)
}

/// [`is_diffuse`] of eight vertices.
#[inline(always)]
pub(crate) fn are_diffuse(vertices: &Vertices, rows: &Rows) -> F {
    match vertices.core() {
        Some(columns) => is_diffuse(&Core::load(columns, rows)),
        None => is_diffuse(&vertices.bsdf(rows)),
    }
}

/// Fills the guiding columns of the vertices, if there is a field: cells and roulette probabilities.
#[inline(never)]
pub(crate) fn find_cells(transport: &Transport, vertices: &mut Vertices) {
    let Some(field) = transport.proposal.field else { return };
    for at in (0..vertices.len()).step_by(LANES) {
        let rows = Rows::From(at);
        let diffuse: U = cast(are_diffuse(vertices, &rows));
        let Vertices { origin, ng, beta, guiding: Some(guiding), .. } = &mut *vertices else { return };
        let cells = field.cells_at(origin.load(&rows), ng.load(&rows));
        store_bits(&mut guiding.cell, at, diffuse.select(U::from(field.guiding_cells(cells)), U::splat(NO_CELL)));
        if let Some([light, on]) = field.roulette_probabilities(cells, beta.load(&rows).luminance()) {
            store(&mut guiding.roulette[0], at, light);
            store(&mut guiding.roulette[1], at, on);
        }
    }
    let len = vertices.len();
    // Beyond the last vertex, columns hold cells of earlier waves.
    vertices.guiding.iter_mut().for_each(|guiding| guiding.cell[len..].fill(NO_CELL));
}

impl<'a> Mixture<'a> {
    /// The mixture in these cells; `None` if the field is sampled in none of them.
    #[inline(always)]
    pub fn new(field: &'a Field, cells: [u32; LANES]) -> Option<Self> {
        let field_fraction = field.guiding_probabilities(cells);
        field_fraction.simd_gt(F::ZERO).any().then_some(Self { field, cells, field_fraction })
    }

    /// The mixture at eight vertices; `None` if the field is sampled at none of them.
    #[inline(always)]
    pub fn at(transport: &Transport<'a>, vertices: &Vertices, rows: &Rows) -> Option<Self> {
        let (field, guiding) = transport.proposal.field.zip(vertices.guiding.as_ref())?;
        Self::new(field, load_bits(&guiding.cell, rows).to_array())
    }

    /// Density per solid angle of directions whose BSDF density is `bsdf_pdf`.
    #[inline(always)]
    pub fn pdf(&self, wi: V3, bsdf_pdf: F) -> F {
        self.mix(bsdf_pdf, self.field.density(self.cells, mask(LANES), wi) / steradians(wi))
    }

    /// The same for BSDF densities that are not known yet: a factor of theirs, and a summand.
    #[inline(always)]
    pub fn parts(&self, wi: V3) -> [F; 2] {
        let field_pdf = self.field.density(self.cells, mask(LANES), wi) / steradians(wi);
        [F::ONE - self.field_fraction, self.field_fraction * field_pdf]
    }

    #[inline(always)]
    fn mix(&self, bsdf_pdf: F, field_pdf: F) -> F {
        // Exactly `bsdf_pdf` where the probability of the field is zero.
        self.field_fraction.mul_add(field_pdf - bsdf_pdf, bsdf_pdf)
    }

    /// Chooses between field and BSDF, and draws from the field.
    #[inline(always)]
    fn draw(&self, [lobe, u, v]: [F; 3]) -> Drawn {
        let from_field = lobe.simd_lt(self.field_fraction);
        // Reuse the number: rescaled to [0, 1), it chooses among lobes.
        let rest = (lobe - self.field_fraction) / (F::ONE - self.field_fraction);
        let rest = rest.fast_max(F::ZERO).fast_min(F::splat(ONE_MINUS_EPSILON));
        let (direction, density) = self.field.draw(self.cells, from_field, u, v);
        Drawn { rest, given: (from_field, direction), density }
    }
}
