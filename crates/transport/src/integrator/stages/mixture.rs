//! Guiding at eight vertices: the BSDF and the field as one technique.

use wide::bytemuck::cast;

use crate::bsdf::{BsdfSample, Core, Lobe, Parameters};
use crate::guiding::directions::steradians;
use crate::guiding::{Field, NOWHERE};
use crate::integrator::Transport;
use crate::integrator::vertices::Vertices;
use crate::lanes::{F, LANES, Rows, U, V3, load_bits, mask, store, store_bits};
use crate::sampling::warp::ONE_MINUS;

/// Draws from a BSDF, or with the cells' shares from the field.
pub struct Mixture<'a> {
    field: &'a Field,
    cells: [u32; LANES],
    /// Chance of the field.
    share: F,
}

/// A direction drawn from a mixture, or from a BSDF alone.
pub struct Drawn {
    /// Its density is the mixture's.
    pub sample: BsdfSample,
    /// Densities of the BSDF and of the field.
    pub pdfs: [F; 2],
}

impl Drawn {
    /// Where nothing guides.
    #[inline(always)]
    pub fn of_bsdf(sample: BsdfSample) -> Self {
        Self { pdfs: [sample.pdf, F::ZERO], sample }
    }
}

/// Where a BSDF scatters at least as much widely as sharply, as a mask: elsewhere nothing guides.
#[inline(always)]
pub fn is_diffuse(bsdf: &impl Lobe) -> F {
    bsdf.diffuseness().simd_ge(F::ZERO)
}

/// Finds the cells of the vertices and what these know, where there is a field or one is learned.
#[inline(never)]
pub fn find(transport: &Transport, vertices: &mut Vertices) {
    let len = if vertices.guided.is_some() { vertices.len() } else { 0 };
    for at in (0..len).step_by(LANES) {
        let rows = Rows::From(at);
        let broad = match vertices.core() {
            Some(columns) => is_diffuse(&Core::load(columns, &rows)),
            None => is_diffuse(&vertices.bsdf(&rows)),
        };
        let Vertices { origin, ng, beta, guided: Some(guided), .. } = &mut *vertices else { return };
        let broad: U = cast(broad);
        store_bits(&mut guided.broad, at, broad & U::ONE);
        let Some(field) = transport.field else { continue };
        let cells = field.cells_at(origin.load(&rows), ng.load(&rows));
        store_bits(&mut guided.cell, at, broad.select(U::from(field.guiding(cells)), U::splat(NOWHERE)));
        for (column, chance) in
            guided.chances.iter_mut().zip(field.chances(cells, beta.load(&rows).luminance()).into_iter().flatten())
        {
            store(column, at, chance);
        }
    }
    let Some(guided) = &mut vertices.guided else { return };
    guided.cell[if transport.field.is_some() { len } else { 0 }..].fill(NOWHERE);
}

impl<'a> Mixture<'a> {
    /// In these cells; `None` if nothing guides in any.
    #[inline(always)]
    pub fn new(field: &'a Field, cells: [u32; LANES]) -> Option<Self> {
        let share = field.shares(cells);
        share.simd_gt(F::ZERO).any().then_some(Self { field, cells, share })
    }

    /// At some vertices.
    #[inline(always)]
    pub fn at(transport: &Transport<'a>, vertices: &Vertices, rows: &Rows) -> Option<Self> {
        let (field, guided) = transport.field.zip(vertices.guided.as_ref())?;
        Self::new(field, load_bits(&guided.cell, rows).to_array())
    }

    /// The density of directions that the BSDF draws with density `bsdf_pdf`.
    #[inline(always)]
    pub fn pdf(&self, wi: V3, bsdf_pdf: F) -> F {
        self.mix(bsdf_pdf, self.field.density(self.cells, mask(LANES), wi) / steradians(wi))
    }

    #[inline(always)]
    fn mix(&self, bsdf_pdf: F, field_pdf: F) -> F {
        // Without a share exactly the BSDF's.
        self.share.mul_add(field_pdf - bsdf_pdf, bsdf_pdf)
    }

    /// Draws from three numbers in [0, 1).
    #[inline(always)]
    pub fn draw(&self, bsdf: &impl Lobe, n: V3, wo: V3, [lobe, u, v]: [F; 3]) -> Drawn {
        let led = lobe.simd_lt(self.share);
        // What is left of the number chooses among lobes.
        let rest = (lobe - self.share) / (F::ONE - self.share);
        let rest = rest.fast_max(F::ZERO).fast_min(F::splat(ONE_MINUS));
        let (toward, density) = self.field.draw(self.cells, led, u, v);
        let sample = bsdf.sample_or(n, wo, [rest, u, v], (led, toward));
        let density = density + self.field.density(self.cells, !led, sample.wi);
        let pdfs = [sample.pdf, density / steradians(sample.wi)];
        Drawn { sample: BsdfSample { pdf: self.mix(pdfs[0], pdfs[1]), ..sample }, pdfs }
    }
}
