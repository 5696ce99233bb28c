//! Straight shadows of smooth glass (`--glass-shadows straight`), an approximation: light samples see through bodies of smooth
//! glass as if these did not bend light, attenuated by Fresnel terms, tints and absorption.
//!
//! The paths that find the same light by refraction are left out, so that no light counts twice:
//!
//! - A direction that a vertex samples is *rough* if its density is below [`MIRROR_PDF`]. Light samples in rough directions pass
//!   bodies. BSDF samples in rough directions find the light that lies straight behind bodies, with MIS weights as usual,
//!   besides that they are scattered by the body.
//! - The emission that such a scattered path finds, once it has been refracted, is left out until it has another rough vertex,
//!   and so are light samples in refracted directions. Paths from the camera that are refracted or mirrored only see all light.

use glam::Vec3;
use wide::bytemuck::cast;

use super::back_faces::MIRROR_PDF;
use super::events::{FoundEmission, PathEvents, ScatteredGroup, WaveContext};
use super::path_states::NonFiniteSamples;
use super::queues::{PathRays, SortedHits};
use super::stages::emission;
use super::stages::requests::RequestGroup;
use super::thin_walls::{MAX_WALLS, ThinWalls, is_wall};
use super::transport::Transport;
use super::vertices::Vertices;
use crate::bsdf::Lobe;
use crate::lanes::{F, Rows, grow, load_bits};
use crate::rays::{HitBatch, MISS};

/// Bits of a ray's state: has the path had a rough vertex?
pub const AFTER_ROUGH: u8 = 1;
/// Has it been refracted since?
pub const REFRACTED: u8 = 2;
/// Is this ray's direction rough?
pub const ROUGH: u8 = 4;

/// What eight light samples do at bodies of glass.
#[derive(Debug, Clone, Copy)]
pub struct BodySamples {
    /// Mask: their shadow rays pass bodies.
    pub passes: F,
    /// Mask: they are left out.
    pub excluded: F,
}

/// What light samples of these densities do; those in the mask `beyond` cross the surface. `None` where shadow rays do not pass
/// bodies.
#[inline(always)]
pub fn at(
    transport: &Transport,
    vertices: &Vertices,
    rows: &Rows,
    bsdf: &impl Lobe,
    (bsdf_pdf, beyond): (F, F),
) -> Option<BodySamples> {
    transport.passes_bodies().then(|| {
        let passes = bsdf_pdf.simd_lt(F::splat(MIRROR_PDF));
        let after_rough: F = cast(load_bits(&vertices.after_rough, rows));
        BodySamples { passes, excluded: after_rough & beyond & !passes & smooth(vertices, rows, bsdf) }
    })
}

/// Mask of the vertices on smooth glass.
#[inline(never)]
pub fn smooth(vertices: &Vertices, rows: &Rows, bsdf: &impl Lobe) -> F {
    let straight = bsdf.straight(vertices.ns.load(rows), vertices.wo.load(rows), F::ONE, true);
    straight.weight.max_element().simd_gt(F::ZERO)
}

/// Follows the states of rays, and finds what lies straight behind bodies; one per thread. A client of the wave.
#[derive(Debug, Default)]
pub struct GlassShadows {
    /// By number of a ray; empty where shadow rays do not pass bodies.
    states: Vec<u8>,
    walls: ThinWalls,
    sorted: SortedHits,
    found: Vec<FoundEmission>,
}

impl GlassShadows {
    /// Adds the light straight behind bodies that rays in rough directions hit, and marks the rays whose own light is left out.
    pub fn find<E: PathEvents>(
        &mut self,
        at: &WaveContext,
        rays: &mut PathRays,
        hits: &HitBatch,
        (radiance, non_finite): (&mut [Vec3], &mut NonFiniteSamples),
        events: &mut E,
    ) {
        let transport = at.transport;
        rays.excluded.clear();
        if !transport.passes_bodies() {
            return;
        }
        rays.excluded.resize(rays.len, false);
        if at.depth == 0 {
            return;
        }
        let states = &self.states[rays.first as usize..][..rays.len];
        let is_rough = |row: usize| states[row] & ROUGH != 0;
        let mut hits = hits.clone();
        let beta = rays.beta.clone();
        let medium = transport.materials.absorbs().then(|| &rays.medium[..rays.len]);
        self.walls.begin(transport, rays.len, &hits, &is_rough, medium);
        // Rays have passed the thin walls that they pass.
        self.walls.retain(|row| is_rough(row) && !is_wall(transport, hits.mesh[row]));
        for _ in 0..MAX_WALLS {
            if self.walls.is_empty() {
                break;
            }
            self.walls.step(transport, &rays.rays, &mut rays.beta, &mut hits, &is_rough, |_, _| ());
            self.sorted.clear();
            let before = rays.beta.clone();
            for row in self.walls.passed().map(|row| row as usize) {
                if hits.mesh[row] == MISS {
                    self.sorted.escaped.push(row as u32);
                } else if emits(transport, hits.mesh[row]) {
                    self.walls.absorb(transport, &mut rays.beta, row, hits.t[row]);
                    self.sorted.emissive.push(row as u32);
                }
            }
            emission::add(at, &self.sorted, rays, &hits, &mut self.found, (radiance, non_finite), events);
            rays.beta = before;
        }
        rays.beta = beta;
        rays.excluded.iter_mut().zip(states).for_each(|(excluded, state)| *excluded = state & REFRACTED != 0);
    }

    /// Fills [`Vertices::after_rough`].
    pub fn mark(&self, transport: &Transport, vertices: &mut Vertices) {
        if transport.passes_bodies() {
            let state = |ray: u32| if self.states[ray as usize] & AFTER_ROUGH != 0 { u32::MAX } else { 0 };
            let column: Vec<_> = vertices.ray[..vertices.len()].iter().map(|ray| state(*ray)).collect();
            vertices.after_rough = column;
            let len = vertices.len();
            grow(&mut vertices.after_rough, len);
        }
    }
}

impl PathEvents for GlassShadows {
    fn begin(&mut self, at: &WaveContext) {
        self.states.clear();
        if at.transport.passes_bodies() {
            self.states.resize(at.paths.len(), 0);
        }
    }

    fn scattered(&mut self, at: &WaveContext, vertices: &Vertices, group: &RequestGroup, samples: &ScatteredGroup) {
        if !at.transport.passes_bodies() {
            return;
        }
        let (rows, survivors) = (&group.rows, &samples.survivors);
        let beyond = vertices.ng.load(rows).dot(samples.wi).simd_lt(F::ZERO);
        let refracted = survivors.compress_bits(cast(beyond & smooth(vertices, rows, &vertices.bsdf(rows)))).to_array();
        let pdf = survivors.compress(samples.pdf[0]).to_array();
        let arrived = survivors.compress_bits(load_bits(&vertices.ray, rows)).to_array();
        for lane in 0..survivors.len {
            self.states.push(state_after(self.states[arrived[lane] as usize], pdf[lane], refracted[lane] != 0));
        }
    }
}

/// Does a mesh emit light that light samples may find?
pub fn emits(transport: &Transport, mesh: u32) -> bool {
    let kind = transport.materials.mesh_material(mesh);
    kind.emits && !kind.unlit
}

/// The state of a ray that leaves a vertex in a direction of density `pdf`, after a ray of state `before`.
pub fn state_after(before: u8, pdf: f32, refracted: bool) -> u8 {
    if pdf < MIRROR_PDF {
        return AFTER_ROUGH | ROUGH;
    }
    let bent = refracted && before & AFTER_ROUGH != 0;
    before & (AFTER_ROUGH | REFRACTED) | if bent { REFRACTED } else { 0 }
}
