//! Sample requests: which vertices take which samples. First surfaces take the samples that their path was allocated; later
//! vertices take one sample of each technique, with roulette for the light sample if a guiding field sets its probability.

use crate::integrator::data::dimensions::{self, AREA_LIGHT_INDEX};
use crate::integrator::data::path_states::PathState;
use crate::integrator::data::queues::PathIds;
use crate::integrator::data::requests::{LightTarget, RequestPacket};
use crate::integrator::data::task::PixelTask;
use crate::integrator::data::transport::Transport;
use crate::integrator::data::vertices::Vertices;
use crate::lanes::{F, LANES, NUMBERS, Rows, U, are, eight, mask, unit_interval};
use crate::sampling::{keys, samples};

/// A sample that a vertex takes.
#[derive(Debug, Clone, Copy)]
struct SampleRequest {
    vertex: u32,
    /// Sample index in the pixel's sequence.
    index: u32,
    target: LightTarget,
}

impl SampleRequest {
    /// The sample that a vertex takes with the index of its path, of any light.
    fn of(vertices: &Vertices, row: usize) -> Self {
        Self { vertex: row as u32, index: vertices.index[row], target: LightTarget::Random }
    }
}

/// The samples of one technique that a batch of vertices takes.
#[derive(Debug, Default)]
pub struct Requests {
    list: Vec<SampleRequest>,
    /// Scratch space of [`Self::partition_by_target`]: samples of area lights.
    area_light_samples: Vec<SampleRequest>,
    /// Is `list` used? Else each vertex takes one sample.
    uses_list: bool,
    at_first_surface: bool,
    len: usize,
}

impl Requests {
    pub fn count(&self) -> usize {
        self.len
    }

    /// Requests the light samples of the vertices at `depth` (0 for first surfaces).
    pub fn light_samples(
        &mut self,
        transport: &Transport,
        depth: u32,
        vertices: &Vertices,
        paths: &[PathState],
        tasks: &[PixelTask],
    ) {
        self.begin(depth, vertices);
        if depth > 0 && transport.proposal.has_roulette() {
            self.play_roulette(transport, depth, vertices);
        }
        for (vertex, path) in (0..).zip(&vertices.path[..if self.at_first_surface { vertices.len() } else { 0 }]) {
            let path = &paths[*path as usize];
            let task = &tasks[path.pixel as usize];
            for number in path.first_light..path.first_light + u32::from(path.light) {
                let (index, target) = light_sample_index(task, number);
                self.list.push(SampleRequest { vertex, index, target });
            }
        }
        if transport.lights.two_kinds() {
            self.partition_by_target(transport, depth, vertices);
        }
        self.end();
    }

    /// Orders light samples of the environment before those of area lights: a mixed packet of eight costs as much as one of
    /// each kind.
    fn partition_by_target(&mut self, transport: &Transport, depth: u32, vertices: &Vertices) {
        if !self.uses_list {
            self.uses_list = true;
            self.list.extend((0..vertices.len()).map(|row| SampleRequest::of(vertices, row)));
        }
        self.area_light_samples.clear();
        let mut kept = 0;
        for at in (0..self.list.len()).step_by(LANES) {
            let (request, len) = self.eight_from(at);
            let seed = U::from(eight(|lane| vertices.seed[request[lane].vertex as usize]));
            let index = U::from(eight(|lane| request[lane].index));
            let target = U::from(eight(|lane| request[lane].target as u32));
            let [choice, ..] = samples(seed, index, dimensions::light(depth));
            let (environment, _) = select_environment(transport, target, choice);
            let environment = environment.to_bitmask();
            for (lane, &request) in request[..len].iter().enumerate() {
                if environment >> lane & 1 == 1 {
                    self.list[kept] = request;
                    kept += 1;
                } else {
                    self.area_light_samples.push(request);
                }
            }
        }
        self.list.truncate(kept);
        self.list.extend_from_slice(&self.area_light_samples);
    }

    /// Requests the BSDF samples of the vertices at `depth`.
    pub(crate) fn bsdf_samples(&mut self, depth: u32, vertices: &Vertices, paths: &[PathState]) {
        self.begin(depth, vertices);
        for (vertex, path) in (0..).zip(&vertices.path[..if self.at_first_surface { vertices.len() } else { 0 }]) {
            let path = &paths[*path as usize];
            let indices = path.first_bsdf..path.first_bsdf + u32::from(path.bsdf);
            self.list.extend(indices.map(|index| SampleRequest { vertex, index, target: LightTarget::Random }));
        }
        self.end();
    }

    fn begin(&mut self, depth: u32, vertices: &Vertices) {
        self.list.clear();
        self.at_first_surface = depth == 0;
        self.uses_list = self.at_first_surface;
        self.len = vertices.len();
        if !vertices.ended.is_empty() {
            self.uses_list = true;
            let rows = (0..vertices.len()).filter(|row| !vertices.ended[*row]);
            self.list.extend(rows.map(|row| SampleRequest::of(vertices, row)));
        }
    }

    /// Lists the vertices whose light sample survives roulette.
    fn play_roulette(&mut self, transport: &Transport, depth: u32, vertices: &Vertices) {
        self.uses_list = true;
        self.list.clear();
        let ended = |row: usize| vertices.ended.get(row).is_some_and(|ended| *ended);
        for at in (0..vertices.len()).step_by(LANES) {
            let rows = Rows::From(at);
            let Some([probability, _]) = vertices.roulette(transport, &rows) else { continue };
            let id = vertices.path_ids(&rows);
            let number = unit_interval(keys(id.seed, id.index, dimensions::roulette(depth)));
            let taken = (number.simd_lt(probability) & mask(LANES.min(vertices.len() - at))).to_bitmask();
            let lanes = (0..LANES).filter(|lane| taken >> lane & 1 == 1 && !ended(at + lane));
            self.list.extend(lanes.map(|lane| SampleRequest::of(vertices, at + lane)));
        }
    }

    fn end(&mut self) {
        if self.uses_list {
            self.len = self.list.len();
        }
    }

    /// Up to eight samples from number `at` on.
    #[inline(never)]
    pub fn packet(&self, transport: &Transport, vertices: &Vertices, paths: &[PathState], at: usize) -> RequestPacket {
        if !self.uses_list {
            return one_per_vertex(transport, vertices, at);
        }
        let (request, len) = self.eight_from(at);
        let vertex = eight(|lane| request[lane].vertex);
        let consecutive = U::from(vertex).simd_eq(U::splat(vertex[0]) + U::from(NUMBERS)) == U::MAX;
        let rows = if consecutive { Rows::From(vertex[0] as usize) } else { Rows::Each(vertex) };
        let samples_per_path = if self.at_first_surface {
            // Gather by vertex: beyond the last request, columns hold data of earlier waves.
            let paths = eight(|lane| &paths[vertices.path[vertex[lane] as usize] as usize]);
            [0, 1, 2].map(|t| F::from(eight(|lane| paths[lane].samples_per_path[t])))
        } else {
            let [a_env, a_area, a_b] = transport.deeper_samples_per_path().map(F::splat);
            let probability = vertices.roulette(transport, &rows).map_or(F::ONE, |[light, _]| light);
            [probability * a_env, probability * a_area, a_b]
        };
        RequestPacket {
            first: at,
            path_ids: PathIds { index: U::from(eight(|lane| request[lane].index)), ..vertices.path_ids(&rows) },
            target: U::from(eight(|lane| request[lane].target as u32)),
            len,
            samples_per_path,
            rows,
        }
    }

    /// Eight entries of the list from `at` on, and how many of them are valid. Spare lanes repeat the last entry.
    #[inline(always)]
    fn eight_from(&self, at: usize) -> ([SampleRequest; LANES], usize) {
        let list = &self.list[at..self.list.len().min(at + LANES)];
        let packet = match list.first_chunk() {
            Some(all) => *all,
            None => eight(|lane| list[lane.min(list.len() - 1)]),
        };
        (packet, list.len())
    }
}

/// Selects the light of eight light samples: the mask of those that sample the environment, and the number that chooses among
/// area lights. `choice` is the sample's first number.
#[inline(always)]
pub(crate) fn select_environment(transport: &Transport, target: U, choice: F) -> (F, F) {
    let (drawn, left) = transport.proposal.lights.draw_kind(choice);
    let draws = are(target, LightTarget::Random as u32);
    (are(target, LightTarget::Environment as u32) | (draws & drawn), draws.select(left, choice))
}

/// One sample for each of up to eight vertices from `at` on.
#[inline(always)]
pub(crate) fn one_per_vertex(transport: &Transport, vertices: &Vertices, at: usize) -> RequestPacket {
    let rows = Rows::From(at);
    RequestPacket {
        first: at,
        path_ids: vertices.path_ids(&rows),
        target: U::splat(LightTarget::Random as u32),
        len: LANES.min(vertices.len() - at),
        samples_per_path: transport.deeper_samples_per_path().map(F::splat),
        rows,
    }
}

/// Sequence index and target of light sample `number` of a pixel. Where samples are allocated to targets, the first ones of a
/// wave sample the environment.
pub fn light_sample_index(task: &PixelTask, number: u32) -> (u32, LightTarget) {
    let Some(environment) = task.counts.environment else { return (number, LightTarget::Random) };
    let area_before = task.first_light - task.first_environment;
    let area_from = task.first_light + environment;
    if number < area_from {
        return (number - area_before, LightTarget::Environment);
    }
    (AREA_LIGHT_INDEX | (number - area_from + area_before), LightTarget::AreaLight)
}
