//! Comparison of two sequences: errors over the frames, and the worst frame.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use maud::{Markup, html};
use serde::Serialize;

use super::report::{Pair, Report, and_more, short, shown};
use crate::batch::numbering::{numbered, present};
use crate::console::say;
use crate::{Error, Result};

/// Whether both names have a placeholder for the frame number, and are not files.
pub(crate) fn are_sequences(a: &Path, b: &Path) -> bool {
    [a, b].iter().all(|name| numbered(name, 0).is_some() && !name.exists())
}

/// Frames that exist in both sequences: number and paths, in order. Prints which are missing in one.
/// Errors: [`Error::Missing`] if there are none; those of [`present`].
pub(crate) fn in_both(a: &Path, b: &Path) -> Result<Vec<(u32, PathBuf, PathBuf)>> {
    let [ours, theirs] = [present(a)?, present(b)?].map(BTreeSet::from_iter);
    for (name, alone) in [(a, &ours - &theirs), (b, &theirs - &ours)] {
        if let Some(first) = alone.first() {
            let more = and_more(alone.len() - 1);
            say(format_args!("only of {}, not compared: frame {first}{more}", name.display()));
        }
    }
    let pair = |&frame: &u32| Some((frame, numbered(a, frame)?, numbered(b, frame)?));
    let both: Vec<_> = ours.intersection(&theirs).filter_map(pair).collect();
    if both.is_empty() {
        return Err(Error::Missing(format!("{} and {} have no frame in common", a.display(), b.display())));
    }
    Ok(both)
}

/// Index of the pair with the largest relMSE; NaN counts as infinite, and so do pixels that are not finite.
pub fn worst(pairs: &[Pair]) -> usize {
    let order = |i: &usize| match &pairs[*i].comparison {
        c if c.rel_mse.is_nan() || c.not_finite != [0, 0] => f64::INFINITY,
        c => c.rel_mse,
    };
    // Reversed, so that the first of equal maxima is taken.
    (0..pairs.len()).rev().max_by(|i, j| order(i).total_cmp(&order(j))).unwrap_or(0)
}

/// What `--json` prints of two sequences.
#[derive(Serialize)]
pub struct Sequence<'a> {
    #[serde(serialize_with = "shown")]
    pub a: &'a Path,
    #[serde(serialize_with = "shown")]
    pub b: &'a Path,
    pub reference: &'static str,
    pub worst_frame: u32,
    pub mean_rel_mse: f64,
    pub within: bool,
    pub frames: Vec<Frame<'a>>,
}

#[derive(Serialize)]
pub struct Frame<'a> {
    frame: u32,
    #[serde(flatten)]
    report: &'a Report<'a>,
}

impl<'a> Sequence<'a> {
    /// The report of two sequences, from those of their frames.
    pub fn new([a, b]: [&'a Path; 2], numbers: &[u32], worst: usize, reports: &'a [Report<'a>]) -> Self {
        let sum: f64 = reports.iter().map(|report| report.comparison.rel_mse).sum();
        Self {
            a,
            b,
            reference: "b",
            worst_frame: numbers[worst],
            mean_rel_mse: sum / reports.len() as f64,
            within: reports.iter().all(|report| report.within),
            frames: numbers.iter().zip(reports).map(|(&frame, report)| Frame { frame, report }).collect(),
        }
    }
}

/// Line below the table.
pub fn summary(numbers: &[u32], worst: usize, pairs: &[Pair]) -> String {
    let c = &pairs[worst].comparison;
    let mean = pairs.iter().map(|pair| pair.comparison.rel_mse).sum::<f64>() / pairs.len() as f64;
    format!(
        "{} frames, relMSE {} in the mean; worst is frame {}: relMSE {}, FLIP {}",
        pairs.len(),
        short(mean),
        numbers[worst],
        short(c.rel_mse),
        short(c.flip)
    )
}

/// SVG chart for the page: relMSE (logarithmic) and FLIP (0 to 1) over the frames, with a mark at the worst frame.
pub fn curve(numbers: &[u32], worst: usize, pairs: &[Pair]) -> Markup {
    const WIDTH: f64 = 960.0;
    const HEIGHT: f64 = 240.0;
    let (first, last) = (f64::from(numbers[0]), f64::from(numbers[numbers.len() - 1]));
    let x = |i: usize| WIDTH * (f64::from(numbers[i]) - first) / (last - first).max(1.0);
    let logs: Vec<f64> = pairs.iter().map(|pair| pair.comparison.rel_mse.max(1e-12).log10()).collect();
    let finite = || logs.iter().copied().filter(|log| log.is_finite());
    let (low, high) = (finite().fold(f64::INFINITY, f64::min).floor(), finite().fold(-13.0, f64::max).ceil());
    let (low, high) = if low < high { (low, high) } else { (high - 1.0, high) };
    let line = |class: &str, y: &dyn Fn(usize) -> f64| {
        let at = |i: usize| Some((x(i), y(i))).filter(|(_, y)| y.is_finite());
        let points: Vec<String> = (0..pairs.len()).filter_map(at).map(|(x, y)| format!("{x:.1},{y:.1}")).collect();
        html! { polyline class=(class) points=(points.join(" ")) {} }
    };
    let rel_mse = line("relmse", &|i| HEIGHT * (high - logs[i]) / (high - low));
    let flip = line("flip", &|i| HEIGHT * (1.0 - pairs[i].comparison.flip));
    let (described, at) = (summary(numbers, worst, pairs), x(worst));
    html! {
        figure {
            svg viewBox=(format!("-8 -8 {} {}", WIDTH + 16.0, HEIGHT + 16.0)) role="img"
                aria-label={ "Error over frames: " (described) } {
                rect width=(WIDTH) height=(HEIGHT) {}
                line.worst x1=(at) x2=(at) y1="0" y2=(HEIGHT) {}
                (rel_mse) (flip)
            }
            figcaption {
                (described) ". Frames " (first) " to " (last) "; " span.relmse { "relMSE" } " from 1e" (low) " (below) to 1e" (high)
                ", " span.flip { "FLIP" } " from 0 to 1. Below, the worst frame."
            }
        }
    }
}
