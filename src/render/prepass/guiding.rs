//! Learns the field of incident light that guides paths, and decides whether it does. Each round of the pre-pass is guided by
//! the field that those before it taught. The result also depends on the expected paths per pixel.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use tracing::debug;

use super::comparison::{self, Compared};
use super::effort::{self, MAX_TIME_SHARE};
use super::rounds::{self, Decided, Learner, Round, Wanted};
use crate::guiding::{Field, PathStatistics, TrainingSample, VertexRecord, learn};
use crate::integrator::{PreparedScene, Proposal, Transport};
use crate::render::pass::decisions::TechniqueStats;
use crate::render::settings::GUIDING_MEMORY;
use crate::render::settings::RenderSettings;
use crate::render::settings::techniques::{Choice, Technique};

/// Maximum rounds.
const MAX_ROUNDS: u32 = 9;
/// Paths per pixel of the picture for which the next two constants are meant.
const REFERENCE_SPP: f64 = 64.0;
/// Maximum paths of the pre-pass per pixel of the picture.
const MAX_PATHS_PER_PICTURE_PIXEL: f64 = 12.0;
/// No further round begins after this number of training samples or half the picture's pixels, whichever is larger.
const SUFFICIENT_TRAINING_SAMPLES: f64 = 150_000.0;
/// Maximum vertex records of a round, over the training samples that suffice.
const VERTEX_RECORDS_PER_SUFFICIENT_SAMPLE: f64 = 2.0;
/// The round, counted from 0, after which `auto` first estimates the efficiency. It does so again after the last round.
const FIRST_DECISION_ROUND: u32 = 1;
/// It also does so after the rounds up to this one, if they are not the last.
const LAST_DECISION_ROUND: u32 = 2;
/// Learning continues after these decisions, too, if fewer training samples per path were found, too few for an estimate.
const MIN_SAMPLES_PER_PATH: f64 = 0.04;
/// Bytes of memory for each cell of a field, where memory limits their number. They take less; more cells would change pictures.
const BYTES_PER_CELL: f64 = 13_468.0;

/// Factor of the effort, fitted to relMSE × CPU seconds of pictures of 64, 256 and 1024 paths per pixel.
fn worthwhile(settings: &RenderSettings) -> f64 {
    let root = (f64::from(settings.expected_spp()) / REFERENCE_SPP).sqrt();
    root * root.sqrt()
}

/// Number of records in all parts.
fn count<T>(parts: &[Vec<T>]) -> usize {
    parts.iter().map(Vec::len).sum()
}

/// Learns from the rounds of a pre-pass.
pub struct GuidingLearner {
    /// Is the field used whatever it leaves?
    always: bool,
    /// Seconds of a time limit that all rounds may take.
    max_seconds: Option<f64>,
    /// Pixels of the picture.
    picture_pixels: f64,
    max: Wanted,
    max_cells: usize,
    /// Training samples after which no further round is needed.
    sufficient: f64,
    /// Paths per pixel of the picture after which no further round begins.
    max_paths: f64,
    /// Weight of differences of normals against distances, in metres.
    scale: f32,
    /// In parts, in the order of the rounds.
    training_samples: Vec<Vec<TrainingSample>>,
    /// Rays per path of the first round, which is unguided.
    unguided: Option<f64>,
    finished: bool,
    /// The field of incident light; `None` where guiding would not reduce the variance enough.
    pub field: Option<Field>,
    /// What was found, without what concerns the field itself.
    pub stats: TechniqueStats,
}

impl GuidingLearner {
    /// Begins to learn; `None` where the settings turn guiding off or there is no indirect light.
    pub fn new(scene: &PreparedScene, settings: &RenderSettings, transport: &Transport) -> Option<Self> {
        if !settings.asks_for(Technique::Guiding) || transport.max_depth < 3 {
            return None;
        }
        let most = settings.guiding_memory.unwrap_or(GUIDING_MEMORY) as f64;
        // A quarter for training samples, an eighth for vertex records, a quarter for cells while they learn.
        let max_training_samples = (most / 4.0 / size_of::<TrainingSample>() as f64) as usize;
        let picture_pixels = settings.pixels();
        let worthwhile = worthwhile(settings);
        let sufficient = SUFFICIENT_TRAINING_SAMPLES.max(picture_pixels / 2.0) * worthwhile;
        let max_vertex_records = (most / 8.0 / size_of::<VertexRecord>() as f64)
            .min(VERTEX_RECORDS_PER_SUFFICIENT_SAMPLE * sufficient) as usize;
        Some(Self {
            always: settings.techniques[Technique::Guiding] == Choice::On,
            max_seconds: settings.time.map(|time| MAX_TIME_SHARE * time),
            picture_pixels,
            max: Wanted {
                training_samples: max_training_samples,
                vertex_records: max_vertex_records,
                ..Default::default()
            },
            max_cells: (most / 4.0 / BYTES_PER_CELL).max(1.0) as usize,
            // With three quarters of what memory allows, most of the next round would be left out.
            sufficient: sufficient.min(0.75 * max_training_samples as f64),
            max_paths: MAX_PATHS_PER_PICTURE_PIXEL * worthwhile,
            scale: 0.25 * scene.scene.radius(),
            training_samples: Vec::new(),
            unguided: None,
            finished: false,
            field: None,
            stats: TechniqueStats::default(),
        })
    }

    /// Sets what the field leaves; returns the fraction of variance times rays.
    fn set_efficiency(&mut self, [variance, cost]: [f32; 2]) -> f32 {
        let remaining = Some(f64::from(variance * cost));
        self.stats = TechniqueStats { remaining, variance: Some(variance), cost: Some(cost), ..self.stats };
        variance * cost
    }

    /// Ends learning, and frees the training samples.
    fn finish_with(&mut self, field: Option<Field>) {
        (self.field, self.training_samples, self.finished) = (field, Vec::new(), true);
    }
}

impl Decided for GuidingLearner {
    fn stats(&self) -> (Technique, TechniqueStats) {
        let (cells, bytes) = self.field.as_ref().map_or((0, 0), |field| (field.cells(), field.bytes()));
        let (on, cells, bytes) = (self.field.is_some(), Some(cells), Some(bytes));
        (Technique::Guiding, TechniqueStats { on, cells, bytes, ..self.stats })
    }

    fn apply<'a>(&'a self, proposal: Proposal<'a>) -> Proposal<'a> {
        proposal.guided(self.field.as_ref())
    }
}

impl Learner for GuidingLearner {
    fn pixels(&self) -> f64 {
        effort::guiding_pixels(self.picture_pixels)
    }

    fn wants(&self) -> Option<Wanted> {
        let training_samples = self.max.training_samples.saturating_sub(count(&self.training_samples)).max(1);
        (!self.finished).then_some(Wanted { training_samples, ..self.max })
    }

    fn learn(&mut self, round: &mut Round, seconds: f64) {
        self.stats.seconds += seconds;
        let pixels = round.pixels.len() as f64;
        let cost = round.rays as f64 / round.all_paths();
        let unguided = *self.unguided.get_or_insert(cost);
        let few = (count(&round.training_samples) as f64) < MIN_SAMPLES_PER_PATH * round.all_paths();
        let fresh = count(&self.training_samples);
        self.training_samples.append(&mut round.training_samples);
        // Paths including the next round.
        let all = pixels * f64::from(4 * round.paths - 1);
        let suffices = count(&self.training_samples) as f64 >= self.sufficient;
        let last = round.number + 1 == MAX_ROUNDS
            || self.max_seconds.is_some_and(|most| 3.0 * self.stats.seconds > most)
            || all > (self.max_paths * self.picture_pixels).max(15.0 * pixels)
            || suffices;
        let decides = last || (FIRST_DECISION_ROUND..=LAST_DECISION_ROUND).contains(&round.number);
        // The first round was unguided.
        let fresh = if decides && round.number > 0 { fresh } else { usize::MAX };
        let (mut field, gain) = learn(self.training_samples.iter().flatten(), fresh, last, self.scale, self.max_cells);
        let variances = round.pixels.iter().map(|pixel| pixel.relative_variance()).filter(|v| v.is_finite());
        let variance: f64 = variances.sum();
        if decides {
            self.stats.share = Some(gain.guiding_probability);
            let remaining = self.set_efficiency([gain.variance(variance), (cost / unguided) as f32]);
            debug!("round {}: {} cells, {:?}, {gain:?}", round.number, field.cells(), self.stats);
            let most = match (last, suffices) {
                (true, true) => effort::MAX_REMAINING_GUIDED,
                (true, false) => effort::MAX_REMAINING_GUIDED_BY_FEW,
                _ => {
                    let certain = gain.standard_error <= effort::UNCERTAIN_STANDARD_ERROR;
                    let later = round.number > FIRST_DECISION_ROUND;
                    effort::MAX_REMAINING_LEARNING[usize::from(later || !certain)]
                }
            };
            if !self.always && remaining > most && (last || !few) {
                return self.finish_with(None);
            }
        }
        // One path per pixel has no variance.
        if last || round.number > 0 {
            let inverse = round.pixels.iter().map(|pixel| 1.0 / f64::from(pixel.divisor)).sum::<f64>();
            let all = PathStatistics { cost, variance: variance / round.all_paths(), inverse: inverse / pixels };
            field.learn_roulette(round.vertex_records.iter().flatten(), all);
        }
        if last { self.finish_with(Some(field)) } else { self.field = Some(field) }
    }

    /// Compares guided and unguided paths and gives the field up if too much remains. Where the estimate leaves no doubt, nothing
    /// is rendered; the estimate counts too where a time limit leaves too little time.
    fn compare(&mut self, settings: &RenderSettings, unguided: &Transport, stop: &AtomicBool) {
        let certain = self.stats.remaining.is_some_and(|left| left <= f64::from(effort::MAX_REMAINING_CERTAIN));
        if self.field.is_none() || self.always || certain {
            return;
        }
        let began = Instant::now();
        let stopped = || stop.load(Ordering::Relaxed) || effort::is_late(settings, began);
        let guided = Transport { proposal: self.apply(unguided.proposal), ..unguided.clone() };
        if let Some(Compared { variance, rays }) = comparison::compare(settings, &guided, unguided, stopped) {
            let remaining = self.set_efficiency([variance, rays].map(|v| v as f32));
            debug!("compared with unguided paths: {:?}", self.stats);
            if remaining > effort::MAX_REMAINING_GUIDED {
                self.field = None;
            }
        }
        self.stats.seconds += began.elapsed().as_secs_f64();
    }
}

/// Learns a field along the paths of `transport`, without other learners, and decides about it. `None` where `settings` turn
/// guiding off or there is no indirect light, and soon after `stop` is raised.
pub fn learned(
    scene: &PreparedScene,
    settings: &RenderSettings,
    transport: &Transport,
    stop: &AtomicBool,
) -> Option<GuidingLearner> {
    let mut learner = GuidingLearner::new(scene, settings, transport)?;
    rounds::run(scene, settings, transport, &mut [&mut learner], stop)?;
    learner.compare(settings, transport, stop);
    Some(learner)
}
