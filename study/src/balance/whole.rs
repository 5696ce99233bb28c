//! Whole pictures: error against CPU seconds, with all that a technique spends on learning.
//!
//! The score is relMSE × CPU seconds over that of `half` at as many paths. A reference of few paths would be in all errors:
//! its own, which its parts tell, is taken off.

pub mod page;

use serde::{Deserialize, Serialize};

use super::cell::{Cell, Prepass};
use super::key::{Key, What};
use super::measure::Measured;
use super::table::{bias_z, rel_mse, relative_squares};
use super::{Design, Estimator, HALF, StudyScene};
use crate::statistics::{mean_of, moments};

/// A line of the table. `_se` is a standard error.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Row {
    pub scene: String,
    pub estimator: String,
    pub spp: u32,
    pub replicas: usize,
    pub paths_mean: f64,
    pub rel_mse: f64,
    pub rel_mse_se: f64,
    pub reference_rel_mse: f64,
    pub bias_z: f64,
    pub cpu_seconds: f64,
    pub inverse_efficiency: f64,
    pub rel_mse_ratio: f64,
    pub rel_mse_ratio_se: f64,
    pub time_ratio: f64,
    pub time_ratio_se: f64,
    pub product_ratio: f64,
    pub product_ratio_se: f64,
    pub guided: Option<f64>,
    pub guiding_left: Option<f64>,
    pub guiding_seconds: Option<f64>,
    pub adaptive_left: Option<f64>,
}

pub struct SceneResults {
    pub name: String,
    /// From the fewest paths up, `half` first.
    pub rows: Vec<Row>,
    /// Pictures of each technique with the most paths, in the rows' order.
    pub pictures: Vec<Pictures>,
}

pub struct Pictures {
    pub estimator: Estimator,
    /// Each pixel's squared error as a part of relMSE, the mean of the replicas.
    pub errors: Vec<f64>,
    /// Each pixel's mean share of light samples.
    pub shares: Vec<f32>,
    /// Each pixel's paths, of one replica.
    pub paths: Vec<f32>,
}

impl SceneResults {
    /// Judges the measurements of a scene.
    pub fn new(scene: &StudyScene, design: &Design, measured: &Measured) -> Self {
        let reference = measured.reference.mean();
        let own_error = error_of_mean(&measured.reference, &reference);
        let truth = Truth { reference: &reference, parts: &measured.reference, own_error };
        let replicas = design.replicas as usize;
        let rows = |(key, cell): &(Key, Cell)| {
            let What::Picture(estimator) = key.what else { return None };
            let half = measured.get(What::Picture(HALF), key.spp)?;
            Some(row((&scene.name, estimator, key.spp), cell, half, &truth, replicas))
        };
        let most = design.spp.last().copied();
        let pictures = |(key, cell): &(Key, Cell)| match key.what {
            What::Picture(estimator) if Some(key.spp) == most => Some(Pictures {
                estimator,
                errors: errors(cell, &reference, replicas),
                shares: cell.mean_shares(),
                paths: cell.paths_of(0).to_vec(),
            }),
            _ => None,
        };
        let (rows, pictures) = (measured.cells.iter().filter_map(rows), measured.cells.iter().filter_map(pictures));
        Self { name: scene.name.clone(), rows: rows.collect(), pictures: pictures.collect() }
    }

    /// A technique's rows, from the fewest paths up.
    pub fn of(&self, estimator: Estimator) -> impl Iterator<Item = &Row> {
        let name = estimator.name();
        self.rows.iter().filter(move |row| row.estimator == name)
    }

    /// A technique's relMSE × CPU seconds over those of `half`: geometric mean over the numbers of paths, and its standard
    /// error.
    pub fn score(&self, estimator: Estimator) -> (f64, f64) {
        let (mut n, mut logs, mut squares) = (0.0, 0.0, 0.0);
        for row in self.of(estimator) {
            n += 1.0;
            logs += row.product_ratio.ln();
            squares += (row.product_ratio_se / row.product_ratio).powi(2);
        }
        let mean = (logs / n).exp();
        (mean, mean * squares.sqrt() / n)
    }
}

struct Truth<'a> {
    reference: &'a [f64],
    parts: &'a Cell,
    own_error: f64,
}

fn row(
    (scene, estimator, spp): (&str, Estimator, u32),
    cell: &Cell,
    half: &Cell,
    truth: &Truth,
    replicas: usize,
) -> Row {
    let rel_mses = |cell: &Cell| {
        let own = |r: usize| rel_mse(cell.picture(r), truth.reference) - truth.own_error;
        (0..replicas).map(own).collect::<Vec<_>>()
    };
    let (own, base) = (rel_mses(cell), rel_mses(half));
    let (rel_mse, variance) = moments(&own);
    let (rel_mse_ratio, rel_mse_ratio_se) = ratio(&own, &base);
    let [cpu_seconds, time_ratio, time_ratio_se] = cell.timing(replicas);
    let times = &cell.times[..replicas];
    let optional_mean = |values: Vec<f64>| (!values.is_empty()).then(|| mean_of(values.into_iter()));
    let prepass =
        |of: fn(&Prepass) -> f64| optional_mean(times.iter().filter_map(|t| t.prepass.as_ref().map(of)).collect());
    let product_ratio = rel_mse_ratio * time_ratio;
    Row {
        scene: scene.to_owned(),
        estimator: estimator.name(),
        spp,
        replicas,
        paths_mean: mean_of((0..replicas).flat_map(|r| cell.paths_of(r)).map(|&n| f64::from(n))),
        rel_mse,
        rel_mse_se: (variance / replicas as f64).sqrt(),
        reference_rel_mse: truth.own_error,
        bias_z: bias_z(cell, replicas, truth.reference, truth.parts),
        cpu_seconds,
        inverse_efficiency: rel_mse * cpu_seconds,
        rel_mse_ratio,
        rel_mse_ratio_se,
        time_ratio,
        time_ratio_se,
        product_ratio,
        product_ratio_se: product_ratio * (rel_mse_ratio_se / rel_mse_ratio).hypot(time_ratio_se / time_ratio),
        guided: prepass(|p| f64::from(u8::from(p.on))),
        guiding_left: prepass(|p| p.left),
        guiding_seconds: prepass(|p| p.seconds),
        adaptive_left: optional_mean(times.iter().filter_map(|t| t.allocation).collect()),
    }
}

/// Each pixel's error, the mean of its channels and of the replicas.
fn errors(cell: &Cell, reference: &[f64], replicas: usize) -> Vec<f64> {
    let mut all = vec![0.0; cell.pixels];
    for r in 0..replicas {
        let squares = relative_squares(cell.picture(r), reference).enumerate();
        squares.for_each(|(i, square)| all[i / 3] += square / (3 * replicas) as f64);
    }
    all
}

/// relMSE of the mean of parts that are independent, from how they differ.
fn error_of_mean(parts: &Cell, mean_of_parts: &[f64]) -> f64 {
    let n = parts.replicas();
    (0..n).map(|r| rel_mse(parts.picture(r), mean_of_parts)).sum::<f64>() / (n * (n - 1)) as f64
}

/// The ratio of two means of replicas that share seeds, and its standard error (jackknife).
fn ratio(own: &[f64], base: &[f64]) -> (f64, f64) {
    let n = own.len() as f64;
    let [a, b] = [own, base].map(|values| values.iter().sum::<f64>());
    let left_out = own.iter().zip(base).map(|(x, y)| (a - x) / (b - y)).collect::<Vec<_>>();
    (a / b, (moments(&left_out).1 * (n - 1.0).powi(2) / n).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::balance::cell::Replica;

    #[test]
    fn a_references_own_error_is_that_of_its_mean() {
        // Two pixels of mean 1, parts ±0.5 about it in one channel of six: variance 0.5 of a part with n − 1, half of it
        // of the mean of two.
        let mut parts = Cell::new(2);
        for x in [0.5, 1.5] {
            parts.push(&Replica {
                values: vec![x, 1.0, 1.0, 1.0, 1.0, 1.0],
                shares: vec![0.5; 2],
                ..Replica::default()
            });
        }
        let error = error_of_mean(&parts, &parts.mean());
        assert!((error - 0.25 / 1.01 / 6.0).abs() < 1e-12, "{error}");
        assert_eq!(errors(&parts, &[1.0; 6], 2)[1], 0.0);
        assert!((errors(&parts, &[1.0; 6], 2)[0] - 0.25 / 1.01 / 3.0).abs() < 1e-12);
    }

    #[test]
    fn what_two_techniques_do_alike_is_no_error_of_their_ratio() {
        let base = [1.0, 2.0, 4.0, 1.5];
        let half = base.map(|x| 0.5 * x);
        let (found, error) = ratio(&half, &base);
        assert!((found - 0.5).abs() < 1e-12 && error < 1e-12);
        // Independent values: by the rule for ratios, √(s²/n)·… ; here against many draws' spread.
        let (found, error) = ratio(&[1.1, 0.9, 1.0, 1.0], &[2.0, 2.0, 2.2, 1.8]);
        let expected = 0.5 * ((0.02f64 / 3.0 / 4.0).sqrt()).hypot((0.08f64 / 3.0 / 4.0).sqrt() / 2.0);
        assert!((found - 0.5).abs() < 1e-12 && (error / expected - 1.0).abs() < 0.1, "{error} {expected}");
    }
}
