//! Back faces of single-sided materials. The glTF specification culls them ("When this value is false, back-face culling is
//! enabled"). Here rays from the camera and their mirror images pass them: camera rays, and BSDF samples of a high density
//! whose ray before passes them too. For all other rays (shadow rays, diffuse bounces) surfaces have no sides.

use glam::Vec3;

use super::events::{PathEvents, ScatteredGroup, WaveContext};
use super::queues::PathRays;
use super::stages::requests::RequestGroup;
use super::transport::Transport;
use super::vertices::Vertices;
use crate::lanes::load_bits;
use crate::rays::{HitBatch, MISS, RayBatch, RayOrder};

/// Density per steradian, of a sample of the BSDF (whatever guides it), from which a ray counts as the mirror image of the ray before. It is that of
/// a lobe that covers about 0.1 sr: roughness below about 0.3. Of the reflections of a perfect mirror (α 0.001), 1 % have a
/// lower density; of a diffuse surface, none has a higher one.
pub const MIRROR_PDF: f32 = 10.0;

/// Start of the rest of a ray that has passed a face at `t`, relative to it: a few times the rounding error of `t`.
const BEYOND: f32 = 1.0 + 1e-6;

/// Faces that a ray passes at most. It ends only rays that find the same faces again and again by rounding.
const MAX_FACES: usize = 1 << 14;

/// Follows camera rays and their mirror images through back faces; one per thread. A client of the wave.
#[derive(Debug, Default)]
pub struct BackFaces {
    /// By number of a ray: is it a mirror image of the camera's ray? Empty where nothing asks ([`tracks`]).
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
    /// Replaces the hits of `rays` on culled faces by those behind them. A ray that has passed a face has a `tnear` above zero.
    #[inline(never)]
    pub fn pass(&mut self, at: &WaveContext, rays: &mut PathRays, hits: &mut HitBatch) {
        rays.mirror_image.clear();
        if at.depth > 0 && at.transport.materials.has_unlit {
            rays.mirror_image.extend_from_slice(&self.mirror_images[rays.first as usize..][..rays.len]);
        }
        self.pass_rows(at, 0..rays.len as u32, rays, hits);
    }

    /// [`pass`](Self::pass) of some rows, again.
    pub fn pass_rows(
        &mut self,
        at: &WaveContext,
        rows: impl Iterator<Item = u32>,
        rays: &mut PathRays,
        hits: &mut HitBatch,
    ) {
        if !culls(at.transport) {
            return;
        }
        self.culled.clear();
        for row in rows.map(|row| row as usize) {
            let number = rays.first as usize + row;
            let hit = (hits.instance[row], hits.mesh[row], hits.prim[row]);
            let culled = self.mirror_images[number]
                && is_culled(at.transport, hit, || rays.rays.direction(row), || rays.rays.time(row));
            if culled {
                self.culled.push(row as u32);
            }
        }
        for _ in 0..MAX_FACES {
            if self.culled.is_empty() {
                return;
            }
            self.trace_again(at.transport, rays, hits);
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
            (hits.t[to], hits.u[to], hits.v[to]) = (more.t[from], more.u[from], more.v[from]);
            let hit = (more.instance[from], more.mesh[from], more.prim[from]);
            (hits.instance[to], hits.mesh[to], hits.prim[to]) = hit;
            is_culled(transport, hit, || rays.rays.direction(to), || rays.rays.time(to))
        });
    }
}

/// Does the wave cull anything?
fn culls(transport: &Transport) -> bool {
    transport.culls_back_faces && transport.materials.has_single_sided
}

/// Does anything depend on what is a mirror image of camera rays: back faces, or unlit surfaces, which give no light?
fn tracks(transport: &Transport) -> bool {
    culls(transport) || transport.materials.has_unlit
}

impl PathEvents for BackFaces {
    fn begin(&mut self, at: &WaveContext) {
        self.mirror_images.clear();
        if tracks(at.transport) {
            self.mirror_images.resize(at.paths.len(), true);
        }
    }

    fn scattered(&mut self, at: &WaveContext, vertices: &Vertices, group: &RequestGroup, samples: &ScatteredGroup) {
        if tracks(at.transport) {
            let arrived = samples.survivors.compress_bits(load_bits(&vertices.ray, &group.rows)).to_array();
            let pdf = samples.survivors.compress(samples.pdf[1]).to_array();
            for lane in 0..samples.survivors.len {
                self.mirror_images.push(self.mirror_images[arrived[lane] as usize] && pdf[lane] >= MIRROR_PDF);
            }
        }
    }
}
