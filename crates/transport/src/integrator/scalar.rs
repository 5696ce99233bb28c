//! One path at a time, as plainly as it can be said: the oracle for the wave, and what `--replay-pixel` prints. It shares
//! scattering, lights and sequences with the wave, but none of its queues, sorting or compaction.

use glam::Vec3;

use super::Transport;
use super::batch::PixelTask;
use super::dispersion;
pub use super::events::{Event, What};
use super::path_states::limited;
use super::stages::camera_rays::TIME_SET;
use super::stages::lights::SHADOW_END;
use super::stages::mixture::{self, Drawn, Mixture};
use super::stages::requests::{Toward, light_sample};
use super::stages::scatter::{ROULETTE_DEPTH, ROULETTE_GAIN};
use super::stages::{bsdf_set, light_set, media, roll_set};
use super::vertices::MIN_COS;
use crate::balance::deal;
use crate::bsdf::{Bsdf, Lobe, Parameters};
use crate::color::luminance;
use crate::guiding::NOWHERE;
use crate::lanes::{F, LANES, U, V3, unit_interval};
use crate::light::punctual;
use crate::rays::{HitBatch, MISS, RayBatch, RayOrder};
use crate::sampling::{PixelSequence, hash, keys, pixel_seed};

/// A ray of a path.
struct Ray {
    origin: Vec3,
    direction: Vec3,
    key: u32,
    /// Radiance that arrives counts this much.
    beta: Vec3,
    /// Geometric normal where it begins, zero on what transmits.
    normal: Vec3,
    /// BSDF pdf times samples a path.
    weighted_pdf: f32,
    /// Index into its pixel's sequence.
    index: u32,
    /// The medium that it is in.
    medium: u32,
    /// The chance that a light sample had where it begins.
    light_chance: f32,
    /// In [0, 1] of the shutter.
    time: f32,
}

/// Where a path meets a surface.
struct Vertex {
    origin: Vec3,
    position: Vec3,
    ng: Vec3,
    ns: Vec3,
    wo: Vec3,
    beta: Vec3,
    bsdf: <Bsdf as Parameters>::Eight,
    /// Light passes through.
    transmits: bool,
    origin_offset: f32,
    /// On the eye's side, and beyond.
    media: [u32; 2],
    /// Of the field.
    cell: u32,
    /// Chances of a light sample and of going on, where a field knows them.
    chances: Option<[f32; 2]>,
    /// Of its path.
    time: f32,
}

/// A way to leave a vertex.
struct Leaving {
    origin: Vec3,
    allowed: bool,
    medium: u32,
}

impl Vertex {
    fn leave(&self, wi: Vec3) -> Leaving {
        let cos = self.ng.dot(wi);
        let beyond = self.transmits && cos < 0.0;
        let alike = !self.transmits || cos * self.ns.dot(wi) > 0.0;
        Leaving {
            origin: if beyond { self.origin - self.ng * (2.0 * self.origin_offset) } else { self.origin },
            allowed: (cos > 0.0 || beyond) && alike,
            medium: self.media[usize::from(beyond)],
        }
    }

    /// The normal by which lights are chosen.
    fn facing(&self) -> Vec3 {
        if self.transmits { Vec3::ZERO } else { self.ng }
    }
}

struct Path<'a> {
    transport: &'a Transport<'a>,
    sequence: PixelSequence,
    seed: u32,
    /// Samples a path at the first surface: toward the environment, toward area lights, of the BSDF.
    rates: [f32; 3],
    tell: &'a mut dyn FnMut(Event),
}

/// Radiance of path `path` of those that a wave takes for a pixel; `tell` hears what happens.
pub fn trace(transport: &Transport, task: &PixelTask, path: u32, tell: &mut dyn FnMut(Event)) -> Vec3 {
    let paths = task.counts.paths;
    let sequence = PixelSequence::new(task.x, task.y, transport.seed);
    let seed = pixel_seed(task.x, task.y, transport.seed);
    let index = task.first_path + path;
    let [px, py, u, v] = sequence.sample(index, 0);
    let offset = |u: f32| transport.filter.offsets(F::splat(u)).as_array()[0];
    let (x, y) = (offset(px) + (task.x as f32 + 0.5), offset(py) + (task.y as f32 + 0.5));
    let moves = transport.geometry.moves;
    let time = if moves { sequence.sample(index, TIME_SET)[0] } else { 0.0 };
    let (xy, uv) = ((F::splat(x), F::splat(y)), (F::splat(u), F::splat(v)));
    let (origin, direction) = transport.camera.rays_through(xy, uv, F::splat(time));
    let rates = task.weighed.rates(transport.lights.environment_probability);
    let mut state = Path { transport, sequence, seed, rates, tell };
    let ray = Ray {
        origin: origin.lane(0),
        direction: direction.lane(0),
        key: key(seed, index, 0),
        beta: Vec3::ONE,
        normal: Vec3::ZERO,
        weighted_pdf: 0.0,
        index,
        medium: 0,
        light_chance: 1.0,
        time,
    };
    let before = |n: u32| (0..path).map(|p| u32::from(deal(n, paths, p))).sum::<u32>();
    let numbers = |first: u32, n: u32| {
        let start = first + before(n);
        start..start + u32::from(deal(n, paths, path))
    };
    let light = numbers(task.first_light, task.counts.light).map(|number| light_sample(task, number));
    let bsdf = numbers(task.first_bsdf, task.counts.bsdf);
    state.follow(&ray, 0, &light.collect::<Vec<_>>(), &bsdf.collect::<Vec<_>>())
}

fn key(seed: u32, index: u32, set: u32) -> u32 {
    keys(U::splat(seed), U::splat(index), set).to_array()[0]
}

impl Path<'_> {
    fn tell(&mut self, depth: u32, what: What) {
        (self.tell)(Event { depth, what });
    }

    /// Radiance that a ray brings, with these light samples (index, toward what) and BSDF samples where it hits.
    fn follow(&mut self, ray: &Ray, depth: u32, light: &[(u32, Toward)], bsdf: &[u32]) -> Vec3 {
        let t = self.transport;
        let Ray { origin, direction, .. } = *ray;
        self.tell(depth, What::Ray { origin, direction, beta: ray.beta });
        let (mut rays, mut hits) = (RayBatch::default(), HitBatch::default());
        rays.push(origin, direction, 0.0, f32::INFINITY, ray.key);
        rays.time.extend(t.geometry.moves.then_some(ray.time));
        t.rays.closest_hits(&rays, RayOrder::Incoherent, &mut hits);
        let (instance, mesh, prim, distance) = (hits.instance[0], hits.mesh[0], hits.prim[0], hits.t[0]);
        if mesh == MISS {
            self.tell(depth, What::Escape);
            if t.lights.environment.is_none() || (depth == 0 && t.hides_environment) {
                return Vec3::ZERO;
            }
            let (radiance, pdf) = t.lights.environment(V3::splat(direction), t.drawing);
            let pdf = if depth == 0 { 0.0 } else { pdf.as_array()[0] };
            return self.emission(ray, depth, radiance.lane(0), [pdf, 0.0]);
        }
        let barycentric = (hits.u[0], hits.v[0]);
        let point = t.geometry.point(t.scene, (instance, mesh, prim), barycentric, ray.time);
        let material = point.mesh.material;
        self.tell(depth, What::Hit { instance, mesh, material, t: distance });
        let behind = point.is_behind(direction);
        let medium = if depth == 0 { t.materials.sides(mesh, behind, 0)[0] } else { ray.medium };
        let beta = ray.beta * media::left(t.materials.media[medium as usize], distance);
        let ray = &Ray { beta, ..*ray };
        if point.material.unlit {
            return self.emission(ray, depth, point.base_color(t.scene), [0.0; 2]);
        }
        let mut found = Vec3::ZERO;
        if t.materials.kind(mesh).shines && point.shines_against(direction) {
            let radiance = point.radiance(t.scene, prim, barycentric, direction);
            let from = (origin, ray.normal);
            let hit = (instance, mesh, prim);
            let at = (t.scene, ray.time);
            let pdf = if depth == 0 { 0.0 } else { t.lights.area_pdf(at, from, hit, direction, distance, t.drawing) };
            found += self.emission(ray, depth, radiance, [0.0, pdf]);
        }
        if depth + 1 >= t.max_depth {
            self.tell(depth, What::Ends { why: "--max-depth" });
            return found;
        }
        // The side of the eye; a shading normal that faces away from it is tilted until the eye is just above its horizon.
        let wo = -direction;
        let front = point.ng.normalize_or(wo);
        let side = if front.dot(wo) < 0.0 { -1.0 } else { 1.0 };
        let ng = front * side;
        let ns = point.ns.normalize_or(front) * side;
        let tilted = (ns + wo * (MIN_COS - ns.dot(wo))).normalize_or(ng);
        let [color, ..] = self.sequence.sample(ray.index, dispersion::SET);
        let (seen, beta) = dispersion::draw(point.seen(t.scene, direction), point.material, ray.beta, color);
        let surface = seen.bsdf();
        let scattering = Bsdf::gather([&surface; LANES]);
        let origin = point.position + ng * point.origin_offset;
        let cells = t.field.map(|field| (field, field.cells_at(V3::splat(origin), V3::splat(ng))));
        let luminances = F::splat(luminance(beta));
        let chances = cells.filter(|_| depth > 0).and_then(|(field, cells)| field.chances(cells, luminances));
        let vertex = Vertex {
            origin,
            position: point.position,
            ng,
            ns: if ns.dot(wo) < MIN_COS { tilted } else { ns },
            wo,
            beta,
            bsdf: scattering,
            transmits: scattering.transmits().any(),
            origin_offset: point.origin_offset,
            media: t.materials.sides(mesh, behind, medium),
            cell: cells
                .filter(|_| mixture::is_diffuse(&scattering).any())
                .map_or(NOWHERE, |(field, cells)| field.guiding(cells)[0]),
            chances: chances.map(|chances| chances.map(|chance| chance.as_array()[0])),
            time: ray.time,
        };
        for &(index, toward) in light {
            found += self.light_sample(&vertex, depth, index, toward);
        }
        if t.lights.punctual {
            found += self.punctual_sample(&vertex, depth, ray.index);
        }
        for &index in bsdf {
            found += self.bsdf_sample(&vertex, depth, index);
        }
        found
    }

    fn mixture(&self, vertex: &Vertex) -> Option<Mixture<'_>> {
        Mixture::new(self.transport.field?, [vertex.cell; LANES])
    }

    /// Samples a path of each technique at the vertex at `depth`.
    fn rates(&self, depth: u32) -> [f32; 3] {
        if depth == 0 { self.rates } else { self.transport.deeper_rates() }
    }

    /// Light that a ray ran into, weighed against a light sample's densities (as the environment, as an area light).
    fn emission(&mut self, ray: &Ray, depth: u32, radiance: Vec3, pdf: [f32; 2]) -> Vec3 {
        let rates = self.rates(depth.saturating_sub(1));
        let weighted_light = ray.light_chance * (rates[0] * pdf[0] + rates[1] * pdf[1]);
        let weight = match weighted_light > 0.0 {
            true => self.transport.heuristic.weight(ray.weighted_pdf, weighted_light),
            false => 1.0,
        };
        let radiance = ray.beta * radiance * weight;
        let radiance = if radiance.is_finite() { radiance } else { Vec3::ZERO };
        let limit = if depth == 0 { f32::INFINITY } else { self.transport.limits[(depth > 1) as usize] };
        let (radiance, _) = limited(radiance, limit);
        self.tell(depth, What::Emission { radiance, weight });
        radiance
    }

    fn light_sample(&mut self, vertex: &Vertex, depth: u32, index: u32, toward: Toward) -> Vec3 {
        let t = self.transport;
        if !t.lights.has_extent() {
            return Vec3::ZERO;
        }
        let chance = vertex.chances.map_or(1.0, |[light, _]| light);
        let [a_env, a_area, a_b] = self.rates(depth);
        let number = unit_interval(U::splat(key(self.seed, index, roll_set(depth)))).as_array()[0];
        if vertex.chances.is_some() && number >= chance {
            return Vec3::ZERO;
        }
        let [choice, u, v, _] = self.sequence.sample(index, light_set(depth));
        let (drawn, left) = t.lights.draw_kind(F::splat(choice));
        let environment = match toward {
            Toward::Drawn => drawn.to_bitmask() & 1 == 1,
            toward => toward == Toward::Environment,
        };
        let choice = if toward == Toward::Drawn { left } else { F::splat(choice) };
        let mask = if environment { F::ZERO.simd_eq(F::ZERO) } else { F::ZERO };
        let from = (V3::splat(vertex.origin), V3::splat(vertex.facing()));
        let at = (t.scene, F::splat(vertex.time));
        let light = t.lights.sample(at, from, (mask, t.drawing), [choice, F::splat(u), F::splat(v)]);
        let (value, mut bsdf_pdf) = vertex.bsdf.eval_pdf(V3::splat(vertex.ns), V3::splat(vertex.wo), light.wi);
        if let Some(mixture) = self.mixture(vertex) {
            bsdf_pdf = mixture.pdf(light.wi, bsdf_pdf);
        }
        let [pdf, bsdf_pdf, distance] = [light.pdf, bsdf_pdf, light.distance].map(|x| x.as_array()[0]);
        let (wi, value, emitted) = (light.wi.lane(0), value.lane(0), light.radiance.lane(0));
        let weighted_pdf = chance * if environment { a_env } else { a_area } * pdf;
        let weight = t.heuristic.weight(weighted_pdf, a_b * bsdf_pdf);
        let radiance = vertex.beta * value * emitted * (weight / weighted_pdf);
        let name = if environment { "environment" } else { "area light" };
        let sound = pdf > 0.0;
        self.shadow_ray(vertex, depth, index, (name, wi, distance), if sound { radiance } else { Vec3::ZERO })
    }

    fn punctual_sample(&mut self, vertex: &Vertex, depth: u32, index: u32) -> Vec3 {
        let [.., choice] = self.sequence.sample(index, light_set(depth));
        let sample = punctual::sample(&self.transport.scene.lights, vertex.position, choice, vertex.time);
        let Some(light) = sample else { return Vec3::ZERO };
        let (ns, wo) = (V3::splat(vertex.ns), V3::splat(vertex.wo));
        let (value, _) = vertex.bsdf.eval_pdf(ns, wo, V3::splat(light.wi));
        let radiance = vertex.beta * value.lane(0) * light.irradiance;
        self.shadow_ray(vertex, depth, index, ("punctual light", light.wi, light.distance), radiance)
    }

    /// `radiance`, if it is light at all and nothing is in its way.
    fn shadow_ray(
        &mut self,
        vertex: &Vertex,
        depth: u32,
        index: u32,
        (toward, wi, distance): (&'static str, Vec3, f32),
        radiance: Vec3,
    ) -> Vec3 {
        let Leaving { origin, allowed, medium } = vertex.leave(wi);
        let radiance = radiance * media::left(self.transport.materials.media[medium as usize], distance);
        let some = allowed && radiance.max_element() > 0.0 && radiance.is_finite();
        if !some {
            self.tell(depth, What::LightSample { toward, wi, distance, radiance: Vec3::ZERO, occluded: false });
            return Vec3::ZERO;
        }
        let (mut rays, mut occluded) = (RayBatch::default(), Vec::new());
        let key = hash(key(self.seed, index, light_set(depth)));
        rays.push(origin, wi, 0.0, distance * SHADOW_END, key);
        rays.time.extend(self.transport.geometry.moves.then_some(vertex.time));
        self.transport.rays.occluded(&rays, RayOrder::Incoherent, &mut occluded);
        let (radiance, _) = limited(radiance, self.transport.limits[(depth > 0) as usize]);
        let (occluded, radiance) = (occluded[0], if occluded[0] { Vec3::ZERO } else { radiance });
        self.tell(depth, What::LightSample { toward, wi, distance, radiance, occluded });
        radiance
    }

    fn bsdf_sample(&mut self, vertex: &Vertex, depth: u32, index: u32) -> Vec3 {
        let [lobe, u, v, survive] = self.sequence.sample(index, bsdf_set(depth));
        let (ns, wo) = (V3::splat(vertex.ns), V3::splat(vertex.wo));
        let numbers = [lobe, u, v].map(F::splat);
        let mixture = self.mixture(vertex);
        let Drawn { sample, .. } = match &mixture {
            Some(mixture) => mixture.draw(&vertex.bsdf, ns, wo, numbers),
            None => Drawn::of_bsdf(vertex.bsdf.sample(ns, wo, numbers)),
        };
        let (wi, value, pdf) = (sample.wi.lane(0), sample.value.lane(0), sample.pdf.as_array()[0]);
        self.tell(depth, What::BsdfSample { wi, pdf });
        let weighted_pdf = self.rates(depth)[2] * pdf;
        let mut beta = vertex.beta * value / weighted_pdf;
        let Leaving { origin, allowed, medium } = vertex.leave(wi);
        let alive = pdf > 0.0 && allowed && beta.max_element() > 0.0 && beta.is_finite();
        if !alive {
            self.tell(depth, What::Ends { why: "the direction carries nothing" });
            return Vec3::ZERO;
        }
        let keep = match vertex.chances {
            Some([_, on]) => Some(on),
            None if depth + 1 < ROULETTE_DEPTH => None,
            None => Some((beta.max_element() * ROULETTE_GAIN).min(1.0)),
        };
        if let Some(keep) = keep {
            if keep <= survive {
                self.tell(depth, What::Ends { why: "Russian roulette" });
                return Vec3::ZERO;
            }
            beta /= keep;
        }
        let ray = Ray {
            origin,
            direction: wi,
            key: key(self.seed, index, bsdf_set(depth)),
            beta,
            normal: vertex.facing(),
            weighted_pdf,
            index,
            medium,
            light_chance: vertex.chances.map_or(1.0, |[light, _]| light),
            time: vertex.time,
        };
        self.follow(&ray, depth + 1, &[(index, Toward::Drawn)], &[index])
    }
}
