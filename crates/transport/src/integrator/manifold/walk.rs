//! The walk to a light: Newton's method for the direction in which a point sees it through bodies of smooth glass.
//!
//! Manifold next-event estimation (Hanika et al. 2015, *Manifold Next Event Estimation*; Zeltner et al. 2020, *Specular
//! Manifold Sampling*) moves all vertices of a chain until their half vectors agree with the normals. Here the direction at the
//! point is the only unknown: a chain is traced by Snell's law, and misses the light by what the next direction shall correct.
//! Ray differentials (Igehy 1999, *Tracing Ray Differentials*) are the derivatives, and the solution's give the geometric term:
//! the solid angle at the point per area (or, of directional lights, solid angle) at the light. Each chain consists of rays that
//! were traced, hence of visible segments.

use glam::{Vec2, Vec3};

use super::super::back_faces::beyond;
use super::super::shading_normal;
use super::super::stages::lights::SHADOW_END;
use super::super::stages::media::transmittance;
use super::super::thin_walls::{MAX_WALLS, Passages, is_wall};
use super::super::transport::Transport;
use crate::bsdf::refraction_index;
use crate::lanes::{LANES, V3};
use crate::rays::{HitBatch, MISS, RayBatch, RayOrder};
use crate::sampling::warp;
use crate::scene::TextureSlot;

/// Refractions of a chain, at most.
pub const MAX_REFRACTIONS: usize = 4;
/// Chains that a walk traces, at most.
const MAX_CHAINS: usize = 24;
/// The distance by which a solution misses the light, over the length of the chain, at most.
const TOLERANCE: f32 = 1e-5;
/// The same where rounding lets a walk go no further.
const COARSE_TOLERANCE: f32 = 1e-3;
/// Radians by which a solution's direction is off, at most: a walk that is stuck at a fold, where the miss hardly depends on the
/// direction, has found no solution.
const DIRECTION_TOLERANCE: f32 = 1e-3;
/// Radians of a step, at most.
const MAX_STEP: f32 = 0.3;
/// Shortest step relative to Newton's.
const MIN_STEP: f32 = 1.0 / 64.0;

/// Where a chain begins.
#[derive(Debug, Clone, Copy, Default)]
pub struct Start {
    /// Ray origin, world space.
    pub origin: Vec3,
    /// Medium at the origin, an index into [`Materials::media`](super::super::Materials::media).
    pub medium: u32,
    /// Random number for surfaces with alpha blending, as in [`RayBatch`].
    pub key: u32,
    /// Time in [0, 1] of the shutter interval.
    pub time: f32,
}

/// Where a chain ends.
#[derive(Debug, Clone, Copy)]
pub enum End {
    /// At a point.
    Point(Vec3),
    /// At infinity, in this unit direction.
    Direction(Vec3),
}

/// A chain of refractions from a point to a light.
#[derive(Debug, Clone, Copy)]
pub struct Connection {
    /// Unit direction at the start.
    pub direction: Vec3,
    /// Unit direction of the last segment, toward the light.
    pub arrival: Vec3,
    /// What boundaries, walls and media leave of the light, linear RGB.
    pub left: Vec3,
    /// Solid angle at the start per area perpendicular to `arrival` at a point, per solid angle for a direction.
    pub density: f32,
}

/// Walks chains, one at a time, with its buffers.
#[derive(Debug, Default)]
pub struct Walker {
    rays: RayBatch,
    hits: HitBatch,
}

/// A traced chain.
struct Chain {
    arrival: Vec3,
    /// By what it misses the end: a vector across `arrival` in metres; of directions in radians.
    miss: Vec3,
    /// Its derivatives by the two angles of the direction at the start.
    d_miss: [Vec3; 2],
    /// What is a small miss: the chain's length, or 1.
    scale: f32,
    /// Does something opaque hide the end?
    hidden: bool,
    /// What is left of the light, if asked for.
    left: Vec3,
}

impl Chain {
    fn relative_miss(&self) -> f32 {
        self.miss.length() / self.scale
    }

    /// Two axes across `arrival`, and the derivatives along them.
    fn jacobian(&self) -> ([Vec3; 2], [Vec2; 2]) {
        let (a, b) = warp::frame(self.arrival);
        ([a, b], self.d_miss.map(|d| Vec2::new(d.dot(a), d.dot(b))))
    }

    /// Newton's step in the two angles; `None` if the miss does not depend on them.
    fn step(&self) -> Option<Vec2> {
        let ([a, b], [du, dv]) = self.jacobian();
        let (miss, det) = (Vec2::new(self.miss.dot(a), self.miss.dot(b)), du.perp_dot(dv));
        let step = -Vec2::new(miss.perp_dot(dv), du.perp_dot(miss)) / det;
        (det != 0.0 && step.is_finite()).then_some(step)
    }

    fn density(&self) -> f32 {
        let (_, [du, dv]) = self.jacobian();
        1.0 / du.perp_dot(dv).abs()
    }
}

/// A ray of a chain, with its derivatives by the two angles of the direction at the start.
struct Beam {
    position: Vec3,
    direction: Vec3,
    d_position: [Vec3; 2],
    d_direction: [Vec3; 2],
    medium: u32,
}

/// What a ray has hit, behind thin walls.
struct Hit {
    at: (u32, u32, u32),
    barycentric: (f32, f32),
    t: f32,
}

impl Walker {
    /// The chain of 1 to [`MAX_REFRACTIONS`] refractions that a walk from the straight direction finds. `None` if it finds none,
    /// and where the light is not behind glass: a function of the arguments alone.
    pub fn connect(&mut self, transport: &Transport, start: &Start, end: End) -> Option<Connection> {
        let mut direction = match end {
            End::Point(point) => (point - start.origin).try_normalize()?,
            End::Direction(direction) => direction,
        };
        let mut chain = self.trace(transport, start, direction, end, false)?;
        let mut scale = 1.0f32;
        for _ in 0..MAX_CHAINS {
            if chain.relative_miss() <= TOLERANCE || scale < MIN_STEP {
                break;
            }
            let step = chain.step()?;
            let step = step * (scale * (MAX_STEP / step.length()).min(1.0));
            let (u, v) = warp::frame(direction);
            let tried = (direction + u * step.x + v * step.y).normalize();
            let better = |next: &Chain| next.relative_miss() < chain.relative_miss();
            match self.trace(transport, start, tried, end, false).filter(better) {
                Some(next) => (chain, direction, scale) = (next, tried, (2.0 * scale).min(1.0)),
                None => scale *= 0.5,
            }
        }
        let is_off = chain.step()?.length() > DIRECTION_TOLERANCE;
        if chain.relative_miss() > COARSE_TOLERANCE || is_off || chain.hidden {
            return None;
        }
        let Chain { arrival, left, .. } = self.trace(transport, start, direction, end, true)?;
        let density = chain.density();
        let found = left.max_element() > 0.0 && left.is_finite() && density.is_finite();
        found.then_some(Connection { direction, arrival, left, density })
    }

    /// Traces a chain; with `weigh` also what is left of the light. `None` if it has no refraction, more than
    /// [`MAX_REFRACTIONS`], ends by total reflection or leads away from the light.
    fn trace(&mut self, transport: &Transport, start: &Start, direction: Vec3, end: End, weigh: bool) -> Option<Chain> {
        let (u, v) = warp::frame(direction);
        let mut beam = Beam {
            position: start.origin,
            direction,
            d_position: [Vec3::ZERO; 2],
            d_direction: [u, v],
            medium: start.medium,
        };
        let (mut left, mut length) = (Vec3::ONE, 0.0);
        for refractions in 0..=MAX_REFRACTIONS {
            let hit = self.next_surface(transport, start, &beam, weigh.then_some(&mut left));
            let distance = match end {
                End::Point(point) => (point - beam.position).dot(beam.direction),
                End::Direction(_) => f32::INFINITY,
            };
            let ends = hit.at.1 == MISS || hit.t >= distance * SHADOW_END;
            let hidden = !ends && !transport.materials.mesh_material(hit.at.1).smooth_body;
            if ends || hidden {
                if distance <= 0.0 || refractions == 0 {
                    return None;
                }
                left *= transmittance(transport.materials.media[beam.medium as usize], distance);
                let (miss, d_miss, scale) = match end {
                    End::Point(point) => (
                        beam.position + beam.direction * distance - point,
                        [0, 1].map(|i| beam.d_position[i] + beam.d_direction[i] * distance),
                        length + distance,
                    ),
                    End::Direction(to) => (beam.direction - to, beam.d_direction, 1.0),
                };
                return Some(Chain { arrival: beam.direction, miss, d_miss, scale, hidden, left });
            }
            if refractions == MAX_REFRACTIONS {
                return None;
            }
            left *= transmittance(transport.materials.media[beam.medium as usize], hit.t);
            length += hit.t;
            beam.refract(transport, start.time, &hit, weigh.then_some(&mut left))?;
        }
        None
    }

    /// What a ray hits behind thin walls, which attenuate `left`.
    fn next_surface(&mut self, transport: &Transport, start: &Start, beam: &Beam, left: Option<&mut Vec3>) -> Hit {
        let Self { rays, hits } = self;
        let (mut tnear, mut last, mut walls) = (0.0, None, Vec3::ONE);
        for _ in 0..MAX_WALLS {
            rays.clear();
            rays.push(beam.position, beam.direction, tnear, f32::INFINITY, start.key);
            rays.time.extend(transport.geometry.moves.then_some(start.time));
            transport.rays.closest_hits(rays, RayOrder::Incoherent, hits);
            let at = (hits.instance[0], hits.mesh[0], hits.prim[0]);
            let hit = Hit { at, barycentric: (hits.u[0], hits.v[0]), t: hits.t[0] };
            if !is_wall(transport, at.1) {
                left.into_iter().for_each(|left| *left *= walls);
                return hit;
            }
            if last != Some(at) && left.is_some() {
                let point = transport.geometry.point(transport.scene, at, hit.barycentric, start.time);
                let passages = Passages::at(transport, &[point; LANES], &[beam.direction; LANES], true);
                walls *= passages.weight.lane(0);
            }
            last = Some(at);
            tnear = beyond(hit.t);
        }
        left.into_iter().for_each(|left| *left = Vec3::ZERO);
        Hit { at: (MISS, MISS, MISS), barycentric: (0.0, 0.0), t: f32::INFINITY }
    }
}

impl Beam {
    /// Goes on behind the smooth boundary that it has hit; `left` is attenuated. `None` if nothing is refracted.
    fn refract(&mut self, transport: &Transport, time: f32, hit: &Hit, left: Option<&mut Vec3>) -> Option<()> {
        let at = |barycentric| transport.geometry.point(transport.scene, hit.at, barycentric, time);
        let point = at(hit.barycentric);
        if point.material.textures[TextureSlot::Normal].is_some() {
            return None;
        }
        let back_facing = point.is_back_facing(self.direction);
        let side = if back_facing { -1.0 } else { 1.0 };
        let ng = point.ng.try_normalize()? * side;
        let length = point.ns.length();
        let ns = point.ns.try_normalize()? * side;
        let n = shading_normal::consistent(V3::splat(ng), V3::splat(ns), V3::splat(-self.direction)).lane(0);

        // Snell's law: ω' = η ω + μ n.
        let ior = refraction_index(point.material.ior);
        let eta = if back_facing { ior } else { 1.0 / ior };
        let cos = -n.dot(self.direction);
        let square = 1.0 - eta * eta * (1.0 - cos * cos);
        if cos <= 0.0 || square <= 0.0 {
            return None;
        }
        let root = square.sqrt();
        let mu = eta * cos - root;
        let refracted = (self.direction * eta + n * mu).try_normalize()?;
        if refracted.dot(ng) >= 0.0 || refracted.dot(n) >= 0.0 {
            return None;
        }

        // Corners, because positions and unnormalized normals are linear in the barycentric weights.
        let [a, b, c] = [at((0.0, 0.0)), at((1.0, 0.0)), at((0.0, 1.0))];
        let edges = [b.position - a.position, c.position - a.position];
        let along = [b.ns - a.ns, c.ns - a.ns];
        for i in 0..2 {
            // Transfer to the triangle's plane.
            let moved = self.d_position[i] + self.d_direction[i] * hit.t;
            let d_position = moved - self.direction * (moved.dot(ng) / self.direction.dot(ng));
            let [u, v] = coordinates(d_position, edges);
            let d_n = (along[0] * u + along[1] * v) * side;
            let d_n = (d_n - n * n.dot(d_n)) / length;
            let d_direction = self.d_direction[i];
            let d_cos = -(d_n.dot(self.direction) + n.dot(d_direction));
            let d_mu = eta * d_cos - eta * eta * cos * d_cos / root;
            self.d_position[i] = d_position;
            self.d_direction[i] = d_direction * eta + n * d_mu + d_n * mu;
        }
        if let Some(left) = left {
            // Seen from outside, where the share that is reflected is the same.
            let outside = if back_facing { -refracted } else { self.direction };
            *left *= Passages::at(transport, &[point; LANES], &[outside; LANES], true).weight.lane(0);
        }
        self.position = point.position - ng * point.origin_offset;
        self.direction = refracted;
        [_, self.medium] = transport.materials.media_at_surface(hit.at.1, back_facing, self.medium);
        Some(())
    }
}

/// Coordinates of a vector in the plane of two edges; zero if these are parallel.
fn coordinates(v: Vec3, [e, f]: [Vec3; 2]) -> [f32; 2] {
    let n = e.cross(f);
    let square = n.length_squared();
    if square > 0.0 { [v.cross(f).dot(n) / square, e.cross(v).dot(n) / square] } else { [0.0; 2] }
}
