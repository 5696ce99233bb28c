//! Back faces of single-sided materials. The glTF specification culls them ("When this value is false, back-face culling is
//! enabled"). Here rays from the camera and their mirror images pass them: camera rays, BSDF samples of a high density whose ray
//! before passes them too, and shadow rays of light samples whose directions have such a density. So both techniques find the
//! same light. For all other rays (diffuse bounces, other shadow rays) surfaces have no sides.
//!
//! A sheet may consist of two single-sided faces back to back in one plane. Which of them a query finds first is chance: where a
//! back and a front are in the same place, rays that pass no backs hit the front.

use crate::integrator::data::queues::ShadowRays;
use crate::integrator::data::transport::Transport;
use crate::rays::{HitBatch, MISS, RayBatch};

/// Finds what rays hit that meet backs; one per thread.
#[derive(Debug, Default)]
pub struct BackFaces {
    /// Rows of the rays that are traced again.
    rows: Vec<u32>,
    rays: RayBatch,
    hits: HitBatch,
}

impl BackFaces {
    /// Replaces the hits of `rays` on backs: those of rays that pass them (`passes`, by row) by the closest hits on what is no
    /// back, those of others by the front in the same place, if there is one.
    #[inline(never)]
    pub fn resolve(
        &mut self,
        transport: &Transport,
        rays: &RayBatch,
        passes: &dyn Fn(usize) -> bool,
        hits: &mut HitBatch,
    ) {
        if !transport.materials.has_single_sided {
            return;
        }
        self.clear();
        for row in 0..rays.len() {
            let mesh = hits.mesh[row];
            if hits.back[row] && mesh != MISS && transport.materials.mesh_material(mesh).single_sided {
                let [near, far] = [rays.tnear[row], rays.tfar[row]];
                // One that passes begins anew: by rounding, a front in the same place may lie before the back.
                let interval = match passes(row) {
                    true => [near, far],
                    false => same_place(transport, rays, hits, row, [near, far]),
                };
                self.push(rays, row, interval);
            }
        }
        self.trace(transport);
        for (from, row) in self.rows.iter().map(|&row| row as usize).enumerate() {
            if passes(row) || self.hits.mesh[from] != MISS {
                hits.replace(row, &self.hits, from);
            }
        }
    }

    /// Tests again the occluded shadow rays that pass backs.
    #[inline(never)]
    pub(crate) fn reveal(&mut self, transport: &Transport, shadows: &mut ShadowRays) {
        if shadows.backs.is_empty() {
            return;
        }
        self.clear();
        for row in (0..shadows.len).filter(|&row| shadows.occluded[row] && shadows.backs[row] != 0) {
            self.push(&shadows.rays, row, [shadows.rays.tnear[row], shadows.rays.tfar[row]]);
        }
        self.trace(transport);
        for (from, row) in self.rows.iter().enumerate() {
            shadows.occluded[*row as usize] = self.hits.mesh[from] != MISS;
        }
    }

    fn clear(&mut self) {
        self.rows.clear();
        self.rays.clear();
    }

    fn push(&mut self, rays: &RayBatch, row: usize, [near, far]: [f32; 2]) {
        self.rows.push(row as u32);
        self.rays.push(rays.origin(row), rays.direction(row), near, far, rays.key[row]);
        self.rays.time.extend(rays.time.get(row));
    }

    fn trace(&mut self, transport: &Transport) {
        if !self.rows.is_empty() {
            transport.rays.closest_front_hits(&self.rays, &mut self.hits);
        }
    }
}

/// The part of a ray's interval in which surfaces are in the same place as its hit: nearer to its plane than the origins of rays
/// that leave it.
fn same_place(transport: &Transport, rays: &RayBatch, hits: &HitBatch, row: usize, [near, far]: [f32; 2]) -> [f32; 2] {
    let point = transport.point(rays, hits, row);
    let width = point.origin_offset / point.ng.normalize_or_zero().dot(rays.direction(row)).abs();
    [(hits.t[row] - width).max(near), (hits.t[row] + width).min(far)]
}
