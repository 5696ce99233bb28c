//! One row a scene, estimator and sample count (`docs/study-balance.md` describes every column).

use bismar::Result;
use bismar::film::compare::relative_to;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use super::campaign::seeds;
use super::cell::Cell;
use super::key::What;
use super::measure::Measured;
use super::ratio::{self, Deviations, Judgeable, Ratio};
use super::resample::{self, Summary};
use super::{CONTROL, Design, Estimator, HALF, StudyScene};
use crate::files;
use crate::provenance::Provenance;
use crate::statistics::{farthest, mean_of, median, moments};

/// Share of the pixels in the held-out worst.
pub(crate) const WORST: f64 = 0.01;

/// A line of the table. `_se` is a standard error.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Row {
    pub scene: String,
    pub estimator: String,
    pub spp: u32,
    pub replicas: usize,
    pub pixels: usize,
    pub undetermined: usize,
    pub constant: usize,
    pub rel_mse: f64,
    pub rel_mse_se: f64,
    pub bias_z: f64,
    pub cpu_seconds: f64,
    pub time_ratio: f64,
    pub time_ratio_se: f64,
    pub inverse_efficiency: f64,
    pub ratio: f64,
    pub ratio_se: f64,
    pub ratio_of_means: f64,
    pub ratio_of_means_se: f64,
    pub equal_time_ratio: f64,
    pub equal_time_ratio_se: f64,
    pub worse_surely: f64,
    pub p50: f64,
    pub p50_se: f64,
    pub log_error: f64,
    pub worst_held_out: Option<f64>,
    pub worst_held_out_se: Option<f64>,
    pub share_mean: f64,
}

/// Everything about one sample count on one scene.
pub struct Level {
    pub spp: u32,
    /// Outcome of each estimator, the control second.
    pub results: Vec<Outcome>,
}

/// Results of one estimator at one sample count.
pub struct Outcome {
    pub row: Row,
    /// `None` for the control.
    pub estimator: Option<Estimator>,
    pub ratios: Vec<Ratio>,
    /// Each pixel's mean share of light samples.
    pub shares: Vec<f32>,
}

pub struct SceneResults {
    pub name: String,
    /// From the fewest samples up.
    pub levels: Vec<Level>,
}

impl SceneResults {
    pub fn new(scene: &StudyScene, design: &Design, measured: &Measured) -> Self {
        Self { name: scene.name.clone(), levels: levels(scene, design, measured) }
    }

    /// That of the most samples.
    pub fn top(&self) -> Option<&Level> {
        self.levels.last()
    }
}

/// Judges the measurements of a scene, from the fewest samples up.
fn levels(scene: &StudyScene, design: &Design, measured: &Measured) -> Vec<Level> {
    let reference = measured.reference.mean();
    design
        .spp
        .iter()
        .filter_map(|&spp| {
            let half = measured.get(What::Picture(HALF), spp)?;
            let control = measured.get(What::Control, spp)?;
            let replicas = design.replicas as usize;
            let base = Deviations::new(half, replicas, &reference);
            let control_deviations = Deviations::new(control, replicas, &reference);
            let judgeable = Judgeable::new(&base, &control_deviations);
            let judged =
                |cell: &Cell| Judged::new(Deviations::new(cell, replicas, &reference), &base, &judgeable.pixels);
            let against = (judged(control), &base, &judgeable);
            let judge = |estimator: Option<Estimator>, cell: &Cell| {
                let own = judged(cell);
                let reference = (&reference[..], &measured.reference);
                let name = estimator.map_or(CONTROL.to_owned(), Estimator::name);
                let row = row((&scene.name, name, spp), cell, reference, (&own, &against));
                Outcome { row, estimator, ratios: own.ratios, shares: cell.mean_shares() }
            };
            let mut results = Vec::new();
            for (key, cell) in measured.cells.iter().filter(|(key, _)| key.spp == spp) {
                match key.what {
                    What::Picture(estimator) => results.push(judge(Some(estimator), cell)),
                    What::Control => results.push(judge(None, cell)),
                    What::Reference => {}
                }
            }
            Some(Level { spp, results })
        })
        .collect()
}

/// Ratios of a cell and their summary.
struct Judged {
    own: Deviations,
    ratios: Vec<Ratio>,
    summary: Summary,
    errors: Summary,
}

impl Judged {
    fn new(own: Deviations, base: &Deviations, pixels: &[usize]) -> Self {
        let ratios = ratio::ratios(&own, base, pixels);
        let summary = resample::summary(&own, base, &ratios);
        let errors = resample::standard_errors(&own, base, &ratios);
        Self { own, ratios, summary, errors }
    }
}

fn row(
    (scene, estimator, spp): (&str, String, u32),
    cell: &Cell,
    (reference, parts): (&[f64], &Cell),
    (judged, (control, base, judgeable)): (&Judged, &(Judged, &Deviations, &Judgeable)),
) -> Row {
    let replicas = base.replicas();
    let n = replicas as f64;
    let rel_mses = (0..replicas).map(|r| rel_mse(cell.picture(r), reference)).collect::<Vec<_>>();
    let (rel_mse, rel_mse_variance) = moments(&rel_mses);
    let [cpu_seconds, time_ratio, time_ratio_se] = cell.timing(replicas);
    let [_, ratio_of_means, p50] = judged.summary;
    let [ratio_se, ratio_of_means_se, p50_se] = judged.errors;
    let ratio = ratio::mean(&judged.ratios);
    let worst = ratio::worst_held_out(&judged.own, base, &judgeable.pixels, WORST);
    let surely = ratio::surely_worse(&judged.ratios, &control.ratios).len();
    Row {
        scene: scene.to_owned(),
        estimator,
        spp,
        replicas,
        pixels: judged.ratios.len(),
        undetermined: judgeable.undetermined,
        constant: judgeable.constant,
        rel_mse,
        rel_mse_se: (rel_mse_variance / n).sqrt(),
        bias_z: bias_z(cell, replicas, reference, parts),
        cpu_seconds,
        time_ratio,
        time_ratio_se,
        inverse_efficiency: rel_mse * cpu_seconds,
        ratio,
        ratio_se,
        ratio_of_means,
        ratio_of_means_se,
        equal_time_ratio: ratio * time_ratio,
        equal_time_ratio_se: (ratio_se * time_ratio).hypot(ratio * time_ratio_se),
        worse_surely: surely as f64 / judged.ratios.len() as f64,
        p50,
        p50_se,
        log_error: median(&judged.ratios.iter().map(|r| r.log_error).collect::<Vec<_>>()),
        worst_held_out: worst.map(|w| w.0),
        worst_held_out_se: worst.map(|w| w.1),
        share_mean: cell.mean_shares().iter().map(|&s| f64::from(s)).sum::<f64>() / cell.pixels as f64,
    }
}

/// Squared errors over what relMSE divides them by, per channel.
pub(super) fn relative_squares(picture: &[f32], reference: &[f64]) -> impl Iterator<Item = f64> {
    picture.iter().zip(reference).map(|(&x, &r)| (f64::from(x) - r).powi(2) / relative_to(r))
}

pub(super) fn rel_mse(picture: &[f32], reference: &[f64]) -> f64 {
    mean_of(relative_squares(picture, reference))
}

/// Largest |z| over the channels of the picture's mean against the reference's, with its sign.
pub(super) fn bias_z(cell: &Cell, replicas: usize, reference: &[f64], parts: &Cell) -> f64 {
    let channel = |picture: &[f32], c: usize| mean_of(picture.iter().skip(c).step_by(3).map(|&x| f64::from(x)));
    let mean_and_error = |cell: &Cell, replicas: usize, c: usize| {
        let (mean, variance) = moments(&(0..replicas).map(|r| channel(cell.picture(r), c)).collect::<Vec<_>>());
        (mean, variance / replicas as f64)
    };
    let z = |c: usize| {
        let (mean, variance) = mean_and_error(cell, replicas, c);
        let (_, reference_variance) = mean_and_error(parts, parts.replicas(), c);
        let truth = mean_of(reference.iter().skip(c).step_by(3).copied());
        let deviation = (variance + reference_variance).sqrt();
        if mean == truth { 0.0 } else { (mean - truth) / deviation.max(1e-7 * truth) }
    };
    farthest((0..3).map(z))
}

#[derive(Serialize)]
struct Results<'a, R> {
    schema: u32,
    version: &'static str,
    run: Provenance,
    #[serde(skip_serializing_if = "Option::is_none")]
    whole: Option<bool>,
    integrator: bismar::render::Integrator,
    width: u32,
    height: u32,
    /// Size of the picture whose tiles were measured.
    #[serde(skip_serializing_if = "Option::is_none")]
    footprint: Option<[u32; 2]>,
    replicas: u32,
    reference_spp: u32,
    rows: &'a [R],
}

/// Rises when a column changes its meaning or is removed.
const SCHEMA: u32 = 2;

/// Writes rows as `results.csv` and `results.json`.
pub fn write<R: Serialize + DeserializeOwned>(design: &Design, rows: &[R]) -> Result<()> {
    files::write_csv(&design.folder.join("results.csv"), rows)?;
    let &Design { integrator, width, height, footprint, replicas, reference_spp, .. } = design;
    let results = Results {
        schema: SCHEMA,
        version: env!("CARGO_PKG_VERSION"),
        run: Provenance::now(&seeds::ALL),
        whole: design.whole.then_some(true),
        integrator,
        width,
        height,
        footprint,
        replicas,
        reference_spp,
        rows,
    };
    files::write_json(&design.folder.join("results.json"), &results)
}
