//! Straight passages of single rays through thin walls and bodies of smooth glass.

use bismar::integrator::data::boundaries::Line;
use bismar::integrator::data::dimensions::MAX_WALLS;
use bismar::integrator::data::transport::Transport;
use bismar::integrator::through::back_faces::BackFaces;
use bismar::integrator::through::glass_shadows;
use bismar::integrator::through::thin_walls::{Passages, beyond, is_wall};
use bismar::lanes::LANES;
use bismar::rays::{HitBatch, MISS, RayBatch, RayOrder};
use bismar::scene::Primitive;
use glam::Vec3;

use super::{Ray, Tracer};

/// A ray that goes straight through glass.
struct StraightRay {
    /// What is left of the light.
    left: Vec3,
    /// Medium behind the last surface.
    medium: u32,
    /// Distance of the last surface.
    start: f32,
    last: Option<Primitive>,
}

impl StraightRay {
    /// What the medium leaves up to a distance.
    fn absorbed(&self, transport: &Transport, t: f32) -> Vec3 {
        transport.materials.media.transmittance(self.medium, t - self.start)
    }
}

impl Tracer<'_> {
    /// Light that lies straight behind the body of glass that a ray in a rough direction has hit.
    pub(super) fn straight_behind_bodies(&self, ray: &Ray, depth: u32, hits: &HitBatch) -> Vec3 {
        let (t, mut hits, mut sum) = (self.transport, hits.clone(), Vec3::ZERO);
        if !ray.history.is_rough() || is_wall(t, hits.mesh[0]) {
            return sum;
        }
        let mut rays = RayBatch::default();
        rays.push(ray.origin, ray.direction, 0.0, f32::INFINITY, ray.key);
        rays.time.extend(t.geometry.moves.then_some(ray.time));
        let mut straight = StraightRay { left: ray.beta, medium: ray.medium, start: 0.0, last: None };
        for _ in 0..MAX_WALLS {
            if !self.pass(&mut straight, &mut rays, &mut hits, [true, ray.passes_backs(t)]) {
                break;
            }
            let again = straight.last == Some(hits.primitive(0));
            if !again && (hits.mesh[0] == MISS || glass_shadows::emits(t, hits.mesh[0])) {
                let beta = straight.left * straight.absorbed(t, hits.t[0]);
                sum += self.emission_at(&Ray { beta, ..*ray }, depth, &hits, false);
            }
        }
        sum
    }

    /// Takes a ray through what it has hit, if light passes that straight on.
    fn pass(
        &self,
        straight: &mut StraightRay,
        rays: &mut RayBatch,
        hits: &mut HitBatch,
        [bodies, backs]: [bool; 2],
    ) -> bool {
        let t = self.transport;
        let hit = hits.primitive(0);
        let is_body = |mesh| mesh != MISS && t.materials.mesh_material(mesh).smooth_body;
        if !(is_wall(t, hit.mesh) || (bodies && is_body(hit.mesh))) {
            return false;
        }
        if straight.last != Some(hit) {
            let (direction, time) = (rays.direction(0), rays.time(0));
            let passages = self.passages(hits, direction, time, true);
            straight.left *= passages.weight.lane(0);
            if straight.left.max_element() <= 0.0 {
                return false;
            }
            if t.passes_bodies() {
                straight.left *= straight.absorbed(t, hits.t[0]);
                let back_facing = t.geometry.normal(t.scene, hit, time).dot(direction) > 0.0;
                let start = straight.start;
                let line = || Line {
                    origin: rays.origin(0),
                    direction,
                    interval: [if start > 0.0 { beyond(start) } else { 0.0 }, beyond(hits.t[0])],
                    time,
                };
                let [_, medium] = t.media_at_surface(hit, back_facing, straight.medium, line);
                (straight.medium, straight.start) = (medium, hits.t[0]);
            }
        }
        straight.last = Some(hit);
        rays.tnear[0] = beyond(hits.t[0]);
        self.closest_hit(rays, backs, hits);
        true
    }

    /// The closest hit of a ray, which passes back faces or not.
    pub(super) fn closest_hit(&self, ray: &RayBatch, backs: bool, hits: &mut HitBatch) {
        self.transport.rays.closest_hits(ray, RayOrder::Incoherent, hits);
        BackFaces::default().resolve(self.transport, ray, &|_| backs, hits);
    }

    /// The light that goes straight through the surface that a ray has hit.
    pub(super) fn passages(&self, hits: &HitBatch, direction: Vec3, time: f32, bodies: bool) -> Passages {
        let at = hits.primitive(0);
        let point = self.transport.geometry.point(self.transport.scene, at, (hits.u[0], hits.v[0]), time);
        Passages::at(self.transport, &[point; LANES], &[direction; LANES], bodies)
    }

    /// The fraction of light that arrives along a shadow ray, which passes bodies of glass and back faces or not, and begins in a
    /// medium.
    pub(super) fn unoccluded(&self, mut ray: RayBatch, [bodies, backs]: [bool; 2], medium: u32) -> Vec3 {
        let mut hits = HitBatch::default();
        self.closest_hit(&ray, backs, &mut hits);
        let bodies = bodies && self.transport.passes_bodies();
        let mut straight = StraightRay { left: Vec3::ONE, medium, start: 0.0, last: None };
        for _ in 0..MAX_WALLS {
            if !self.pass(&mut straight, &mut ray, &mut hits, [bodies, backs]) {
                break;
            }
        }
        match hits.mesh[0] {
            MISS if self.transport.passes_bodies() => straight.left * straight.absorbed(self.transport, ray.tfar[0]),
            MISS => straight.left,
            _ => Vec3::ZERO,
        }
    }
}
