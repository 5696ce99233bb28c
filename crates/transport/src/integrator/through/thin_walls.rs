//! Thin smooth walls: window panes, soap films. What such a wall transmits goes straight on, which is a delta of the BSDF
//! ([`Lobe::straight`]). It is no vertex of a path, and no bounce:
//!
//! - A path's ray passes a wall with a probability, by its share of the light that the wall scatters; else it meets the
//!   other lobes. Beyond the wall it is the same ray, with the origin and density that it had, from which MIS weights follow.
//! - A shadow ray passes all walls, and its light is attenuated. So the light that both find in a direction is the same.

use glam::Vec3;

use super::back_faces::BackFaces;
use crate::bsdf::{Bsdf, Lobe, Parameters};
use crate::integrator::data::boundaries::Line;
use crate::integrator::data::context::WaveContext;
use crate::integrator::data::dimensions::{self, MAX_WALLS};
use crate::integrator::data::queues::{PathRays, ShadowRays};
use crate::integrator::data::transport::Transport;
use crate::integrator::events::PassedWall;
use crate::integrator::surface::geometry::SurfacePoint;
use crate::integrator::surface::shading_normal;
use crate::lanes::{F, LANES, U, V3, V3Column, eight};
use crate::rays::{HitBatch, MISS, RayBatch, RayOrder};
use crate::sampling::samples;

/// Start of the rest of a ray that passes a surface at `t`, relative to it: a few times the rounding error of `t`.
const BEYOND: f32 = 1.0 + 1e-6;

/// A wall emits in all directions, hence rays must not pass it always.
const MAX_EMITTER_PROBABILITY: f32 = 0.5;

/// Light that goes straight through eight walls.
#[derive(Debug, Clone, Copy)]
pub struct Passages {
    /// Linear RGB fraction of the light; zero where the surface is no smooth thin wall.
    pub weight: V3,
    /// Probability in [0, 1] with which paths pass.
    pub probability: F,
}

impl Passages {
    /// The light that goes straight through the surfaces at `points`, seen by rays of these unit directions.
    ///
    /// With `bodies` also through smooth boundaries of media, as if they did not bend it.
    #[inline(never)]
    pub fn at(transport: &Transport, points: &[SurfacePoint; LANES], direction: &[Vec3; LANES], bodies: bool) -> Self {
        let bsdfs = eight(|lane| points[lane].surface_from(transport.scene, direction[lane]).bsdf());
        let bsdf = Bsdf::gather(bsdfs.each_ref());
        // As in `Vertices::push`.
        let wo = V3::gather(*direction) * F::splat(-1.0);
        let (ng, ns) = (V3::gather(eight(|lane| points[lane].ng)), V3::gather(eight(|lane| points[lane].ns)));
        let (_, n) = shading_normal::facing(ng, ns, wo);

        let weight = bsdf.straight(n, wo, F::ONE, bodies).weight;
        let weight = V3::select(weight.is_finite(), weight, V3::ZERO);
        let (straight, scattered) = (weight.luminance(), bsdf.weight(n, wo).0);
        let most = F::from(eight(|lane| match points[lane].material.is_emissive() {
            true => MAX_EMITTER_PROBABILITY,
            false => 1.0,
        }));
        let passes = straight.simd_gt(F::ZERO);
        Self { weight, probability: passes & (straight / (straight + scattered)).fast_min(most) }
    }

    /// Decides by uniform numbers in [0, 1) which paths pass: a mask, and the factors of their throughputs.
    #[inline(always)]
    pub fn draw(&self, number: F) -> (F, V3) {
        let passes = number.simd_lt(self.probability);
        let stays = F::ONE / (F::ONE - self.probability);
        let stays = V3 { x: stays, y: stays, z: stays };
        (passes, V3::select(passes, self.weight * (F::ONE / self.probability), stays))
    }
}

/// The numbers that decide at wall number `wall` of rays at `depth`.
#[inline(always)]
pub fn numbers(seed: U, index: U, depth: u32, wall: u32) -> F {
    let (set, dimension) = dimensions::wall(depth, wall);
    samples(seed, index, set)[dimension]
}

/// A ray that has hit a thin wall.
#[derive(Debug, Clone, Copy)]
struct WallHit {
    row: u32,
    /// Is it the triangle that the ray has just passed, found again by rounding?
    again: bool,
}

/// The part of a ray behind the last surface that it has passed.
#[derive(Debug, Clone, Copy)]
struct Segment {
    /// A stack of [`Materials::media`](crate::integrator::Materials::media).
    medium: u32,
    start: f32,
}

/// Takes rays through thin walls; one per thread.
#[derive(Debug, Default)]
pub struct ThinWalls {
    walls: Vec<WallHit>,
    /// Rows that have met another surface in the last step.
    passed: Vec<u32>,
    /// By row, if media attenuate.
    segments: Vec<Segment>,
    /// Also those of rays that meet no walls.
    pub(super) back_faces: BackFaces,
    rays: RayBatch,
    hits: HitBatch,
    shadow_hits: HitBatch,
}

impl ThinWalls {
    /// Takes the rays of paths through the walls that they pass: replaces their hits, and multiplies their throughputs. `passed` is
    /// told of each wall.
    #[inline(never)]
    pub fn pass(
        &mut self,
        at: &WaveContext,
        rays: &mut PathRays,
        hits: &mut HitBatch,
        passed: &mut dyn FnMut(&PathRays, &PassedWall),
    ) {
        let transport = at.transport;
        if at.depth <= 1 {
            rays.passed_wall.resize(rays.len, false);
        }
        self.begin(transport, rays.len, hits, &|_| false, None);
        for wall in 0..MAX_WALLS {
            if self.walls.is_empty() {
                return;
            }
            let mut passing = 0;
            for first in (0..self.walls.len()).step_by(LANES) {
                let (packet, n) = self.packet(first);
                let row = packet.map(|hit| hit.row as usize);
                let points = row.map(|row| transport.point(&rays.rays, hits, row));
                let passages = Passages::at(transport, &points, &row.map(|row| rays.rays.direction(row)), false);
                let seed = U::from(row.map(|row| rays.seed[row]));
                let index = U::from(row.map(|row| rays.index[row]));
                let (passes, factor) = passages.draw(numbers(seed, index, at.depth, wall));
                let passes = passes.to_bitmask();
                for lane in 0..n {
                    let passes = packet[lane].again || passes >> lane & 1 == 1;
                    if !packet[lane].again {
                        rays.beta.set(row[lane], rays.beta.get(row[lane]) * factor.lane(lane));
                    }
                    if passes {
                        if !packet[lane].again {
                            let (row, weight) = (row[lane], passages.weight.lane(lane));
                            passed(rays, &PassedWall { row, weight, t: hits.t[row] });
                        }
                        self.walls[passing] = packet[lane];
                        passing += 1;
                        rays.passed_wall.iter_mut().skip(row[lane]).take(1).for_each(|passed| *passed = true);
                    }
                }
            }
            self.walls.truncate(passing);
            self.trace_behind(transport, &rays.rays, &|row| rays.passes_backs(transport, row), hits);
            self.retain(|row| is_wall(transport, hits.mesh[row]));
        }
        for row in self.walls.iter().map(|hit| hit.row as usize) {
            hits.set_miss(row);
            rays.beta.set(row, Vec3::ZERO);
        }
    }

    /// Tests which shadow rays are occluded, and attenuates the others by what they pass.
    pub(crate) fn occlude(&mut self, transport: &Transport, shadows: &mut ShadowRays) {
        match transport.materials.has_thin_walls || transport.passes_bodies() {
            true => self.pass_shadow_rays(transport, shadows),
            false => {
                transport.rays.occluded(&shadows.rays, RayOrder::Incoherent, &mut shadows.occluded);
                self.back_faces.reveal(transport, shadows);
            }
        }
    }

    /// Tests whether shadow rays are occluded by something else than thin walls, and attenuates their light by the walls. With
    /// [`ShadowRays::bodies`], the rays that may pass bodies of smooth glass do, and media attenuate all of them.
    #[inline(never)]
    fn pass_shadow_rays(&mut self, transport: &Transport, shadows: &mut ShadowRays) {
        let mut hits = std::mem::take(&mut self.shadow_hits);
        let ShadowRays { rays, radiance, bodies, backs, through, occluded, len, .. } = shadows;
        let passes_backs = |row: usize| backs.get(row).is_some_and(|passes| *passes != 0);
        transport.rays.closest_hits(rays, RayOrder::Incoherent, &mut hits);
        self.back_faces.resolve(transport, rays, &passes_backs, &mut hits);
        through.resize(*len, 1.0);
        let passes = |row: usize| bodies.as_ref().is_some_and(|bodies| bodies.passes[row] != 0);
        self.begin(transport, *len, &hits, &passes, bodies.as_ref().map(|bodies| &bodies.medium[..*len]));
        for _ in 0..MAX_WALLS {
            if self.walls.is_empty() {
                break;
            }
            let passes = [&passes as _, &passes_backs as _];
            self.step(transport, rays, radiance, &mut hits, passes, |row, ratio| through[row] *= ratio);
        }
        occluded.clear();
        occluded.extend(hits.mesh[..*len].iter().map(|&mesh| mesh != MISS));
        if bodies.is_some() {
            for row in (0..*len).filter(|&row| !occluded[row]) {
                self.absorb(transport, radiance, row, rays.tfar[row]);
            }
        }
        self.shadow_hits = hits;
    }

    /// Begins to take `len` rays with these hits through all that light passes straight on. `passes`: does a ray pass bodies?
    /// `media` are those at the rays' origins, if media shall attenuate.
    pub fn begin(
        &mut self,
        transport: &Transport,
        len: usize,
        hits: &HitBatch,
        passes: &dyn Fn(usize) -> bool,
        media: Option<&[u32]>,
    ) {
        self.walls.clear();
        let rows = (0..).zip(&hits.mesh[..len]).filter(|(row, mesh)| is_passable(transport, **mesh, passes, *row));
        self.walls.extend(rows.map(|(row, _)| WallHit { row: row as u32, again: false }));
        self.segments.clear();
        self.segments.extend(media.into_iter().flatten().map(|&medium| Segment { medium, start: 0.0 }));
    }

    /// Takes the rays that have begun through one surface: replaces their hits, and attenuates `light`, of which `attenuated`
    /// is told the row and the ratio of lengths. Rays that hit what light does not pass end. `passes`: does a ray pass bodies, does
    /// it pass back faces?
    pub fn step(
        &mut self,
        transport: &Transport,
        rays: &RayBatch,
        light: &mut V3Column,
        hits: &mut HitBatch,
        [passes, passes_backs]: [&dyn Fn(usize) -> bool; 2],
        mut attenuated: impl FnMut(usize, f32),
    ) {
        let mut passing = 0;
        for first in (0..self.walls.len()).step_by(LANES) {
            let (packet, n) = self.packet(first);
            let row = packet.map(|hit| hit.row as usize);
            let points = row.map(|row| transport.point(rays, hits, row));
            let passages = Passages::at(transport, &points, &row.map(|row| rays.direction(row)), true);
            for lane in 0..n {
                let row = row[lane];
                if !packet[lane].again {
                    let before = light.get(row);
                    let after = before * passages.weight.lane(lane);
                    // A surface that lets no light straight through occludes.
                    if after.max_element() <= 0.0 {
                        continue;
                    }
                    light.set(row, after);
                    let scale = 1.0 / before.max_element();
                    attenuated(row, (after * scale).length() / (before * scale).length());
                    if !self.segments.is_empty() {
                        self.absorb(transport, light, row, hits.t[row]);
                        let direction = rays.direction(row);
                        let Segment { medium, start } = self.segments[row];
                        let line = || Line {
                            origin: rays.origin(row),
                            direction,
                            interval: [if start > 0.0 { beyond(start) } else { 0.0 }, beyond(hits.t[row])],
                            time: rays.time(row),
                        };
                        let back_facing = points[lane].is_back_facing(direction);
                        let [_, medium] = transport.media_at_surface(hits.primitive(row), back_facing, medium, line);
                        self.segments[row] = Segment { medium, start: hits.t[row] };
                    }
                }
                self.walls[passing] = packet[lane];
                passing += 1;
            }
        }
        self.walls.truncate(passing);
        self.trace_behind(transport, rays, passes_backs, hits);
        self.passed.clear();
        self.passed.extend(self.walls.iter().filter(|hit| !hit.again).map(|hit| hit.row));
        self.walls.retain(|hit| is_passable(transport, hits.mesh[hit.row as usize], passes, hit.row as usize));
    }

    /// Attenuates the light of a ray from the last surface that it has passed to `t`.
    pub(crate) fn absorb(&self, transport: &Transport, light: &mut V3Column, row: usize, t: f32) {
        let Some(&Segment { medium, start }) = self.segments.get(row) else { return };
        if medium > 0 {
            let left = transport.materials.media.transmittance(medium, t - start);
            light.set(row, light.get(row) * left);
        }
    }

    /// Has no ray hit something that it may pass?
    pub fn is_empty(&self) -> bool {
        self.walls.is_empty()
    }

    /// Keeps some of the rows that have begun.
    pub fn retain(&mut self, keep: impl Fn(usize) -> bool) {
        self.walls.retain(|hit| keep(hit.row as usize));
    }

    /// Rows of the rays that have met another surface, or none, in the last step.
    pub fn passed(&self) -> impl Iterator<Item = u32> {
        self.passed.iter().copied()
    }

    /// Eight listed hits from `first` on, and how many of them are valid. Spare lanes repeat the first one.
    fn packet(&self, first: usize) -> ([WallHit; LANES], usize) {
        let n = LANES.min(self.walls.len() - first);
        (eight(|lane| self.walls[first + if lane < n { lane } else { 0 }]), n)
    }

    /// Replaces the listed rays' hits by those behind them.
    fn trace_behind(
        &mut self,
        transport: &Transport,
        rays: &RayBatch,
        passes_backs: &dyn Fn(usize) -> bool,
        hits: &mut HitBatch,
    ) {
        self.rays.clear();
        for row in self.walls.iter().map(|hit| hit.row as usize) {
            let (origin, direction) = (rays.origin(row), rays.direction(row));
            self.rays.push(origin, direction, beyond(hits.t[row]), rays.tfar[row], rays.key[row]);
            self.rays.time.extend(rays.time.get(row));
        }
        transport.rays.closest_hits(&self.rays, RayOrder::Incoherent, &mut self.hits);
        let passes = |at: usize| passes_backs(self.walls[at].row as usize);
        self.back_faces.resolve(transport, &self.rays, &passes, &mut self.hits);
        let more = &self.hits;
        for (from, wall) in self.walls.iter_mut().enumerate() {
            let to = wall.row as usize;
            wall.again = more.primitive(from) == hits.primitive(to);
            hits.replace(to, more, from);
        }
    }
}

/// Start of the rest of a ray that passes a surface at `t`.
#[inline]
pub fn beyond(t: f32) -> f32 {
    (t * BEYOND).max(f32::MIN_POSITIVE)
}

/// Replaces the hits of camera rays by those of most paths, behind back faces and walls.
pub(crate) fn pass_most(transport: &Transport, rays: &RayBatch, hits: &mut HitBatch) {
    let mut walls = ThinWalls::default();
    let passes_backs = |_| transport.culls();
    walls.back_faces.resolve(transport, rays, &passes_backs, hits);
    walls.begin(transport, rays.len(), hits, &|_| false, None);
    for _ in 0..MAX_WALLS {
        walls.walls.retain(|hit| {
            let row = hit.row as usize;
            let point = transport.point(rays, hits, row);
            let passages = Passages::at(transport, &[point; LANES], &[rays.direction(row); LANES], false);
            hit.again || passages.probability.as_array()[0] > 0.5
        });
        if walls.walls.is_empty() {
            return;
        }
        walls.trace_behind(transport, rays, &passes_backs, hits);
        walls.retain(|row| is_wall(transport, hits.mesh[row]));
    }
}

/// Is the mesh a thin wall that light may pass straight on?
#[inline]
pub fn is_wall(transport: &Transport, mesh: u32) -> bool {
    mesh != MISS && transport.materials.mesh_material(mesh).thin_wall
}

/// [`is_wall`], or a smooth body if the ray `passes` bodies?
fn is_passable(transport: &Transport, mesh: u32, passes: &dyn Fn(usize) -> bool, row: usize) -> bool {
    mesh != MISS && {
        let kind = transport.materials.mesh_material(mesh);
        kind.thin_wall || (kind.smooth_body && passes(row))
    }
}
