//! Keeps the history of rays.

use wide::bytemuck::cast;

use crate::integrator::data::context::WaveContext;
use crate::integrator::data::history::{Bounce, MIRROR_PDF, RayHistory, is_tracked};
use crate::integrator::data::queues::PathRays;
use crate::integrator::data::requests::RequestPacket;
use crate::integrator::data::transport::Transport;
use crate::integrator::data::vertices::Vertices;
use crate::integrator::events::{PathEvents, ScatteredPacket};
use crate::lanes::{F, grow, load_bits};

/// The histories of all rays of a wave; one per thread. A client of the wave.
#[derive(Debug, Default)]
pub struct Histories {
    /// By number of a ray; empty where nothing asks ([`is_tracked`]).
    by_ray: Vec<RayHistory>,
}

impl Histories {
    /// Fills [`PathRays::history`].
    pub fn fill(&self, rays: &mut PathRays) {
        rays.history.clear();
        if !self.by_ray.is_empty() {
            rays.history.extend_from_slice(&self.by_ray[rays.first as usize..][..rays.len]);
        }
    }

    /// Fills [`Vertices::after_rough`] and [`Vertices::mirror_image`].
    pub fn mark(&self, transport: &Transport, vertices: &mut Vertices) {
        let len = vertices.len();
        let Vertices { ray, after_rough, mirror_image, .. } = vertices;
        let mark = |column: &mut Vec<u32>, is_read: bool, of: fn(RayHistory) -> bool| {
            column.clear();
            if is_read {
                let mark = |ray: &u32| if of(self.by_ray[*ray as usize]) { u32::MAX } else { 0 };
                column.extend(ray[..len].iter().map(mark));
                grow(column, len);
            }
        };
        mark(after_rough, transport.passes_bodies(), RayHistory::is_after_rough);
        mark(mirror_image, transport.culls(), RayHistory::is_mirror_image);
    }
}

impl PathEvents for Histories {
    fn begin(&mut self, at: &WaveContext) {
        self.by_ray.clear();
        if is_tracked(at.transport) {
            self.by_ray.resize(at.paths.len(), RayHistory::CAMERA);
        }
    }

    fn scattered(&mut self, at: &WaveContext, vertices: &Vertices, packet: &RequestPacket, samples: &ScatteredPacket) {
        if self.by_ray.is_empty() {
            return;
        }
        let (rows, survivors) = (&packet.rows, &samples.survivors);
        let (mut beyond, mut smooth) = (F::ZERO, F::ZERO);
        if at.transport.materials.has_smooth_bodies {
            beyond = vertices.ng.load(rows).dot(samples.wi).simd_lt(F::ZERO);
            if (samples.pdf[0].simd_ge(F::splat(MIRROR_PDF)) | beyond).any() {
                smooth = vertices.is_smooth_glass(rows, &vertices.bsdf(rows));
            }
        }
        let [beyond, smooth] = [beyond, smooth].map(|mask| survivors.compress_bits(cast(mask)).to_array());
        let [pdf, bsdf_pdf] = [0, 1].map(|i| survivors.compress(samples.pdf[i]).to_array());
        let arrived = survivors.compress_bits(load_bits(&vertices.ray, rows)).to_array();
        for lane in 0..survivors.len {
            let (beyond, smooth) = (beyond[lane] != 0, smooth[lane] != 0);
            let bounce = Bounce { pdf: pdf[lane], bsdf_pdf: bsdf_pdf[lane], beyond, smooth };
            self.by_ray.push(self.by_ray[arrived[lane] as usize].after(at.transport, &bounce));
        }
    }
}
