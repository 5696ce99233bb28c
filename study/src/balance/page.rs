//! The page and charts of a study of pixels' variances.

mod charts;
pub(super) mod pictures;

use bismar::Result;

use super::measure::REFERENCE_PARTS;
use super::scene_results::SceneResults;
use super::table::{self, Level, Outcome, Row, WORST};
use super::{Design, Estimator, HALF};
use crate::report::page::chart_figure;
use crate::report::{self, Cell, Page, Table, Tone, number, percent, plural, with_error, with_relative_error};
use charts::{overview, scene_charts};
use pictures::{by_eye, pictures, worst_pixels};

/// Writes `results.csv`, `results.json`, `report.html` and `charts/`.
pub fn write(design: &Design, scenes: &[SceneResults]) -> Result<()> {
    let rows = scenes.iter().flat_map(|s| &s.levels).flat_map(|l| &l.results).map(|o| o.row.clone());
    table::write(design, &rows.collect::<Vec<_>>())?;
    let named = |scene: &'_ SceneResults| {
        scene_charts(scene)
            .into_iter()
            .map(|(name, chart)| (format!("{}-{name}", scene.name), chart.file()))
            .collect::<Vec<_>>()
    };
    let overview = overview(design, scenes).map(|plot| ("overview".to_owned(), plot.file()));
    let charts = overview.into_iter().chain(scenes.iter().flat_map(named));
    report::write(&design.folder, page(design, scenes)?, charts)
}

fn page(design: &Design, scenes: &[SceneResults]) -> Result<String> {
    let spp = design.spp.last().copied().unwrap_or(0);
    let lead = format!(
        "Every estimator against `half` (one light and one BSDF sample per path, balance heuristic): {} scene{}, {}, {}, {} replicas \
         of every picture.",
        scenes.len(),
        plural(scenes.len()),
        design.pixels(),
        design.light(),
        design.replicas
    );
    let mut page = Page::new("Balance study", &lead);
    page.section("Overview");
    if let Some(plot) = overview(design, scenes) {
        let oracle = scenes.iter().any(|s| s.outcome(Estimator::Oracle).is_some());
        let caption = "The oracle is not a method: it is the best fixed share of each pixel, found by brute force.";
        page.wide(plot.svg(), if oracle { caption } else { "" });
    }
    averages(&mut page, scenes, spp);
    method(&mut page, design);
    for scene in scenes {
        scene_section(&mut page, design, scene)?;
    }
    Ok(page.finish())
}

fn averages(page: &mut Page, scenes: &[SceneResults], spp: u32) {
    let Some(first) = scenes.first().and_then(SceneResults::top) else { return };
    page.heading(&format!("Over all scenes, {spp} paths a pixel"));
    let of = |estimator: Estimator| {
        let rows = scenes.iter().filter_map(|s| Some(&s.outcome(estimator)?.row)).collect::<Vec<_>>();
        (estimator, rows)
    };
    let estimators = first.results.iter().filter_map(|o| o.estimator).map(of).collect::<Vec<_>>();
    type Rows<'a> = (Estimator, Vec<&'a Row>);
    let mean = |(_, rows): &Rows, f: fn(&Row) -> f64| rows.iter().map(|r| f(r)).sum::<f64>() / rows.len() as f64;
    let error = |(_, rows): &Rows, f: fn(&Row) -> f64| {
        rows.iter().map(|r| f(r).powi(2)).sum::<f64>().sqrt() / rows.len() as f64
    };
    let table = Table::of(&estimators)
        .column("estimator", "", |(estimator, _)| estimator.name())
        .column(
            "variance ratio",
            "Mean over scenes of the mean over pixels of the variance over that of half, at equal samples",
            |r| toned(mean(r, |r| r.ratio), error(r, |r| r.ratio_se)),
        )
        .column("worst scene", "The largest of the scenes' ratios", |(_, rows)| {
            rows.iter().map(|r| r.ratio).fold(f64::NAN, f64::max)
        })
        .column("at equal time", "The ratio times the CPU time over that of half", |r| {
            with_error(mean(r, |r| r.equal_time_ratio), error(r, |r| r.equal_time_ratio_se))
        })
        .column(
            "at the shares found",
            "The same with the shares found before the last pass used for all samples",
            |r| r.1.iter().all(|r| r.found_ratio.is_some()).then(|| mean(r, |r| r.found_ratio.unwrap_or(f64::NAN))),
        )
        .column("CPU time", "Median CPU time over that of half in the same round", |r| mean(r, |r| r.time_ratio))
        .column("surely worse", "Mean over scenes of the share of pixels above 1.05 beyond what noise explains", |r| {
            percent(mean(r, |r| r.worse_surely))
        })
        .column(
            "worst 1 %, held out",
            "Mean over scenes: the pixels that are worst in one half of the replicas, judged by the other",
            |r| mean(r, |r| r.worst_held_out.unwrap_or(f64::NAN)),
        )
        .faint(|(estimator, _)| matches!(*estimator, Estimator::Oracle | HALF));
    page.table(&table.end());
}

/// A ratio that is good below 1.
pub(super) fn toned(ratio: f64, error: f64) -> Cell {
    (with_error(ratio, error), Tone::below_one(ratio, error)).into()
}

fn method(page: &mut Page, design: &Design) {
    page.details("How this was measured, and its uncertainty", |page| {
        page.text(&format!(
            "Each picture was rendered {} times with different seeds. A pixel's variance is the sample variance of these \
             replicas, summed over channels with the weights of relMSE, 1/(reference² + 0.01). The reference is the mean \
             of {REFERENCE_PARTS} renders by `half` with {} paths a pixel together. Replica r has the same seed for every estimator: \
             what two estimators have in common cancels.",
            design.replicas, design.reference_spp
        ));
        if design.footprint.is_some() {
            page.text(
                "The measured pixels are whole tiles of a large picture, rendered as in the whole picture, with its pixel size and \
                 neighbours. In a small picture of the whole view nearly every pixel contains an edge, and the position of a path \
                 within the pixel hides the effect of the balance. Pictures of the measured pixels show the tiles side by side.",
            );
        }
        page.text(
            "The variance ratio is the mean over pixels of a pixel's variance over that by `half`, with the bias of noisy \
             divisors removed by the jackknife. The ratio of means divides the variances of the whole picture instead; the \
             noisiest pixels dominate it. ± is one standard error, by a bootstrap over replicas (200 resamples).",
        );
        page.text(
            "Per-pixel ratios exclude pixels that do not vary and, as undetermined, pixels whose variance under `half` or its \
             control comes from a few replicas only (standard error of its logarithm above 0.6). The rule uses `half` and its \
             control only and is the same for all estimators. relMSE and the ratio of means include every pixel.",
        );
        page.text(
            "A per-pixel ratio is noisy. The control, `half` with other seeds against `half`, shows the scatter of ratios whose \
             true value is 1. Surely worse are the pixels above 1.05 whose z exceeds what the control shows, at an expected false \
             discovery rate of 5 % (Benjamini and Hochberg). The held-out worst are the 1 % of pixels that are worst in one half of \
             the replicas, judged by the geometric mean of their ratios in the other half, both ways round. If noise alone made \
             them worst, that is the typical ratio.",
        );
        page.text(
            "Seconds are CPU seconds of all threads. The estimators took turns, replica by replica. The time ratio is the median \
             over replicas of a picture's time over that of `half` in the same round, so other load on the machine affects all \
             alike. The shares found are those before an estimator's last pass, used for all samples of another render with \
             other seeds: the variance that remains if finding them cost nothing.",
        );
    });
}

fn scene_section(page: &mut Page, design: &Design, scene: &SceneResults) -> Result<()> {
    page.section(&scene.name);
    let shown = Estimator::Method(scene.portrait.shown);
    let (Some(top), Some(outcome)) = (scene.top(), scene.outcome(shown)) else { return Ok(()) };
    page.text(&sentences(&outcome.row, design));
    pictures(page, design, scene, outcome)?;
    let captions = [
        "Bars: two standard errors either way. Lines that coincide are drawn side by side.",
        "The same over samples.",
        "Left of 1: less variance than `half` in that pixel. `half again` shows the scatter of noise alone.",
    ];
    let charts = scene_charts(scene).into_iter().zip(captions);
    page.row(charts.map(|((_, chart), caption)| chart_figure(chart.svg(), caption)));
    page.heading(&format!("{} paths a pixel", top.spp));
    page.table(&level_table(top));
    for level in scene.levels.iter().rev().skip(1) {
        page.details(&format!("{} paths a pixel", level.spp), |page| page.table(&level_table(level)));
    }
    by_eye(page, design, scene)?;
    worst_pixels(page, design, scene, outcome)
}

/// The results of one estimator in sentences.
fn sentences(row: &Row, design: &Design) -> String {
    let name = &row.estimator;
    let all = design.width * design.height;
    let mut text = format!(
        "With {} paths a pixel, `{name}` has {} times the variance of `half`, as a mean over {} of {all} pixels ({} do not vary, \
         {} are undetermined), and {} times at equal time. The whole picture's variance is {} times that of `half`.",
        row.spp,
        with_error(row.ratio, row.ratio_se),
        row.pixels,
        row.constant,
        row.undetermined,
        with_error(row.equal_time_ratio, row.equal_time_ratio_se),
        with_error(row.ratio_of_means, row.ratio_of_means_se),
    );
    if (row.ratio / row.ratio_of_means).ln().abs() > 0.15 {
        text += &format!(
            " The two differ because the first counts every pixel alike, while the few noisiest pixels, where `{name}` gains {}, \
             dominate the second and relMSE.",
            if row.ratio < row.ratio_of_means { "less" } else { "more" }
        );
    }
    if let (Some(found), Some(error)) = (row.found_ratio, row.found_ratio_se) {
        text +=
            &format!(" With the shares that it found used from the start it would be {}.", with_error(found, error));
    }
    if let Some(to_oracle) = row.to_oracle {
        text += &format!(" The best fixed shares would leave {} times the variance.", number(row.ratio / to_oracle));
    }
    text += &format!(
        " {} of the pixels measure above 1.05; {} do where `half` is compared with itself. Beyond noise, {} are worse.",
        percent(row.worse),
        percent(row.worse_control),
        percent(row.worse_surely),
    );
    if let (Some(worst), Some(error)) = (row.worst_held_out, row.worst_held_out_se) {
        text += &format!(
            " The {:.0} % of pixels that are worst in one half of the replicas have a ratio of {} in the other half.",
            WORST * 100.0,
            with_error(worst, error)
        );
    }
    let bias = if row.bias_z.abs() < 4.0 { "no bias is visible" } else { "this is a bias" };
    text + &format!(" The picture's mean differs from the reference by z = {:.1}: {bias}.", row.bias_z)
}

/// z of the picture's mean.
pub(super) fn bias(z: f64, otherwise: Tone) -> Cell {
    (format!("{z:.1}"), if z.abs() > 4.0 { Tone::Bad } else { otherwise }).into()
}

fn level_table(level: &Level) -> Table {
    let faint = |o: &Outcome| matches!(o.estimator, Some(HALF | Estimator::Oracle) | None);
    let name = |o: &Outcome| if o.estimator.is_none() { "half again".to_owned() } else { o.row.estimator.clone() };
    let percentile = |value: fn(&Row) -> (f64, f64)| move |o: &Outcome| with_error(value(&o.row).0, value(&o.row).1);
    Table::of(&level.results)
        .column("estimator", "half again is the control", name)
        .column("relMSE", "Mean over replicas of mean((x − reference)²/(reference² + 0.01))", |o| {
            with_relative_error(o.row.rel_mse, o.row.rel_mse_se)
        })
        .column("CPU s", "Median CPU seconds of a picture, all threads", |o| o.row.cpu_seconds)
        .column("relMSE × s", "Inverse efficiency: less is better", |o| o.row.inverse_efficiency)
        .column("time", "CPU time over that of half in the same round, median", |o| o.row.time_ratio)
        .column(
            "variance ratio",
            "Mean over pixels of the variance over that of half, at equal samples, bias-corrected",
            |o| toned(o.row.ratio, o.row.ratio_se),
        )
        .column("of means", "The whole picture's variance over that of half", |o| {
            toned(o.row.ratio_of_means, o.row.ratio_of_means_se)
        })
        .column("at equal time", "The variance ratio times the time ratio", |o| {
            toned(o.row.equal_time_ratio, o.row.equal_time_ratio_se)
        })
        .column("found", "Variance ratio with the shares found before the last pass used for all samples", |o| {
            o.row.found_ratio
        })
        .column(
            "/ oracle",
            "Variance ratio over that of the best fixed share of each pixel; empty if not measured",
            |o| o.row.to_oracle,
        )
        .column("> 1.05", "Share of pixels whose measured ratio is above 1.05, noise included", |o| {
            percent(o.row.worse)
        })
        .column("surely", "Share of pixels above 1.05 beyond what noise explains", |o| {
            (percent(o.row.worse_surely), if o.row.worse_surely > 0.001 { Tone::Bad } else { Tone::Plain })
        })
        .column("p50", "Half of the pixels' measured ratios are below", percentile(|r| (r.p50, r.p50_se)))
        .column("p95", "95 % of the pixels' measured ratios are below", percentile(|r| (r.p95, r.p95_se)))
        .column("p99", "99 % of the pixels' measured ratios are below", percentile(|r| (r.p99, r.p99_se)))
        .column("max", "The largest measured ratio", percentile(|r| (r.p100, r.p100_se)))
        .column("worst 1 %", "Worst in one half of the replicas, judged by the other half", |o| {
            o.row.worst_held_out.map(|worst| with_error(worst, o.row.worst_held_out_se.unwrap_or(0.0)))
        })
        .faint(faint)
        .column(
            "bias z",
            "Difference of the picture's mean from the reference's in standard errors, worst channel",
            |o| bias(o.row.bias_z, if faint(o) { Tone::Faint } else { Tone::Plain }),
        )
        .end()
}
