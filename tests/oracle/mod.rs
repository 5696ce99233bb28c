//! A scalar path tracer, one path at a time: the reference for tests of the wave. It shares BSDFs, lights and sample sequences
//! with the wave, but not its queues, sorting and compaction, and knows no path re-use.

mod straight;

use bismar::balance::deal;
use bismar::bsdf::{Bsdf, Lobe, Parameters};
use bismar::color::luminance;
use bismar::guiding::NO_CELL;
use bismar::integrator::data::dimensions::{self, MAX_WALLS};
use bismar::integrator::data::history::{Bounces, MIRROR_PDF, RayHistory};
use bismar::integrator::data::path_states::clamp_contribution;
use bismar::integrator::data::requests::LightTarget;
use bismar::integrator::data::task::PixelTask;
use bismar::integrator::data::transport::Transport;
use bismar::integrator::stages::camera_rays::camera_ray;
use bismar::integrator::stages::mixture::{self, Mixture, MixtureSample};
use bismar::integrator::stages::requests::light_sample_index;
use bismar::integrator::stages::scatter::{ROULETTE_DEPTH, ROULETTE_GAIN};
use bismar::integrator::surface::dispersion;
use bismar::integrator::surface::shading_normal;
use bismar::integrator::through::emission_rays::emission_seed;
use bismar::integrator::through::thin_walls::{self, beyond, is_wall};
use bismar::lanes::{F, LANES, U, V3, unit_interval};
use bismar::light::{LightSampleContext, SizedLights, punctual};
use bismar::rays::{HitBatch, MISS, RayBatch};
use bismar::sampling::{PixelSequence, hash, keys, pixel_seed};
use glam::Vec3;

/// A ray along a path.
struct Ray {
    origin: Vec3,
    direction: Vec3,
    key: u32,
    /// Path throughput, linear RGB.
    beta: Vec3,
    /// Geometric normal at the origin, zero on surfaces that transmit.
    normal: Vec3,
    /// Density of the ray times BSDF samples per path.
    weighted_pdf: f32,
    /// Sample index in the pixel's sequence.
    index: u32,
    medium: u32,
    /// Roulette probability of the light sample at the origin.
    light_probability: f32,
    history: RayHistory,
    /// Time in [0, 1] of the shutter interval.
    time: f32,
}

impl Ray {
    /// Does it pass back faces ([`back_faces`](bismar::integrator::through::back_faces))?
    fn passes_backs(&self, transport: &Transport) -> bool {
        transport.culls() && self.history.is_mirror_image()
    }
}

/// A path vertex on a surface. Fields without a comment are those of [`Vertices`](bismar::integrator::data::vertices::Vertices).
struct Vertex {
    origin: Vec3,
    position: Vec3,
    ng: Vec3,
    ns: Vec3,
    wo: Vec3,
    beta: Vec3,
    bsdf: <Bsdf as Parameters>::Eight,
    transmits: bool,
    origin_offset: f32,
    /// Media on the side of `wo`, and beyond the surface.
    media: [u32; 2],
    /// Cell of the guiding field.
    cell: u32,
    /// Roulette probabilities of the light sample and of continuing the path, if the field sets them.
    roulette: Option<[f32; 2]>,
    /// History of the ray that arrived.
    history: RayHistory,
    /// Time in [0, 1] of the shutter interval.
    time: f32,
}

struct SpawnedRay {
    origin: Vec3,
    allowed: bool,
    medium: u32,
}

impl Vertex {
    fn spawn_ray(&self, wi: Vec3) -> SpawnedRay {
        let cos = self.ng.dot(wi);
        let beyond = self.transmits && cos < 0.0;
        let consistent = !self.transmits || cos * self.ns.dot(wi) > 0.0;
        SpawnedRay {
            origin: if beyond { self.origin - self.ng * (2.0 * self.origin_offset) } else { self.origin },
            allowed: (cos > 0.0 || beyond) && consistent,
            medium: self.media[usize::from(beyond)],
        }
    }

    fn is_smooth(&self) -> bool {
        let straight = self.bsdf.straight(V3::splat(self.ns), V3::splat(self.wo), F::ONE, true);
        straight.weight.lane(0).max_element() > 0.0
    }

    /// The history of a ray in this direction, which is sampled with these densities: of the mixture, of the BSDF.
    fn history_after(&self, transport: &Transport, wi: Vec3, [pdf, bsdf_pdf]: [F; 2]) -> RayHistory {
        let mask = |is_set: bool| if is_set { F::ZERO.simd_eq(F::ZERO) } else { F::ZERO };
        let smooth = transport.materials.has_smooth_bodies && self.is_smooth();
        let bounces = Bounces { pdf, bsdf_pdf, beyond: mask(self.ng.dot(wi) < 0.0), smooth: mask(smooth) };
        RayHistory(RayHistory::after(U::splat(self.history.0), transport, &bounces).to_array()[0])
    }

    /// The normal for light selection: zero on surfaces that transmit.
    fn light_sampling_normal(&self) -> Vec3 {
        if self.transmits { Vec3::ZERO } else { self.ng }
    }
}

struct Tracer<'a> {
    transport: &'a Transport<'a>,
    sequence: PixelSequence,
    seed: u32,
    /// Samples per path at the first surface: environment, area lights, BSDF.
    samples_per_path: [f32; 3],
    /// Do other camera rays find the emission that the camera sees directly ([`emission_rays`](bismar::integrator::through::emission_rays))?
    skips_visible_emission: bool,
}

/// Radiance of path number `path` of those that a wave takes for a pixel.
pub fn trace(transport: &Transport, task: &PixelTask, path: u32) -> Vec3 {
    let paths = task.counts.paths;
    let index = task.first_path + path;
    let emission_rays = transport.proposal.emission_rays.map_or(1, |rays| rays.rays_per_path(task.x, task.y));
    let mut emission = Vec3::ZERO;
    if emission_rays > 1 {
        let seed = emission_seed(transport.seed);
        let alone = Transport { seed, max_depth: 1, ..transport.clone() };
        for index in (0..emission_rays).map(|i| index * emission_rays + i) {
            let (tracer, ray) = Tracer::camera_ray(&alone, task, index);
            let ray = Ray { beta: Vec3::splat(1.0 / emission_rays as f32), ..ray };
            emission += tracer.trace_ray(&ray, 0, &[], &[]);
        }
    }
    let (mut tracer, ray) = Tracer::camera_ray(transport, task, index);
    tracer.skips_visible_emission = emission_rays > 1;
    let before = |n: u32| (0..path).map(|p| u32::from(deal(n, paths, p))).sum::<u32>();
    let numbers = |first: u32, n: u32| {
        let start = first + before(n);
        start..start + u32::from(deal(n, paths, path))
    };
    let light = numbers(task.first_light, task.counts.light).map(|number| light_sample_index(task, number));
    let bsdf = numbers(task.first_bsdf, task.counts.bsdf);
    emission + tracer.trace_ray(&ray, 0, &light.collect::<Vec<_>>(), &bsdf.collect::<Vec<_>>())
}

fn key(seed: u32, index: u32, set: u32) -> u32 {
    keys(U::splat(seed), U::splat(index), set).to_array()[0]
}

impl<'a> Tracer<'a> {
    /// Camera ray number `index` of a pixel.
    fn camera_ray(transport: &'a Transport<'a>, task: &PixelTask, index: u32) -> (Self, Ray) {
        let sequence = PixelSequence::new(task.x, task.y, transport.seed);
        let seed = pixel_seed(task.x, task.y, transport.seed);
        let ((origin, direction), time) = camera_ray(transport, [task.x, task.y], U::splat(seed), U::splat(index));
        let samples_per_path = task.weighed.samples_per_path(transport.proposal.lights.environment_probability);
        let tracer = Self { transport, sequence, seed, samples_per_path, skips_visible_emission: false };
        let ray = Ray {
            origin: origin.lane(0),
            direction: direction.lane(0),
            key: key(seed, index, dimensions::CAMERA),
            beta: Vec3::ONE,
            normal: Vec3::ZERO,
            weighted_pdf: 0.0,
            index,
            medium: 0,
            light_probability: 1.0,
            history: RayHistory::CAMERA,
            time: time.as_array()[0],
        };
        (tracer, ray)
    }

    /// Radiance along a ray; where it hits, takes these light samples (index, target) and BSDF samples (index).
    fn trace_ray(&self, ray: &Ray, depth: u32, light: &[(u32, LightTarget)], bsdf: &[u32]) -> Vec3 {
        let t = self.transport;
        let Ray { origin, direction, .. } = *ray;
        let (mut rays, mut hits) = (RayBatch::default(), HitBatch::default());
        let (near, far) = match depth {
            0 => t.camera.intervals(V3::splat(direction), F::splat(ray.time)),
            _ => (F::ZERO, F::splat(f32::INFINITY)),
        };
        rays.push(origin, direction, near.as_array()[0], far.as_array()[0], ray.key);
        rays.time.extend(t.geometry.moves.then_some(ray.time));
        let passes_backs = ray.passes_backs(t);
        self.closest_hit(&rays, passes_backs, &mut hits);
        let (mut beta, mut walls, mut last_wall) = (ray.beta, 0, None);
        while is_wall(t, hits.mesh[0]) {
            if walls == MAX_WALLS {
                return Vec3::ZERO;
            }
            if last_wall != Some(hits.primitive(0)) {
                let passages = self.passages(&hits, direction, ray.time, false);
                let number = thin_walls::numbers(U::splat(self.seed), U::splat(ray.index), depth, walls).as_array()[0];
                let (passes, factor) = passages.draw(F::splat(number));
                beta *= factor.lane(0);
                if passes.to_bitmask() & 1 == 0 {
                    break;
                }
            }
            last_wall = Some(hits.primitive(0));
            walls += 1;
            rays.tnear[0] = beyond(hits.t[0]);
            self.closest_hit(&rays, passes_backs, &mut hits);
        }
        let sized = self.sized_lights(ray, depth);
        let ray = &Ray { beta, ..*ray };
        let behind = if t.passes_bodies() { self.straight_behind_bodies(ray, depth, &hits) } else { Vec3::ZERO };
        let straight = sized + behind;
        let (medium, distance) = match depth {
            0 if hits.mesh[0] != MISS && t.materials.tracks_media => {
                let near = near.as_array()[0];
                let (media, from) = t.media_at_camera((origin, direction), near, ray.time, &mut None);
                let back_facing = t.point(&rays, &hits, 0).is_back_facing(direction);
                (t.materials.media_at_surface(hits.mesh[0], back_facing, media)[0], hits.t[0] - from)
            }
            _ => (ray.medium, hits.t[0]),
        };
        let left = if hits.mesh[0] == MISS { Vec3::ONE } else { t.materials.media.transmittance(medium, distance) };
        let ray = &Ray { beta: ray.beta * left, medium, ..*ray };
        let emission = self.emission_at(ray, depth, &hits, walls > 0);
        let ends = hits.mesh[0] == MISS || t.materials.mesh_material(hits.mesh[0]).unlit;
        if ends || !ray.history.scatters(t, depth) {
            return straight + emission;
        }
        let vertex = self.vertex(ray, depth, &hits);
        let mut sum = straight + emission;
        for &(index, toward) in light {
            sum += self.light_sample(&vertex, depth, index, toward);
        }
        if t.lights.punctual {
            sum += self.punctual_sample(&vertex, depth, ray.index);
        }
        for &index in bsdf {
            sum += self.bsdf_sample(&vertex, depth, index);
        }
        sum
    }

    /// Emission at the end of a ray, whose throughput is that at the hit.
    fn emission_at(&self, ray: &Ray, depth: u32, hits: &HitBatch, passed_wall: bool) -> Vec3 {
        let t = self.transport;
        let Ray { origin, direction, .. } = *ray;
        let excluded = ray.history.is_refracted();
        let (hit, distance) = (hits.primitive(0), hits.t[0]);
        if hit.mesh == MISS {
            if excluded || t.lights.environment.is_none() || (depth == 0 && !passed_wall && t.hides_environment) {
                return Vec3::ZERO;
            }
            let (radiance, pdf) = t.lights.environment(V3::splat(direction), &t.proposal.lights);
            let pdf = if depth == 0 { 0.0 } else { pdf.as_array()[0] };
            return self.emission(ray, depth, radiance.lane(0), [pdf, 0.0]);
        }
        let point = t.geometry.point(t.scene, hit, (hits.u[0], hits.v[0]), ray.time);
        if point.material.unlit {
            // It is seen, but gives no light.
            let seen = ray.history.is_mirror_image();
            return if seen { self.emission(ray, depth, point.base_color(t.scene), [0.0; 2]) } else { Vec3::ZERO };
        }
        if !t.materials.mesh_material(hit.mesh).emits || !point.emits_against(direction) || excluded {
            return Vec3::ZERO;
        }
        let radiance = point.emitted_radiance(t.scene, direction);
        let (from, at) = ((origin, ray.normal), (t.scene, ray.time));
        let pdf = match depth {
            0 => 0.0,
            _ => t.lights.area_pdf(at, from, hit, direction, distance, &t.proposal.lights),
        };
        self.emission(ray, depth, radiance, [0.0, pdf])
    }

    /// The vertex where a ray hits a surface.
    fn vertex(&self, ray: &Ray, depth: u32, hits: &HitBatch) -> Vertex {
        let t = self.transport;
        let direction = ray.direction;
        let point = t.geometry.point(t.scene, hits.primitive(0), (hits.u[0], hits.v[0]), ray.time);
        // Normals are turned to the side of wo.
        let wo = -direction;
        let front = point.ng.normalize_or(wo);
        let side = if front.dot(wo) < 0.0 { -1.0 } else { 1.0 };
        let ng = front * side;
        let ns = point.ns.normalize_or(front) * side;
        let ns = shading_normal::consistent(V3::splat(ng), V3::splat(ns), V3::splat(wo)).lane(0);
        let [color, ..] = self.sequence.sample(ray.index, dimensions::CHANNEL);
        let (seen, beta) =
            dispersion::sample_channel(point.surface_from(t.scene, direction), point.material, ray.beta, color);
        let media = match t.materials.tracks_media {
            true => {
                let at = (point.position, point.ng, point.origin_offset);
                t.media_at_hit(hits.primitive(0), ray.medium, (direction, ray.time), at)
            }
            false => [0; 2],
        };
        let surface = t.materials.relative(seen, hits.mesh[0], media).bsdf();
        let scattering = Bsdf::gather([&surface; LANES]);
        let origin = point.position + ng * point.origin_offset;
        let cells = t.proposal.field.map(|field| (field, field.cells_at(V3::splat(origin), V3::splat(ng))));
        let luminances = F::splat(luminance(beta));
        let roulette =
            cells.filter(|_| depth > 0).and_then(|(field, cells)| field.roulette_probabilities(cells, luminances));
        Vertex {
            origin,
            position: point.position,
            ng,
            ns,
            wo,
            beta,
            bsdf: scattering,
            transmits: scattering.transmits().any(),
            origin_offset: point.origin_offset,
            media,
            cell: cells
                .filter(|_| mixture::is_diffuse(&scattering).any())
                .map_or(NO_CELL, |(field, cells)| field.guiding_cells(cells)[0]),
            roulette: roulette.map(|roulette| roulette.map(|probability| probability.as_array()[0])),
            history: ray.history,
            time: ray.time,
        }
    }

    fn mixture(&self, vertex: &Vertex) -> Option<Mixture<'_>> {
        Mixture::new(self.transport.proposal.field?, [vertex.cell; LANES])
    }

    /// Samples per path of each technique at the vertex at `depth`.
    fn samples_per_path(&self, depth: u32) -> [f32; 3] {
        if depth == 0 { self.samples_per_path } else { self.transport.deeper_samples_per_path() }
    }

    /// Light of the lights with a size that a ray hits.
    fn sized_lights(&self, ray: &Ray, depth: u32) -> Vec3 {
        let t = self.transport;
        let (mut sum, from) = (Vec3::ZERO, (ray.origin, ray.normal));
        let count = t.lights.sized.as_ref().map_or(0, SizedLights::count);
        for index in (0..count).filter(|_| depth > 0 && !ray.history.is_refracted()) {
            let Some(hit) = t.lights.sized_hit(t.scene, index, from, ray.direction, ray.time) else { continue };
            let medium = if t.passes_bodies() { 0 } else { ray.medium };
            let mut to_light = RayBatch::default();
            to_light.push(ray.origin, ray.direction, 0.0, hit.end, ray.key);
            to_light.time.extend(t.geometry.moves.then_some(ray.time));
            let passes = [ray.history.is_rough(), ray.passes_backs(t)];
            let left =
                t.materials.media.transmittance(medium, hit.distance) * self.unoccluded(to_light, passes, ray.medium);
            sum += self.emission(&Ray { beta: ray.beta * left, ..*ray }, depth, hit.radiance, [0.0, hit.pdf]);
        }
        sum
    }

    /// Emission that a ray hits, with the MIS weight for light-sample densities `pdf` (environment, area lights).
    fn emission(&self, ray: &Ray, depth: u32, radiance: Vec3, pdf: [f32; 2]) -> Vec3 {
        if depth == 0 && self.skips_visible_emission {
            return Vec3::ZERO;
        }
        let samples_per_path = self.samples_per_path(depth.saturating_sub(1));
        let weighted_light = ray.light_probability * (samples_per_path[0] * pdf[0] + samples_per_path[1] * pdf[1]);
        let weight = match weighted_light > 0.0 {
            true => self.transport.heuristic.weight(ray.weighted_pdf, weighted_light),
            false => 1.0,
        };
        let radiance = ray.beta * radiance * weight;
        let radiance = if radiance.is_finite() { radiance } else { Vec3::ZERO };
        let limit = if depth == 0 { f32::INFINITY } else { self.transport.limits[(depth > 1) as usize] };
        clamp_contribution(radiance, limit).0
    }

    fn light_sample(&self, vertex: &Vertex, depth: u32, index: u32, toward: LightTarget) -> Vec3 {
        let t = self.transport;
        if !t.lights.has_extent() {
            return Vec3::ZERO;
        }
        let probability = vertex.roulette.map_or(1.0, |[light, _]| light);
        let [a_env, a_area, a_b] = self.samples_per_path(depth);
        let number = unit_interval(U::splat(key(self.seed, index, dimensions::roulette(depth)))).as_array()[0];
        if vertex.roulette.is_some() && number >= probability {
            return Vec3::ZERO;
        }
        let [choice, u, v, _] = self.sequence.sample(index, dimensions::light(depth));
        let (drawn, left) = t.proposal.lights.draw_kind(F::splat(choice));
        let environment = match toward {
            LightTarget::Random => drawn.to_bitmask() & 1 == 1,
            toward => toward == LightTarget::Environment,
        };
        let choice = if toward == LightTarget::Random { left } else { F::splat(choice) };
        let mask = if environment { F::ZERO.simd_eq(F::ZERO) } else { F::ZERO };
        let context = LightSampleContext {
            scene: t.scene,
            time: F::splat(vertex.time),
            p: V3::splat(vertex.origin),
            origin_error: F::splat(if vertex.transmits { 2.0 * vertex.origin_offset } else { 0.0 }),
            n: V3::splat(vertex.light_sampling_normal()),
        };
        let light = t.lights.sample(&context, mask, &t.proposal.lights, [choice, F::splat(u), F::splat(v)]);
        let (value, own_pdf) = vertex.bsdf.eval_pdf(V3::splat(vertex.ns), V3::splat(vertex.wo), light.wi);
        let mut bsdf_pdf = own_pdf;
        if let Some(mixture) = self.mixture(vertex) {
            bsdf_pdf = mixture.pdf(light.wi, bsdf_pdf);
        }
        let [pdf, bsdf_pdf, distance, end] = [light.pdf, bsdf_pdf, light.distance, light.end].map(|x| x.as_array()[0]);
        let (wi, value, emitted) = (light.wi.lane(0), value.lane(0), light.radiance.lane(0));
        let weighted_pdf = probability * if environment { a_env } else { a_area } * pdf;
        let weight = t.heuristic.weight(weighted_pdf, a_b * bsdf_pdf);
        let radiance = vertex.beta * value * emitted * (weight / weighted_pdf);
        let radiance = if pdf > 0.0 { radiance } else { Vec3::ZERO };
        let pdfs = [bsdf_pdf, own_pdf.as_array()[0]];
        self.shadow_ray(vertex, depth, index, (wi, [distance, end], pdfs), radiance)
    }

    fn punctual_sample(&self, vertex: &Vertex, depth: u32, index: u32) -> Vec3 {
        let [.., choice] = self.sequence.sample(index, dimensions::light(depth));
        let sample = punctual::choose(&self.transport.scene.lights, vertex.position, choice, vertex.time);
        let Some(light) = sample else { return Vec3::ZERO };
        let (ns, wo) = (V3::splat(vertex.ns), V3::splat(vertex.wo));
        let (value, bsdf_pdf) = vertex.bsdf.eval_pdf(ns, wo, V3::splat(light.wi));
        let bsdf_pdf = bsdf_pdf.as_array()[0];
        let radiance = vertex.beta * value.lane(0) * light.irradiance;
        let ends = [light.distance, light.end(vertex.position)];
        self.shadow_ray(vertex, depth, index, (light.wi, ends, [bsdf_pdf; 2]), radiance)
    }

    /// Traces a shadow ray: the clamped contribution, or zero if it is occluded, not finite or below the horizon. The densities are
    /// that of BSDF samples in its direction, and that of the BSDF alone.
    fn shadow_ray(
        &self,
        vertex: &Vertex,
        depth: u32,
        index: u32,
        (wi, [distance, end], [bsdf_pdf, own_pdf]): (Vec3, [f32; 2], [f32; 2]),
        radiance: Vec3,
    ) -> Vec3 {
        let SpawnedRay { origin, allowed, medium } = vertex.spawn_ray(wi);
        let passes_bodies = self.transport.passes_bodies();
        let absorbing = if passes_bodies { 0 } else { medium };
        let radiance = radiance * self.transport.materials.media.transmittance(absorbing, distance);
        let refracted = vertex.ng.dot(wi) < 0.0 && bsdf_pdf >= MIRROR_PDF && vertex.is_smooth();
        let excluded = vertex.history.is_after_rough() && refracted;
        let contributes = allowed && !excluded && radiance.max_element() > 0.0 && radiance.is_finite();
        if !contributes {
            return Vec3::ZERO;
        }
        let mut rays = RayBatch::default();
        let key = hash(key(self.seed, index, dimensions::light(depth)));
        rays.push(origin, wi, 0.0, end, key);
        rays.time.extend(self.transport.geometry.moves.then_some(vertex.time));
        let backs = self.transport.culls() && vertex.history.is_mirror_image() && own_pdf >= MIRROR_PDF;
        let radiance = radiance * self.unoccluded(rays, [bsdf_pdf < MIRROR_PDF, backs], medium);
        clamp_contribution(radiance, self.transport.limits[(depth > 0) as usize]).0
    }

    fn bsdf_sample(&self, vertex: &Vertex, depth: u32, index: u32) -> Vec3 {
        let [lobe, u, v, survive] = self.sequence.sample(index, dimensions::bsdf(depth));
        let (ns, wo) = (V3::splat(vertex.ns), V3::splat(vertex.wo));
        let numbers = [lobe, u, v].map(F::splat);
        let mixture = self.mixture(vertex);
        let MixtureSample { sample, pdfs } = mixture::sample(mixture.as_ref(), &vertex.bsdf, ns, wo, numbers);
        let (wi, value, pdf) = (sample.wi.lane(0), sample.value.lane(0), sample.pdf.as_array()[0]);
        let weighted_pdf = self.samples_per_path(depth)[2] * pdf;
        let mut beta = vertex.beta * value / weighted_pdf;
        let SpawnedRay { origin, allowed, medium } = vertex.spawn_ray(wi);
        let alive = pdf > 0.0 && allowed && beta.max_element() > 0.0 && beta.is_finite();
        if !alive {
            return Vec3::ZERO;
        }
        let keep = match vertex.roulette {
            Some([_, on]) => Some(on),
            None if depth + 1 < ROULETTE_DEPTH => None,
            None => Some((beta.max_element() * ROULETTE_GAIN).min(1.0)),
        };
        if let Some(keep) = keep {
            if keep <= survive {
                return Vec3::ZERO;
            }
            beta /= keep;
        }
        let ray = Ray {
            origin,
            direction: wi,
            key: key(self.seed, index, dimensions::bsdf(depth)),
            beta,
            normal: vertex.light_sampling_normal(),
            weighted_pdf,
            index,
            medium,
            light_probability: vertex.roulette.map_or(1.0, |[light, _]| light),
            history: vertex.history_after(self.transport, wi, [sample.pdf, pdfs[0]]),
            time: vertex.time,
        };
        self.trace_ray(&ray, depth + 1, &[(index, LightTarget::Random)], &[index])
    }
}
