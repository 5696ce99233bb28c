//! What was measured, for people: `report.html` and its charts.

mod charts;
pub(super) mod pictures;

use bismar::Result;

use super::key::What;
use super::measure::{Measured, REFERENCE_PARTS};
use super::portrait::Portrait;
use super::table::{Level, Outcome, Row, WORST, write_json};
use super::{Design, Estimator, HALF};
use crate::files;
use crate::report::page::chart_figure;
use crate::report::{Page, Table, Tone, number, with_error, with_relative_error};
use charts::{overview, scene_charts};
use pictures::{by_eye, pictures, worst_pixels};

/// What is known of one scene.
pub struct SceneResults {
    /// Its name.
    pub name: String,
    /// From the fewest samples up.
    pub levels: Vec<Level>,
    /// The reference, three numbers a pixel.
    pub reference: Vec<f64>,
    /// One replica by `half` and one by the balance shown, at most samples.
    pub examples: [Vec<f32>; 2],
    /// To be looked at.
    pub portrait: Portrait,
}

impl SceneResults {
    /// Gathers it.
    pub fn new(name: &str, levels: Vec<Level>, measured: &Measured, portrait: Portrait) -> Self {
        let most = levels.last().map_or(0, |l| l.spp);
        let example = |estimator| {
            let cell = measured.get(What::Picture(estimator), most);
            cell.map_or(Vec::new(), |c| c.picture(0).to_vec())
        };
        let examples = [example(HALF), example(Estimator::Method(portrait.shown))];
        Self { name: name.to_owned(), levels, reference: measured.reference.mean(), examples, portrait }
    }

    fn top(&self) -> Option<&Level> {
        self.levels.last()
    }

    fn outcome(&self, estimator: Estimator) -> Option<&Outcome> {
        self.top()?.results.iter().find(|o| o.estimator == Some(estimator))
    }
}

/// Writes `results.csv`, `results.json`, `report.html` and `charts/`.
///
/// # Errors
/// As [`files::write`].
pub fn write(design: &Design, scenes: &[SceneResults]) -> Result<()> {
    let rows = scenes.iter().flat_map(|s| &s.levels).flat_map(|l| &l.results).map(|o| o.row.clone());
    let rows = rows.collect::<Vec<_>>();
    files::write_csv(&design.folder.join("results.csv"), &rows)?;
    write_json(&design.folder.join("results.json"), design, &rows)?;
    let charts = design.folder.join("charts");
    files::folder(&charts)?;
    if let Some(overview) = overview(design, scenes) {
        files::write(&charts.join("overview.svg"), overview.file())?;
    }
    for scene in scenes {
        for (name, chart) in scene_charts(scene) {
            files::write(&charts.join(format!("{}-{name}.svg", scene.name)), chart.file())?;
        }
    }
    files::write(&design.folder.join("report.html"), page(design, scenes)?)
}

fn page(design: &Design, scenes: &[SceneResults]) -> Result<String> {
    let spp = design.spp.last().copied().unwrap_or(0);
    let lead = format!(
        "How light and BSDF sampling share the work: every estimator against `half` (one sample of each a path, balance \
         heuristic), on {} scene{}, {}, {:?} light transport, {} replicas of every picture.",
        scenes.len(),
        if scenes.len() == 1 { "" } else { "s" },
        design.pixels(),
        design.integrator,
        design.replicas
    );
    let mut page = Page::new(
        "Balance study",
        &lead.replace("Direct light", "direct light").replace("Path light", "path-traced light"),
    );
    page.section("Overview");
    if let Some(plot) = overview(design, scenes) {
        let oracle = scenes.iter().any(|s| s.outcome(Estimator::Oracle).is_some());
        let caption = "The oracle is no method: it is the best fixed share of each pixel, found by brute force.";
        page.wide(plot.svg(), if oracle { caption } else { "" });
    }
    averages(&mut page, scenes, spp);
    method(&mut page, design);
    for scene in scenes {
        scene_section(&mut page, design, scene)?;
    }
    Ok(page.finish())
}

/// Means over scenes.
fn averages(page: &mut Page, scenes: &[SceneResults], spp: u32) {
    let Some(first) = scenes.first().and_then(SceneResults::top) else { return };
    page.heading(&format!("Over all scenes, {spp} paths a pixel"));
    let mut table = Table::new(&[
        ("estimator", "What was used"),
        (
            "variance ratio",
            "Mean over scenes of the mean over pixels of the variance over that of half, at equal samples",
        ),
        ("worst scene", "The largest of the scenes' ratios"),
        ("at equal time", "The ratio times the CPU time over that of half"),
        ("at the shares found", "The same with the shares found before the last pass used for all samples"),
        ("CPU time", "Median CPU time over that of half in the same round"),
        ("surely worse", "Mean over scenes of the share of pixels above 1.05 beyond what noise explains"),
        (
            "worst 1 %, held out",
            "Mean over scenes: the pixels that look worst in one half of the replicas, judged by the other",
        ),
    ]);
    for outcome in first.results.iter().filter(|o| o.estimator.is_some()) {
        let rows = scenes.iter().filter_map(|s| Some(&s.outcome(outcome.estimator?)?.row)).collect::<Vec<_>>();
        let n = rows.len() as f64;
        let mean = |f: &dyn Fn(&Row) -> f64| rows.iter().map(|r| f(r)).sum::<f64>() / n;
        let error = |f: &dyn Fn(&Row) -> f64| rows.iter().map(|r| f(r).powi(2)).sum::<f64>().sqrt() / n;
        let found = rows.iter().all(|r| r.found_ratio.is_some());
        let faint = matches!(outcome.estimator, Some(Estimator::Oracle | HALF));
        let (ratio, ratio_se) = (mean(&|r| r.ratio), error(&|r| r.ratio_se));
        let tone = if faint { Tone::Faint } else { tone(ratio, ratio_se) };
        let plain = if faint { Tone::Faint } else { Tone::Plain };
        let worst = rows.iter().map(|r| r.ratio).fold(f64::NAN, f64::max);
        table.rows.push(vec![
            (outcome.row.estimator.clone(), plain),
            (with_error(ratio, ratio_se), tone),
            (number(worst), plain),
            (with_error(mean(&|r| r.equal_time_ratio), error(&|r| r.equal_time_ratio_se)), plain),
            (if found { number(mean(&|r| r.found_ratio.unwrap_or(f64::NAN))) } else { String::new() }, plain),
            (number(mean(&|r| r.time_ratio)), plain),
            (percent(mean(&|r| r.worse_surely)), plain),
            (number(mean(&|r| r.worst_held_out.unwrap_or(f64::NAN))), plain),
        ]);
    }
    page.table(&table);
}

fn method(page: &mut Page, design: &Design) {
    page.details("How this was measured, and how sure it is", |page| {
        page.text(&format!(
            "Each picture was rendered {} times with different seeds; a pixel's variance is the sample variance of these \
             replicas, summed over the channels with the weights of relMSE, 1/(reference² + 0.01). The reference is the mean \
             of {REFERENCE_PARTS} renders by `half` with {} paths a pixel together. Replica r has the same seed for every estimator, so that \
             what two estimators do alike cancels.",
            design.replicas, design.reference_spp
        ));
        if design.footprint.is_some() {
            page.text(
                "Measured are tiles of a large picture, rendered as in the whole of it: pixels as small as those of what is \
                 rendered in earnest, with the neighbours that they have there. In a small picture of the whole view nearly every \
                 pixel has an edge in it, and where in the pixel a path goes hides what the balance does. Pictures of the measured \
                 pixels show the tiles side by side.",
            );
        }
        page.text(
            "The variance ratio is the mean over pixels of a pixel's variance over that by `half`; the jackknife takes off \
             the bias that noise in the divisor gives to such a mean. The ratio of means divides the whole picture's \
             variances instead: the noisiest pixels rule it. ± is one standard error, by a bootstrap over replicas (200 \
             resamples).",
        );
        page.text(
            "Left out of per-pixel ratios are pixels that do not vary and, as undetermined, pixels whose variance under `half` \
             or its control is made by a few replicas alone (standard error of its logarithm above 0.6). The rule looks at \
             `half` and its control only; it is the same for all estimators. relMSE and the ratio of means count every pixel.",
        );
        page.text(
            "A per-pixel ratio is noisy: the control, `half` with other seeds against `half`, shows how far ratios scatter where \
             the truth is 1. Surely worse are the pixels above 1.05 whose z-value is beyond what the control shows, with 5 % \
             of false finds expected (Benjamini and Hochberg). The held-out worst are the 1 % of pixels that look worst in one \
             half of the replicas, judged by the geometric mean of their ratios in the other half, both ways round: where noise \
             alone made them worst, that is the typical ratio again, not above it.",
        );
        page.text(
            "Seconds are CPU seconds of all threads. The estimators took turns, replica by replica, and the time ratio is the \
             median over replicas of a picture's time over that of `half` in the same round: what else the machine did meets all \
             alike. The shares found are those before an estimator's last pass, used for all samples of another render with \
             other seeds: what is left of the variance if finding them cost nothing.",
        );
    });
}

fn tone(ratio: f64, error: f64) -> Tone {
    match () {
        () if ratio + 2.0 * error < 1.0 => Tone::Good,
        () if ratio - 2.0 * error > 1.0 => Tone::Bad,
        () => Tone::Plain,
    }
}

fn percent(share: f64) -> String {
    if share.is_nan() { "–".to_owned() } else { format!("{:.2} %", share * 100.0) }
}

fn scene_section(page: &mut Page, design: &Design, scene: &SceneResults) -> Result<()> {
    page.section(&scene.name);
    let shown = Estimator::Method(scene.portrait.shown);
    let (Some(top), Some(outcome)) = (scene.top(), scene.outcome(shown)) else { return Ok(()) };
    page.text(&sentences(&outcome.row, design));
    pictures(page, design, scene, outcome)?;
    let captions = [
        "Bars: two standard errors either way. Lines that would hide each other are drawn side by side.",
        "The same over samples.",
        "Left of 1: less variance than `half` in that pixel. `half again` shows how far noise alone scatters.",
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

/// What the numbers say, and how sure.
fn sentences(row: &Row, design: &Design) -> String {
    let name = &row.estimator;
    let all = (design.width * design.height) as usize;
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
            " The two differ because the first counts every pixel alike, while the second, and relMSE with it, is ruled by the \
             few noisiest pixels, where `{name}` gains {}.",
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
        " {} of the pixels measure above 1.05; so do {} where `half` is compared with itself. Beyond noise, {} are worse.",
        percent(row.worse),
        percent(row.worse_control),
        percent(row.worse_surely),
    );
    if let (Some(worst), Some(error)) = (row.worst_held_out, row.worst_held_out_se) {
        text += &format!(
            " The {:.0} % of pixels that look worst in one half of the replicas have a ratio of {} in the other half.",
            WORST * 100.0,
            with_error(worst, error)
        );
    }
    let bias = if row.bias_z.abs() < 4.0 { "no bias is to be seen" } else { "this is a bias" };
    text + &format!(" The picture's mean differs from the reference by z = {:.1}: {bias}.", row.bias_z)
}

fn level_table(level: &Level) -> Table {
    let mut table = Table::new(&[
        ("estimator", "What was used; half again is the control"),
        ("relMSE", "Mean over replicas of mean((x − reference)²/(reference² + 0.01))"),
        ("CPU s", "Median CPU seconds of a picture, all threads"),
        ("relMSE × s", "Inverse efficiency: less is better"),
        ("time", "CPU time over that of half in the same round, median"),
        ("variance ratio", "Mean over pixels of the variance over that of half, at equal samples, bias-corrected"),
        ("of means", "The whole picture's variance over that of half"),
        ("at equal time", "The variance ratio times the time ratio"),
        ("found", "Variance ratio with the shares found before the last pass used for all samples"),
        (
            "/ oracle",
            "Variance ratio over that of the oracle, the best fixed share of each pixel; empty where it was not sought",
        ),
        ("> 1.05", "Share of pixels whose measured ratio is above 1.05, noise included"),
        ("surely", "Share of pixels above 1.05 beyond what noise explains"),
        ("p50", "Half of the pixels' measured ratios are below"),
        ("p95", "95 % of the pixels' measured ratios are below"),
        ("p99", "99 % of the pixels' measured ratios are below"),
        ("max", "The largest measured ratio"),
        ("worst 1 %", "Worst in one half of the replicas, judged by the other half"),
        ("bias z", "Difference of the picture's mean from the reference's in standard errors, worst channel"),
    ]);
    for outcome in &level.results {
        let row = &outcome.row;
        let half = outcome.estimator == Some(HALF);
        let faint = half || matches!(outcome.estimator, None | Some(Estimator::Oracle));
        let plain = if faint { Tone::Faint } else { Tone::Plain };
        let toned = |x: f64, e: f64| (with_error(x, e), if faint { Tone::Faint } else { tone(x, e) });
        let optional = |x: Option<f64>| (x.map_or(String::new(), number), plain);
        table.rows.push(vec![
            (if outcome.estimator.is_none() { "half again".to_owned() } else { row.estimator.clone() }, plain),
            (with_relative_error(row.rel_mse, row.rel_mse_se), plain),
            (number(row.cpu_seconds), plain),
            (number(row.inverse_efficiency), plain),
            (number(row.time_ratio), plain),
            toned(row.ratio, row.ratio_se),
            toned(row.ratio_of_means, row.ratio_of_means_se),
            toned(row.equal_time_ratio, row.equal_time_ratio_se),
            optional(row.found_ratio),
            optional(row.to_oracle),
            (percent(row.worse), plain),
            (percent(row.worse_surely), if row.worse_surely > 0.001 && !faint { Tone::Bad } else { plain }),
            (with_error(row.p50, row.p50_se), plain),
            (with_error(row.p95, row.p95_se), plain),
            (with_error(row.p99, row.p99_se), plain),
            (with_error(row.p100, row.p100_se), plain),
            (row.worst_held_out.map_or(String::new(), |w| with_error(w, row.worst_held_out_se.unwrap_or(0.0))), plain),
            (format!("{:.1}", row.bias_z), if row.bias_z.abs() > 4.0 { Tone::Bad } else { plain }),
        ]);
    }
    table
}
