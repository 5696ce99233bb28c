//! What happens along some paths of a wave, for `--replay-pixel`.

use std::collections::HashMap;
use std::fmt::{self, Display};
use std::ops::Range;

use glam::Vec3;

use crate::integrator::data::context::WaveContext;
use crate::integrator::data::path_states::clamp_contribution;
use crate::integrator::data::queues::{LightKind, PathRays, ShadowRays};
use crate::integrator::data::requests::RequestPacket;
use crate::integrator::data::vertices::Vertices;
use crate::integrator::events::{FoundEmission, PassedWall, PathEvents, ScatteredPacket};
use crate::integrator::stages::emission::mis_weight;
use crate::lanes::{NUMBERS, U, load_bits};
use crate::rays::{HitBatch, MISS};

/// An event along a path; `Display` prints it as one line.
#[derive(Debug, Clone, Copy)]
pub struct Event {
    /// Number of path segments before it.
    pub depth: u32,
    pub kind: EventKind,
}

/// The kinds of events. `radiance` is what is added to the path or, if it is `lent`, what leaves the second surface; `weight` is
/// the MIS weight.
#[derive(Debug, Clone, Copy)]
#[allow(missing_docs, reason = "the names say it")]
pub enum EventKind {
    Ray { origin: Vec3, direction: Vec3, beta: Vec3 },
    Escape,
    Hit { instance: u32, mesh: u32, material: u32, t: f32 },
    PassesWall { weight: Vec3, t: f32 },
    Emission { radiance: Vec3, weight: f32, lent: bool },
    Lends,
    LightSample { toward: &'static str, wi: Vec3, distance: f32, radiance: Vec3, occluded: bool, lent: bool },
    BsdfSample { wi: Vec3, pdf: f32 },
    NotFinite,
    Ends { reason: &'static str },
}

impl Display for Event {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let Self { depth, kind } = self;
        let indent = 2 * *depth as usize;
        write!(f, "{:indent$}", "")?;
        let if_lent = |lent: &bool| if *lent { " (lent)" } else { "" };
        match kind {
            EventKind::Ray { origin, direction, beta } => {
                write!(f, "{depth}: ray from {origin} toward {direction}, throughput {beta}")
            }
            EventKind::Escape => write!(f, "   escapes"),
            EventKind::Hit { instance, mesh, material, t } => {
                write!(f, "   hits instance {instance}, mesh {mesh}, material {material}, {t} away")
            }
            EventKind::PassesWall { weight, t } => write!(f, "   passes a thin wall {t} away, which leaves {weight}"),
            EventKind::Emission { radiance, weight, lent } => {
                write!(f, "   meets light: {radiance} (weight {weight}){}", if_lent(lent))
            }
            EventKind::Lends => write!(f, "   lends what it finds from here on (path re-use), with throughput 1"),
            EventKind::LightSample { toward, wi, distance, radiance, occluded, lent } => {
                let seen = if *occluded { " (occluded)" } else { if_lent(lent) };
                write!(f, "   light sample, {toward}, toward {wi}, {distance} away: {radiance}{seen}")
            }
            EventKind::BsdfSample { wi, pdf } => write!(f, "   BSDF sample toward {wi}, pdf {pdf}"),
            EventKind::NotFinite => write!(f, "   a sample is left out, whose radiance is not finite"),
            EventKind::Ends { reason } => write!(f, "   ends: {reason}"),
        }
    }
}

/// Keeps the events of the paths that are watched, a client of the wave.
#[derive(Debug, Default)]
pub struct PathLog {
    /// Their indices in the wave.
    watched: Range<u32>,
    /// By number of a ray of theirs.
    segments: HashMap<u32, Segment>,
    /// Path and depth of discarded samples.
    not_finite: Vec<(u32, u32)>,
    /// By watched path, its radiance, linear RGB.
    radiance: Vec<Vec3>,
}

/// What happens to a ray and at its end.
#[derive(Debug, Default)]
struct Segment {
    /// Up to the BSDF samples.
    events: Vec<EventKind>,
    /// Is light lent that it and those after it find from now on?
    lends: bool,
    ends: Option<&'static str>,
    /// Directions of BSDF samples and their densities, with the number of the next ray, or why there is none.
    samples: Vec<(Vec3, f32, Result<u32, &'static str>)>,
}

impl PathLog {
    /// A log of the paths of these indices in the wave.
    pub fn new(watched: Range<u32>) -> Self {
        Self { watched, ..Default::default() }
    }

    /// Radiance of a watched path, linear RGB.
    pub fn radiance(&self, path: u32) -> Vec3 {
        self.radiance[(path - self.watched.start) as usize]
    }

    /// The events of a watched path. Those of a BSDF sample's ray follow the sample; light samples come before BSDF samples.
    pub fn events(&self, path: u32) -> Vec<Event> {
        let mut events = Vec::new();
        // Camera rays are numbered like their paths.
        self.add(path, 0, &mut events);
        let of_path = self.not_finite.iter().filter(|(own, _)| *own == path);
        events.extend(of_path.map(|(_, depth)| Event { depth: *depth, kind: EventKind::NotFinite }));
        events
    }

    fn add(&self, ray: u32, depth: u32, all: &mut Vec<Event>) {
        let Some(Segment { events, ends, samples, .. }) = self.segments.get(&ray) else { return };
        let ends = ends.map(|reason| EventKind::Ends { reason });
        all.extend(events.iter().copied().chain(ends).map(|kind| Event { depth, kind }));
        for (wi, pdf, next) in samples {
            all.push(Event { depth, kind: EventKind::BsdfSample { wi: *wi, pdf: *pdf } });
            match *next {
                Ok(ray) => self.add(ray, depth + 1, all),
                Err(reason) => all.push(Event { depth, kind: EventKind::Ends { reason } }),
            }
        }
    }

    /// The segment of a ray by its row, if its path is watched.
    fn segment(&mut self, rays: &PathRays, row: usize) -> Option<&mut Segment> {
        let is_watched = self.watched.contains(&rays.path[row]);
        is_watched.then(|| self.segments.entry(rays.first + row as u32).or_default())
    }

    /// Rays have met surfaces, behind all walls that they pass.
    fn met(&mut self, at: &WaveContext, rays: &PathRays, hits: &HitBatch) {
        for row in 0..rays.len {
            let Some(segment) = self.segment(rays, row) else { continue };
            let (mesh, t) = (hits.mesh[row], hits.t[row]);
            if mesh == MISS {
                segment.events.push(EventKind::Escape);
                continue;
            }
            let material = at.transport.scene.meshes[mesh as usize].material;
            segment.events.push(EventKind::Hit { instance: hits.instance[row], mesh, material, t });
            let kind = at.transport.materials.mesh_material(mesh);
            segment.ends = match () {
                () if kind.unlit => Some("an unlit surface"),
                () if !rays.history(row).scatters(at.transport, at.depth) => Some("the largest depth"),
                () => kind.black.then_some("a black surface"),
            };
        }
    }

    fn found(&mut self, at: &WaveContext, rays: &PathRays, found: &FoundEmission) {
        let (row, lent) = (found.ray as usize, at.depth > 0 && self.is_lent(rays.first + found.ray));
        let path = rays.path[row];
        if !self.watched.contains(&path) {
            return;
        }
        let (radiance, weight) = (found.radiance, mis_weight(at, rays, row, found.pdf));
        let task = &at.tasks[at.pixel(path)];
        let emission_rays = at.transport.proposal.emission_rays.map_or(1, |rays| rays.rays_per_path(task.x, task.y));
        // Rays for emission alone have the numbers of other camera rays.
        let number = if at.depth == 0 { path } else { rays.first + found.ray };
        let events = &mut self.segments.entry(number).or_default().events;
        if at.depth == 0 && emission_rays > 1 {
            let (origin, direction) = (rays.rays.origin(row), rays.rays.direction(row));
            events.push(EventKind::Ray { origin, direction, beta: rays.beta.get(row) });
        }
        events.push(EventKind::Emission { radiance, weight, lent });
    }

    /// Is light lent that a ray finds, or the vertex at its end?
    fn is_lent(&self, ray: u32) -> bool {
        self.segments.get(&ray).is_some_and(|segment| segment.lends)
    }
}

impl PathEvents for PathLog {
    fn begin(&mut self, _at: &WaveContext) {
        self.segments.clear();
        self.not_finite.clear();
    }

    fn rays(&mut self, _at: &WaveContext, rays: &PathRays) {
        for row in 0..rays.len {
            let Some(segment) = self.segment(rays, row) else { continue };
            let (origin, direction) = (rays.rays.origin(row), rays.rays.direction(row));
            segment.events.push(EventKind::Ray { origin, direction, beta: rays.beta.get(row) });
        }
    }

    fn passed_wall(&mut self, _at: &WaveContext, rays: &PathRays, &PassedWall { row, weight, t }: &PassedWall) {
        let segment = self.segment(rays, row);
        segment.into_iter().for_each(|segment| segment.events.push(EventKind::PassesWall { weight, t }));
    }

    fn hits(&mut self, at: &WaveContext, rays: &PathRays, hits: &HitBatch) {
        if at.depth > 0 || !at.transport.materials.has_thin_walls {
            self.met(at, rays, hits);
        }
    }

    fn hits_behind_walls(&mut self, at: &WaveContext, rays: &PathRays, hits: &HitBatch) {
        self.met(at, rays, hits);
    }

    fn emission(&mut self, at: &WaveContext, rays: &PathRays, found: &FoundEmission) {
        self.found(at, rays, found);
    }

    fn lends(&mut self, _at: &WaveContext, ray: u32, goes_on: bool) {
        let Some(segment) = self.segments.get_mut(&ray) else { return };
        if goes_on {
            segment.lends = true;
            segment.events.push(EventKind::Lends);
        } else {
            segment.ends = Some("others go on for it (path re-use)");
        }
    }

    fn lent(&mut self, at: &WaveContext, rays: &PathRays, found: &FoundEmission) {
        self.found(at, rays, found);
    }

    fn scattered(&mut self, _at: &WaveContext, vertices: &Vertices, packet: &RequestPacket, samples: &ScatteredPacket) {
        let path = packet.path_ids.path.to_array();
        let arrived = load_bits(&vertices.ray, &packet.rows).to_array();
        let survivors = samples.survivors.compress_bits(U::from(NUMBERS)).to_array();
        let ended = samples.ended.to_bitmask();
        for lane in (0..packet.len).filter(|lane| self.watched.contains(&path[*lane])) {
            let number = survivors[..samples.survivors.len].iter().position(|own| *own == lane as u32);
            let next = match number {
                Some(number) => Ok(samples.first_ray + number as u32),
                None if ended >> lane & 1 == 1 => Err("Russian roulette"),
                None => Err("the direction carries nothing"),
            };
            let lends = self.is_lent(arrived[lane]);
            next.into_iter().for_each(|ray| self.segments.entry(ray).or_default().lends = lends);
            let sample = (samples.wi.lane(lane), samples.pdf[0].as_array()[lane], next);
            self.segments.entry(arrived[lane]).or_default().samples.push(sample);
        }
    }

    fn shadow_rays(&mut self, at: &WaveContext, shadows: &ShadowRays) {
        let limit = at.transport.limits[(at.depth > 0) as usize];
        for row in (0..shadows.len).filter(|row| self.watched.contains(&shadows.path[*row])) {
            let occluded = shadows.occluded[row];
            let (radiance, _) = clamp_contribution(shadows.radiance.get(row), limit);
            let toward = match shadows.kind(row) {
                LightKind::Environment => "environment",
                LightKind::Area => "area light",
                LightKind::Punctual => "punctual light",
                LightKind::Sized => "light with a size",
            };
            let (wi, distance) = (shadows.rays.direction(row), shadows.rays.tfar[row]);
            let segment = self.segments.entry(shadows.ray[row]).or_default();
            let radiance = if occluded { Vec3::ZERO } else { radiance };
            let lent = segment.lends;
            segment.events.push(EventKind::LightSample { toward, wi, distance, radiance, occluded, lent });
        }
    }

    fn not_finite(&mut self, at: &WaveContext, path: u32) {
        if self.watched.contains(&path) {
            self.not_finite.push((path, at.depth));
        }
    }

    fn end(&mut self, _at: &WaveContext, radiance: &[Vec3]) {
        self.radiance = radiance[self.watched.start as usize..self.watched.end as usize].to_vec();
    }
}
