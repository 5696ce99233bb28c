//! Which samples vertices take: as many as their path was dealt at first surfaces, one of each technique elsewhere, or no light
//! sample where a field's roulette says so.

use super::super::batch::PixelTask;
use super::{light_set, roll_set};
use crate::integrator::Transport;
use crate::integrator::path_states::PathStates;
use crate::integrator::queues::Identity;
use crate::integrator::vertices::Vertices;
use crate::lanes::{F, LANES, NUMBERS, Rows, U, are, eight, mask, unit_interval};
use crate::sampling::{keys, samples};

/// What a light sample is toward.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Toward {
    /// Not known before it draws.
    Drawn,
    /// The environment, by count.
    Environment,
    /// An area light, by count.
    AreaLight,
}

/// A sample to take.
#[derive(Debug, Clone, Copy)]
struct Request {
    vertex: u32,
    /// Which point of its pixel's sequence it is.
    index: u32,
    toward: Toward,
}

/// The samples that a batch of vertices takes of a technique.
#[derive(Debug, Default)]
pub struct Requests {
    list: Vec<Request>,
    /// While the list is parted: those that come last.
    later: Vec<Request>,
    /// Is the list meant? Else one sample at each vertex.
    listed: bool,
    /// Are the vertices first surfaces, whose path knows the rates?
    first: bool,
    len: usize,
}

/// Up to eight samples to take.
pub struct RequestGroup {
    /// At which vertices.
    pub rows: Rows,
    /// Of which path, and which point of its pixel's sequence each one is.
    pub identity: Identity,
    /// What light samples are toward: [`Toward`] as a number.
    pub toward: U,
    /// How many count.
    pub len: usize,
    /// Samples a path: toward the environment, toward area lights, of the BSDF.
    pub rates: [F; 3],
}

/// Area lights have a sequence of their own where light samples are divided: its points are numbered from here.
pub const AREA_SEQUENCE: u32 = 1 << 31;

impl Requests {
    /// How many samples.
    pub fn count(&self) -> usize {
        self.len
    }

    /// Light samples of the vertices at `depth` (0 for first surfaces).
    pub fn light_samples(
        &mut self,
        transport: &Transport,
        depth: u32,
        vertices: &Vertices,
        path_states: &PathStates,
        tasks: &[PixelTask],
    ) {
        self.begin(depth, vertices);
        if depth > 0 && transport.has_roulette() {
            self.roll(transport, depth, vertices);
        }
        for (vertex, path) in (0..).zip(&vertices.path[..if self.first { vertices.len() } else { 0 }]) {
            let path = &path_states.paths[*path as usize];
            let task = &tasks[path.pixel as usize];
            for number in path.first_light..path.first_light + u32::from(path.light) {
                let (index, toward) = light_sample(task, number);
                self.list.push(Request { vertex, index, toward });
            }
        }
        if transport.lights.two_kinds() {
            self.part(transport, depth, vertices);
        }
        self.end();
    }

    /// Puts the light samples toward the environment before those toward area lights: a mixed eight costs as much as one
    /// of each kind.
    fn part(&mut self, transport: &Transport, depth: u32, vertices: &Vertices) {
        if !self.listed {
            self.listed = true;
            let each = (0..).zip(&vertices.index[..vertices.len()]);
            self.list.extend(each.map(|(vertex, &index)| Request { vertex, index, toward: Toward::Drawn }));
        }
        self.later.clear();
        let mut kept = 0;
        for at in (0..self.list.len()).step_by(LANES) {
            let (request, len) = self.eight_from(at);
            let seed = U::from(eight(|lane| vertices.seed[request[lane].vertex as usize]));
            let index = U::from(eight(|lane| request[lane].index));
            let toward = U::from(eight(|lane| request[lane].toward as u32));
            let [choice, ..] = samples(seed, index, light_set(depth));
            let (environment, _) = toward_environment(transport, toward, choice);
            let environment = environment.to_bitmask();
            for (lane, &request) in request[..len].iter().enumerate() {
                if environment >> lane & 1 == 1 {
                    self.list[kept] = request;
                    kept += 1;
                } else {
                    self.later.push(request);
                }
            }
        }
        self.list.truncate(kept);
        self.list.extend_from_slice(&self.later);
    }

    /// BSDF samples of the vertices at `depth`; none where paths end.
    pub fn bsdf_samples(&mut self, depth: u32, max_depth: u32, vertices: &Vertices, path_states: &PathStates) {
        self.begin(depth, vertices);
        if depth + 1 >= max_depth {
            self.len = 0;
            return;
        }
        for (vertex, path) in (0..).zip(&vertices.path[..if self.first { vertices.len() } else { 0 }]) {
            let path = &path_states.paths[*path as usize];
            let all = path.first_bsdf..path.first_bsdf + u32::from(path.bsdf);
            self.list.extend(all.map(|index| Request { vertex, index, toward: Toward::Drawn }));
        }
        self.end();
    }

    fn begin(&mut self, depth: u32, vertices: &Vertices) {
        self.list.clear();
        self.first = depth == 0;
        self.listed = self.first;
        self.len = vertices.len();
    }

    /// Lists the vertices that are to take a light sample, by their chances.
    fn roll(&mut self, transport: &Transport, depth: u32, vertices: &Vertices) {
        self.listed = true;
        for at in (0..vertices.len()).step_by(LANES) {
            let rows = Rows::From(at);
            let Some([chance, _]) = vertices.chances(transport, &rows) else { continue };
            let id = vertices.identity(&rows);
            let number = unit_interval(keys(id.seed, id.index, roll_set(depth)));
            let taken = (number.simd_lt(chance) & mask(LANES.min(vertices.len() - at))).to_bitmask();
            let lanes = (0..LANES).filter(|lane| taken >> lane & 1 == 1);
            self.list.extend(lanes.map(|lane| Request {
                vertex: (at + lane) as u32,
                index: id.index.as_array()[lane],
                toward: Toward::Drawn,
            }));
        }
    }

    fn end(&mut self) {
        if self.listed {
            self.len = self.list.len();
        }
    }

    /// The samples from `at` on.
    #[inline(always)]
    pub fn group(
        &self,
        transport: &Transport,
        vertices: &Vertices,
        path_states: &PathStates,
        at: usize,
    ) -> RequestGroup {
        if !self.listed {
            return one_each(transport, vertices, at);
        }
        let (request, len) = self.eight_from(at);
        let vertex = eight(|lane| request[lane].vertex);
        let consecutive = U::from(vertex).simd_eq(U::splat(vertex[0]) + U::from(NUMBERS)) == U::MAX;
        let rows = if consecutive { Rows::From(vertex[0] as usize) } else { Rows::Each(vertex) };
        let rates = if self.first {
            // By vertex: beyond the last request columns hold whatever an earlier wave left there.
            let paths = eight(|lane| &path_states.paths[vertices.path[vertex[lane] as usize] as usize]);
            [0, 1, 2].map(|t| F::from(eight(|lane| paths[lane].rates[t])))
        } else {
            let [a_env, a_area, a_b] = transport.deeper_rates().map(F::splat);
            let chance = vertices.chances(transport, &rows).map_or(F::ONE, |[light, _]| light);
            [chance * a_env, chance * a_area, a_b]
        };
        RequestGroup {
            identity: Identity { index: U::from(eight(|lane| request[lane].index)), ..vertices.identity(&rows) },
            toward: U::from(eight(|lane| request[lane].toward as u32)),
            len,
            rates,
            rows,
        }
    }

    /// Eight of the list from `at` on, the last of them in spare lanes, and how many there are.
    #[inline(always)]
    fn eight_from(&self, at: usize) -> ([Request; LANES], usize) {
        let list = &self.list[at..self.list.len().min(at + LANES)];
        let group = match list.first_chunk() {
            Some(all) => *all,
            None => eight(|lane| list[lane.min(list.len() - 1)]),
        };
        (group, list.len())
    }
}

/// Which of eight light samples go to the environment, as a mask, and the number that chooses among area lights, where
/// `choice` is the first of the samples' own.
#[inline(always)]
pub fn toward_environment(transport: &Transport, toward: U, choice: F) -> (F, F) {
    let (drawn, left) = transport.lights.draw_kind(choice);
    let draws = are(toward, Toward::Drawn as u32);
    (are(toward, Toward::Environment as u32) | (draws & drawn), draws.select(left, choice))
}

/// One sample at each of the vertices from `at` on.
#[inline(always)]
pub fn one_each(transport: &Transport, vertices: &Vertices, at: usize) -> RequestGroup {
    let rows = Rows::From(at);
    RequestGroup {
        identity: vertices.identity(&rows),
        toward: U::splat(Toward::Drawn as u32),
        len: LANES.min(vertices.len() - at),
        rates: transport.deeper_rates().map(F::splat),
        rows,
    }
}

/// The point in its technique's sequence of light sample `number` of a pixel, and what it is toward: where they are
/// divided, the first ones of a wave go to the environment.
pub fn light_sample(task: &PixelTask, number: u32) -> (u32, Toward) {
    let Some(environment) = task.counts.environment else { return (number, Toward::Drawn) };
    let area_before = task.first_light - task.first_environment;
    let area_from = task.first_light + environment;
    if number < area_from {
        return (number - area_before, Toward::Environment);
    }
    (AREA_SEQUENCE | (number - area_from + area_before), Toward::AreaLight)
}
