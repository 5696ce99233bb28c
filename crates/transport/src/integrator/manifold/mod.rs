//! Light through bodies of smooth glass by refraction (`--glass-shadows manifold`): at each vertex a sample of the area lights
//! and one of the punctual lights, to which a [`Walker`] finds the direction. The light arrives there like that of a light sample
//! whose density is the sample's times the chain's geometric term. No other technique counts the same light:
//!
//! - A direction that a vertex samples is *rough* if its density is below [`MIRROR_PDF`] and the vertex is not on smooth glass.
//!   Only rough directions are connected.
//! - A path that leaves in a rough direction, is refracted by 1 to [`MAX_REFRACTIONS`] smooth boundaries and nothing else, and
//!   hits an emitter, repeats the walk to the point that it has hit. Its light is left out if the walk finds the path's
//!   direction; other solutions and failed walks stay with the path. So the sum is unbiased, up to the width of a smooth
//!   boundary's lobe (α of 0.001), which walks neglect.
//! - Refracted directions on such paths take no light samples of emitters: their emission has the full weight.
//! - Punctual lights, which no path hits, take no light samples there either. Of them only what walks find is seen.

mod pilot;
mod walk;

use glam::Vec3;
use wide::bytemuck::cast;

use super::back_faces::MIRROR_PDF;
use super::events::{PathEvents, ScatteredGroup, WaveContext};
use super::glass_shadows::{emits, smooth};
use super::path_states::NonFiniteSamples;
use super::queues::{PathRays, ShadowRays, THROUGH_GLASS};
use super::stages::lights::{self, SHADOW_END};
use super::stages::mixture::Mixture;
use super::stages::requests::RequestGroup;
use super::thin_walls::is_wall;
use super::transport::Transport;
use super::vertices::Vertices;
use crate::bsdf::Lobe;
use crate::lanes::{F, LANES, Rows, U, V3, eight, grow, load_bits};
use crate::light::{LightSampleContext, punctual};
use crate::rays::{HitBatch, MISS, RayBatch, RayOrder};
use crate::sampling::{hashes, keys, samples};
use crate::scene::PunctualKind;
pub use pilot::share_behind_glass;
pub use walk::{Connection, End, MAX_REFRACTIONS, Start, Walker};

/// Sequence dimensions of the light samples at the first surface; those at deeper ones follow.
const MANIFOLD_SET: u32 = 1 << 15;

/// Dimensions of the light samples at a depth.
pub fn manifold_set(depth: u32) -> u32 {
    MANIFOLD_SET + depth
}

/// What a path has done since it left a vertex in a rough direction.
#[derive(Debug, Clone, Copy, Default)]
pub struct History {
    /// Where it left; without key and time.
    start: Start,
    /// The rough direction.
    direction: Vec3,
    /// Has it had a rough direction?
    pub after_rough: bool,
    /// Refractions since.
    refractions: u8,
    /// Were all bounces since refractions by smooth boundaries?
    pure: bool,
    /// Was the last bounce one, after a rough direction?
    pub bent: bool,
}

impl History {
    /// After a bounce of density `pdf` from `origin` to `direction`; on smooth glass or not, `beyond` the surface or not.
    pub fn after(self, pdf: f32, [smooth, beyond]: [bool; 2], (origin, direction): (Vec3, Vec3)) -> Self {
        let refracted = smooth && beyond;
        if pdf < MIRROR_PDF && !smooth {
            let start = Start { origin, ..Default::default() };
            return Self { start, direction, after_rough: true, refractions: 0, pure: true, bent: false };
        }
        Self {
            refractions: self.refractions.saturating_add(u8::from(refracted)),
            pure: self.pure && refracted,
            bent: self.after_rough && refracted,
            ..self
        }
    }

    /// Do walks find the light that a ray of this path has found at `t` on the triangle `hit`?
    pub fn is_found(
        &self,
        transport: &Transport,
        walker: &mut Walker,
        hit: (u32, u32, u32),
        (point, key, time): (Vec3, u32, f32),
    ) -> bool {
        let is_chain = self.pure && (1..=MAX_REFRACTIONS).contains(&usize::from(self.refractions));
        if !is_chain || hit.1 == MISS || !emits(transport, hit.1) {
            return false;
        }
        let start = Start { key, time, ..self.start };
        let to = point - start.origin;
        let (wi, distance) = (to.normalize_or(Vec3::Y), to.length());
        let at = (transport.scene, time);
        let is_sampled =
            transport.lights.area_pdf(at, (start.origin, Vec3::ZERO), hit, wi, distance, &transport.proposal.lights)
                > 0.0;
        let mut found = || walker.connect(transport, &start, End::Point(point));
        is_sampled && found().is_some_and(|found| found.direction.dot(self.direction) > SAME_DIRECTION)
    }
}

/// Cosine between directions of the same chain: the lobes of smooth boundaries spread less than 0.05 radians.
const SAME_DIRECTION: f32 = 0.99875;

/// A point on a light, or a punctual light, as a light sample chose it.
#[derive(Debug, Clone, Copy)]
pub struct Candidate {
    /// Unit direction straight to it.
    pub wi: Vec3,
    /// Distance, infinite for directional lights.
    pub distance: f32,
    end: End,
    light: Light,
}

#[derive(Debug, Clone, Copy)]
enum Light {
    /// Radiance over density per area, and the emitter.
    Area(Vec3, u32),
    /// Index of the light, and one over its probability.
    Punctual(usize, f32),
}

impl Candidate {
    /// Candidates of eight points: of area lights and of punctual lights.
    pub fn eight(transport: &Transport, from: V3, time: F, numbers: [F; 4]) -> [[Option<Self>; LANES]; 2] {
        let [choice, u, v, punctual_choice] = numbers;
        let mut both = [[None; LANES]; 2];
        if let Some(area) = &transport.lights.area {
            let scene = transport.scene;
            let context = LightSampleContext { scene, time, p: from, n: V3::ZERO };
            let samples = area.sample(&context, &transport.proposal.lights, [choice, u, v]);
            for (lane, candidate) in both[0].iter_mut().enumerate() {
                let [pdf, distance, time] = [samples.pdf, samples.distance, time].map(|x| x.as_array()[lane]);
                let (wi, emitter) = (samples.wi.lane(lane), samples.emitter[lane]);
                let per_area = pdf * area.facing(scene, emitter, time, wi) / (distance * distance);
                let light = Light::Area(samples.radiance.lane(lane) / per_area, emitter);
                let end = End::Point(from.lane(lane) + wi * distance);
                *candidate = (pdf > 0.0 && per_area > 0.0).then_some(Self { wi, distance, end, light });
            }
        }
        if transport.lights.punctual {
            for (lane, candidate) in both[1].iter_mut().enumerate() {
                let (from, time) = (from.lane(lane), time.as_array()[lane]);
                let lights = &transport.scene.lights;
                let chosen = punctual::choose(lights, from, punctual_choice.as_array()[lane], time);
                *candidate = chosen.map(|chosen| {
                    let is_far = lights[chosen.light].kind == PunctualKind::Directional;
                    let end =
                        if is_far { End::Direction(chosen.wi) } else { End::Point(from + chosen.wi * chosen.distance) };
                    let light = Light::Punctual(chosen.light, chosen.one_over_probability);
                    Self { wi: chosen.wi, distance: chosen.distance, end, light }
                });
            }
        }
        both
    }

    /// The direction in which it is seen from `start` through glass, and its light: what is to be multiplied by throughput and
    /// BSDF.
    pub fn light(&self, transport: &Transport, walker: &mut Walker, start: &Start) -> Option<(Vec3, Vec3)> {
        let found = walker.connect(transport, start, self.end)?;
        let scene = transport.scene;
        let emitted = match (self.light, self.end) {
            (Light::Area(radiance, emitter), _) => {
                let area = transport.lights.area.as_ref()?;
                radiance * area.facing(scene, emitter, start.time, found.arrival)
            }
            (Light::Punctual(light, one_over_probability), End::Direction(_)) => {
                punctual::irradiance(&scene.lights[light], start.origin, start.time).2 * one_over_probability
            }
            (Light::Punctual(light, one_over_probability), End::Point(position)) => {
                // The intensity toward the last segment, with the range of the straight distance.
                let seen_from = position - found.arrival * self.distance;
                let irradiance = punctual::irradiance(&scene.lights[light], seen_from, start.time).2;
                irradiance * (self.distance * self.distance * one_over_probability)
            }
        };
        Some((found.direction, emitted * found.left * found.density))
    }

    /// Its kind of light, as in [`ShadowRays::light_group`].
    fn light_group(&self) -> u32 {
        THROUGH_GLASS
            + match self.light {
                Light::Area(..) => super::queues::AREA_GROUP,
                Light::Punctual(..) => super::queues::PUNCTUAL_GROUP,
            }
    }
}

/// Mask of eight light samples that are left out: in directions that cross smooth boundaries, on paths with a rough direction
/// before. Those in the mask `beyond` cross the surface.
#[inline(always)]
pub fn left_out(transport: &Transport, vertices: &Vertices, rows: &Rows, bsdf: &impl Lobe, beyond: F) -> F {
    if !transport.connects() {
        return F::ZERO;
    }
    let after_rough: F = cast(load_bits(&vertices.after_rough, rows));
    after_rough & beyond & smooth(vertices, rows, bsdf)
}

/// Light samples through bodies, and what they leave to paths; one per thread. A client of the wave.
#[derive(Debug, Default)]
pub struct Manifolds {
    /// By number of a ray; empty if nothing is connected.
    histories: Vec<History>,
    walker: Walker,
    candidates: Vec<(u32, Start, Candidate)>,
    probes: RayBatch,
    hits: HitBatch,
    shadows: ShadowRays,
    unoccluded: Vec<bool>,
}

impl Manifolds {
    /// Marks the rays whose light walks find, and those that a smooth boundary has refracted.
    pub fn find(&mut self, at: &WaveContext, rays: &mut PathRays, hits: &HitBatch) {
        rays.bent.clear();
        let transport = at.transport;
        if !transport.connects() {
            return;
        }
        let histories = &self.histories[rays.first as usize..][..rays.len];
        rays.bent.extend(histories.iter().map(|history| history.bent));
        rays.excluded.resize(rays.len, false);
        for (row, history) in histories.iter().enumerate() {
            let hit = (hits.instance[row], hits.mesh[row], hits.prim[row]);
            let point = rays.rays.origin(row) + rays.rays.direction(row) * hits.t[row];
            let at = (point, rays.rays.key[row], rays.rays.time(row));
            rays.excluded[row] = history.is_found(transport, &mut self.walker, hit, at);
        }
    }

    /// Fills [`Vertices::after_rough`].
    pub fn mark(&self, transport: &Transport, vertices: &mut Vertices) {
        if transport.connects() {
            let state = |ray: &u32| if self.histories[*ray as usize].after_rough { u32::MAX } else { 0 };
            let len = vertices.len();
            vertices.after_rough = vertices.ray[..len].iter().map(state).collect();
            grow(&mut vertices.after_rough, len);
        }
    }

    /// Adds the light samples of the vertices.
    pub fn sample<E: PathEvents>(
        &mut self,
        at: &WaveContext,
        vertices: &Vertices,
        (radiance, non_finite): (&mut [Vec3], &mut NonFiniteSamples),
        events: &mut E,
    ) {
        if !at.transport.connects() {
            return;
        }
        self.choose(at, vertices);
        self.shadows.open(self.candidates.len(), false);
        for i in 0..self.candidates.len() {
            let (row, start, candidate) = self.candidates[i];
            let Some(found) = self.connected(at.transport, vertices, row, &start, &candidate) else { continue };
            let path = vertices.path[row as usize];
            if !found.is_finite() {
                non_finite.add(path);
                continue;
            }
            let shadows = &mut self.shadows;
            shadows.radiance.set(shadows.len, found);
            shadows.path[shadows.len] = path;
            shadows.ray[shadows.len] = vertices.ray[row as usize];
            shadows.light_group[shadows.len] = candidate.light_group();
            shadows.len += 1;
        }
        self.unoccluded.clear();
        self.unoccluded.resize(self.shadows.len, false);
        lights::add_unoccluded(at, &self.shadows, &self.unoccluded, radiance, events);
    }

    /// Lists the candidates that are straight behind glass, with the rows of their vertices.
    fn choose(&mut self, at: &WaveContext, vertices: &Vertices) {
        let transport = at.transport;
        self.candidates.clear();
        self.probes.clear();
        for first in (0..vertices.len()).step_by(LANES) {
            let rows = Rows::From(first);
            let n = LANES.min(vertices.len() - first);
            let id = vertices.path_ids(&rows);
            let numbers = samples(id.seed, id.index, manifold_set(at.depth));
            let key = hashes(keys(id.seed, id.index, manifold_set(at.depth))).to_array();
            let bsdf = vertices.bsdf(&rows);
            let (transmits, smooth) = (bsdf.transmits(), smooth(vertices, &rows, &bsdf).to_bitmask());
            for candidates in Candidate::eight(transport, vertices.origin.load(&rows), id.time, numbers) {
                let wi = V3::gather(candidates.map(|candidate| candidate.map_or(Vec3::Y, |candidate| candidate.wi)));
                let spawned = vertices.spawn_rays(&rows, transmits, wi);
                let allowed = spawned.allowed.to_bitmask() & !smooth;
                let medium = vertices.media(&rows, spawned.beyond).unwrap_or(U::ZERO).to_array();
                for lane in (0..n).filter(|lane| allowed >> lane & 1 == 1) {
                    let Some(candidate) = candidates[lane] else { continue };
                    let (origin, key, time) = (spawned.origin.lane(lane), key[lane], id.time.as_array()[lane]);
                    self.probes.push(origin, candidate.wi, 0.0, candidate.distance * SHADOW_END, key);
                    self.probes.time.extend(vertices.moves().then_some(time));
                    let start = Start { origin, medium: medium[lane], key, time };
                    self.candidates.push(((first + lane) as u32, start, candidate));
                }
            }
        }
        transport.rays.closest_hits(&self.probes, RayOrder::Incoherent, &mut self.hits);
        let mut mesh = self.hits.mesh.iter();
        self.candidates.retain(|_| is_behind_glass(transport, *mesh.next().unwrap_or(&MISS)));
    }

    /// The light of a candidate through glass, with throughput and BSDF.
    fn connected(
        &mut self,
        transport: &Transport,
        vertices: &Vertices,
        row: u32,
        start: &Start,
        candidate: &Candidate,
    ) -> Option<Vec3> {
        let (direction, light) = candidate.light(transport, &mut self.walker, start)?;
        let rows = Rows::Each([row; LANES]);
        let (bsdf, wi) = (vertices.bsdf(&rows), V3::splat(direction));
        let (value, mut pdf) = bsdf.eval_pdf(vertices.ns.load(&rows), vertices.wo.load(&rows), wi);
        if let Some(mixture) = Mixture::at(transport, vertices, &rows) {
            pdf = mixture.pdf(wi, pdf);
        }
        let spawned = vertices.spawn_rays(&rows, bsdf.transmits(), wi);
        // The direction must be on the side of the surface from which it was sought.
        let allowed = spawned.allowed.to_bitmask() & 1 == 1 && spawned.origin.lane(0) == start.origin;
        let radiance = vertices.beta.load(&rows).lane(0) * value.lane(0) * light;
        let connects = allowed && pdf.as_array()[0] < MIRROR_PDF && radiance != Vec3::ZERO;
        connects.then_some(radiance)
    }
}

/// Is the first surface on the way to a light glass that a walk may pass?
pub fn is_behind_glass(transport: &Transport, mesh: u32) -> bool {
    mesh != MISS && (is_wall(transport, mesh) || transport.materials.mesh_material(mesh).smooth_body)
}

impl PathEvents for Manifolds {
    fn begin(&mut self, at: &WaveContext) {
        self.histories.clear();
        if at.transport.connects() {
            self.histories.resize(at.paths.len(), History::default());
        }
    }

    fn scattered(&mut self, at: &WaveContext, vertices: &Vertices, group: &RequestGroup, samples: &ScatteredGroup) {
        if !at.transport.connects() {
            return;
        }
        let (rows, survivors) = (&group.rows, &samples.survivors);
        let bsdf = vertices.bsdf(rows);
        let spawned = vertices.spawn_rays(rows, bsdf.transmits(), samples.wi);
        let [smooth, beyond] =
            [smooth(vertices, rows, &bsdf), spawned.beyond].map(|mask| survivors.compress_bits(cast(mask)).to_array());
        let pdf = survivors.compress(samples.pdf[0]).to_array();
        let arrived = survivors.compress_bits(load_bits(&vertices.ray, rows)).to_array();
        let (origin, wi) = (survivors.compress_v3(spawned.origin), survivors.compress_v3(samples.wi));
        let rays = eight(|lane| (origin.lane(lane), wi.lane(lane)));
        for lane in 0..survivors.len {
            let before = self.histories[arrived[lane] as usize];
            self.histories.push(before.after(pdf[lane], [smooth[lane] != 0, beyond[lane] != 0], rays[lane]));
        }
    }
}
