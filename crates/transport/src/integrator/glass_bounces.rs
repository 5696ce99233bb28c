//! Bounces that `--max-depth` does not count: light that crosses smooth glass or is mirrored by it, in scenes with bodies of it
//! ([`Materials::has_smooth_bodies`](super::Materials)). Light needs two of them to pass a pane and four to pass a bottle.

use wide::bytemuck::cast;

use super::back_faces::MIRROR_PDF;
use super::events::{PathEvents, ScatteredGroup, WaveContext};
use super::glass_shadows::smooth;
use super::stages::requests::RequestGroup;
use super::transport::{MAX_GLASS_BOUNCES, Transport};
use super::vertices::Vertices;
use crate::lanes::{F, load_bits};

/// Counts the bounces of paths at glass; one per thread. A client of the wave.
#[derive(Debug, Default)]
pub struct GlassBounces {
    /// By number of a ray; empty in scenes without bodies of smooth glass.
    by_ray: Vec<u8>,
}

impl GlassBounces {
    /// Does a ray that arrives at `depth` scatter? `None` where that depends on the depth alone.
    pub fn scatters(&self, transport: &Transport, depth: u32) -> Option<impl Fn(u32) -> bool> {
        let counts = !self.by_ray.is_empty();
        counts.then_some(move |ray| scatters(transport, depth, self.by_ray[ray as usize]))
    }
}

/// Does a path scatter at `depth`, after so many bounces that do not count?
pub fn scatters(transport: &Transport, depth: u32, glass_bounces: u8) -> bool {
    depth + 1 - u32::from(glass_bounces) < transport.max_depth
}

/// The number after a bounce of density `pdf`, at smooth glass or not, that crosses the surface or not.
pub fn after(before: u8, pdf: f32, smooth: bool, beyond: bool) -> u8 {
    before + u8::from(smooth && (beyond || pdf >= MIRROR_PDF) && u32::from(before) < MAX_GLASS_BOUNCES)
}

impl PathEvents for GlassBounces {
    fn begin(&mut self, at: &WaveContext) {
        self.by_ray.clear();
        if at.transport.materials.has_smooth_bodies {
            self.by_ray.resize(at.paths.len(), 0);
        }
    }

    fn scattered(&mut self, at: &WaveContext, vertices: &Vertices, group: &RequestGroup, samples: &ScatteredGroup) {
        if !at.transport.materials.has_smooth_bodies {
            return;
        }
        let survivors = &samples.survivors;
        let beyond = vertices.ng.load(&group.rows).dot(samples.wi).simd_lt(F::ZERO);
        let smooth = match (samples.pdf[0].simd_ge(F::splat(MIRROR_PDF)) | beyond).any() {
            true => smooth(vertices, &group.rows, &vertices.bsdf(&group.rows)),
            false => F::ZERO,
        };
        let smooth = survivors.compress_bits(cast(smooth)).to_array();
        let beyond = survivors.compress_bits(cast(beyond)).to_array();
        let pdf = survivors.compress(samples.pdf[0]).to_array();
        let arrived = survivors.compress_bits(load_bits(&vertices.ray, &group.rows)).to_array();
        for lane in 0..survivors.len {
            let before = self.by_ray[arrived[lane] as usize];
            self.by_ray.push(after(before, pdf[lane], smooth[lane] != 0, beyond[lane] != 0));
        }
    }
}
