//! Back faces of single-sided materials. The glTF specification culls them ("When this value is false, back-face culling is
//! enabled"). Here rays from the camera and their mirror images pass them: camera rays, and BSDF samples of a high density
//! whose ray before passes them too. For all other rays (shadow rays, diffuse bounces) surfaces have no sides.

use glam::Vec3;

use crate::integrator::data::queues::PathRays;
use crate::integrator::data::transport::Transport;
use crate::rays::{HitBatch, MISS, RayBatch, RayOrder};
use crate::scene::Primitive;

/// Start of the rest of a ray that has passed a face at `t`, relative to it: a few times the rounding error of `t`.
const BEYOND: f32 = 1.0 + 1e-6;

/// Faces that a ray passes at most. It ends only rays that find the same faces again and again by rounding.
const MAX_FACES: usize = 1 << 14;

/// Follows camera rays and their mirror images through back faces; one per thread.
#[derive(Debug, Default)]
pub struct BackFaces {
    /// Rows of the rays that hit a culled face.
    culled: Vec<u32>,
    rays: RayBatch,
    hits: HitBatch,
}

/// Does a hit of a ray at a face of mesh `mesh` with `direction` count as no hit?
#[inline]
pub fn is_culled(transport: &Transport, hit: Primitive, direction: impl Fn() -> Vec3, time: impl Fn() -> f32) -> bool {
    hit.mesh != MISS
        && transport.materials.mesh_material(hit.mesh).single_sided
        && transport.geometry.normal(transport.scene, hit, time()).dot(direction()) > 0.0
}

/// Start of the rest of a ray that passes a face at `t`.
#[inline]
pub fn beyond(t: f32) -> f32 {
    (t * BEYOND).max(f32::MIN_POSITIVE)
}

impl BackFaces {
    /// Replaces the hits of some rows of `rays` on culled faces by those behind them. A ray that has passed a face has a `tnear`
    /// above zero.
    #[inline(never)]
    pub fn pass(
        &mut self,
        transport: &Transport,
        rows: impl Iterator<Item = u32>,
        rays: &mut PathRays,
        hits: &mut HitBatch,
    ) {
        if !transport.culls() {
            return;
        }
        self.culled.clear();
        for row in rows.map(|row| row as usize) {
            let culled = rays.history(row).is_mirror_image()
                && is_culled(transport, hits.primitive(row), || rays.rays.direction(row), || rays.rays.time(row));
            if culled {
                self.culled.push(row as u32);
            }
        }
        for _ in 0..MAX_FACES {
            if self.culled.is_empty() {
                return;
            }
            self.trace_again(transport, rays, hits);
        }
    }

    /// Traces the rays in `culled` from behind what they hit; those that hit another culled face remain there.
    fn trace_again(&mut self, transport: &Transport, rays: &mut PathRays, hits: &mut HitBatch) {
        self.rays.clear();
        for row in self.culled.iter().map(|&row| row as usize) {
            let tnear = beyond(hits.t[row]);
            rays.rays.tnear[row] = tnear;
            let (origin, direction) = (rays.rays.origin(row), rays.rays.direction(row));
            self.rays.push(origin, direction, tnear, rays.rays.tfar[row], rays.rays.key[row]);
            self.rays.time.extend(rays.rays.time.get(row));
        }
        transport.rays.closest_hits(&self.rays, RayOrder::Incoherent, &mut self.hits);
        let (mut again, more) = (0, &self.hits);
        self.culled.retain(|&row| {
            let (from, to) = (again, row as usize);
            again += 1;
            hits.replace(to, more, from);
            is_culled(transport, hits.primitive(to), || rays.rays.direction(to), || rays.rays.time(to))
        });
    }
}
