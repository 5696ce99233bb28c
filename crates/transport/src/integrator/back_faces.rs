//! Back faces of single-sided materials. The glTF specification culls them ("When this value is false, back-face culling is
//! enabled"). Here rays from the camera and their mirror images pass them: camera rays, and BSDF samples of a high density
//! whose ray before passes them too. For all other rays (shadow rays, diffuse bounces) surfaces have no sides.

use glam::Vec3;

use super::path_states::PathStates;
use super::queues::PathRays;
use super::transport::Transport;
use crate::rays::{HitBatch, MISS, RayBatch, RayOrder};

/// Density per steradian, of one BSDF sample, from which a ray counts as the mirror image of the ray before. It is that of
/// a lobe that covers about 0.1 sr: roughness below about 0.3. Of the reflections of a perfect mirror (α 0.001), 1 % have a
/// lower density; of a diffuse surface, none has a higher one.
pub const MIRROR_PDF: f32 = 10.0;

/// Start of the rest of a ray that has passed a face at `t`, relative to it: a few times the rounding error of `t`.
const BEYOND: f32 = 1.0 + 1e-6;

/// Faces that a ray passes at most. It ends only rays that find the same faces again and again by rounding.
const MAX_FACES: usize = 1 << 14;

/// Follows camera rays and their mirror images through back faces; one per thread.
#[derive(Debug, Default)]
pub struct BackFaces {
    /// Is the ray that began the sub-path, or its last, a mirror image of the camera's? By sub-path.
    mirror_images: Vec<bool>,
    /// Rows of the rays that hit a culled face.
    culled: Vec<u32>,
    rays: RayBatch,
    hits: HitBatch,
}

/// Does a hit of a ray at a face of mesh `mesh` with `direction` count as no hit?
#[inline]
pub fn is_culled(
    transport: &Transport,
    (instance, mesh, prim): (u32, u32, u32),
    direction: impl Fn() -> Vec3,
    time: impl Fn() -> f32,
) -> bool {
    mesh != MISS
        && transport.materials.mesh_material(mesh).single_sided
        && transport.geometry.normal(transport.scene, (instance, mesh, prim), time()).dot(direction()) > 0.0
}

/// Start of the rest of a ray that passes a face at `t`.
#[inline]
pub fn beyond(t: f32) -> f32 {
    (t * BEYOND).max(f32::MIN_POSITIVE)
}

impl BackFaces {
    /// Replaces the hits of `rays` at `depth` on culled faces by those behind them. A ray that has passed a face has a `tnear`
    /// above zero.
    #[inline(never)]
    pub fn pass(
        &mut self,
        transport: &Transport,
        depth: u32,
        path_states: &PathStates,
        rays: &mut PathRays,
        hits: &mut HitBatch,
    ) {
        if !transport.culls_back_faces || !transport.materials.has_single_sided {
            return;
        }
        self.culled.clear();
        if depth == 0 {
            self.mirror_images.clear();
        }
        self.mirror_images.resize(path_states.sub_paths.len(), false);
        for row in 0..rays.len {
            if depth > 0 && !self.is_mirror_image(transport, depth, path_states, rays, row) {
                continue;
            }
            let hit = (hits.instance[row], hits.mesh[row], hits.prim[row]);
            if is_culled(transport, hit, || rays.rays.direction(row), || rays.rays.time(row)) {
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

    /// Is the ray in this row a mirror image of the camera's ray? Remembers it for the rays that follow.
    #[inline]
    fn is_mirror_image(
        &mut self,
        transport: &Transport,
        depth: u32,
        path_states: &PathStates,
        rays: &PathRays,
        row: usize,
    ) -> bool {
        let sub_path = rays.sub_path[row] as usize;
        let (before, [.., samples]) = match &path_states.scatter_records {
            _ if depth == 1 => (true, path_states.paths[rays.path[row] as usize].samples_per_path),
            // Each ray of a wave that learns has a sub-path of its own.
            Some(records) => {
                (self.mirror_images[records[sub_path].parent as usize], transport.deeper_samples_per_path())
            }
            None => (self.mirror_images[sub_path], transport.deeper_samples_per_path()),
        };
        self.mirror_images[sub_path] = before && rays.weighted_pdf[row] >= MIRROR_PDF * samples;
        self.mirror_images[sub_path]
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
            (hits.t[to], hits.u[to], hits.v[to]) = (more.t[from], more.u[from], more.v[from]);
            let hit = (more.instance[from], more.mesh[from], more.prim[from]);
            (hits.instance[to], hits.mesh[to], hits.prim[to]) = hit;
            is_culled(transport, hit, || rays.rays.direction(to), || rays.rays.time(to))
        });
    }
}
