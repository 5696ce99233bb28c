//! What was measured, for people: `report.html` and its charts.

use std::path::Path;

use bismar::balance::Balance;
use bismar::film::{View, atomic};
use bismar::{Error, Result};

use super::measure::{Measured, PORTRAIT_SPP, Portrait, What};
use super::table::{Level, Outcome, Row, WORST, write_csv, write_json};
use super::{Estimator, Plan};
use crate::report::page::{chart_figure, crop_figure, map_figure, picture_figure, slider};
use crate::report::{
    Axis, Chart, ColorScale, Dot, DotPlot, Page, Picture, Scale, Series, Table, Tone, number, with_error,
};

/// What is known of one scene.
pub struct SceneReport {
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

impl SceneReport {
    /// Gathers it.
    pub fn new(name: &str, levels: Vec<Level>, measured: &Measured, portrait: Portrait) -> Self {
        let most = levels.last().map_or(0, |l| l.spp);
        let example = |balance| {
            let cell = measured.get(What::Picture(Estimator::Method(balance)), most);
            cell.map_or(Vec::new(), |c| c.picture(0).to_vec())
        };
        let examples = [example(Balance::Half), example(portrait.shown)];
        Self { name: name.to_owned(), levels, reference: measured.reference.mean(), examples, portrait }
    }

    fn top(&self) -> Option<&Level> {
        self.levels.last()
    }

    fn outcome(&self, estimator: Estimator) -> Option<&Outcome> {
        self.top()?.results.iter().find(|o| o.estimator == Some(estimator))
    }
}

/// Share of light samples in false colours.
const SHARE: ColorScale = ColorScale::Difference { middle: 0.5, half_width: 0.5 };
const SHARE_WORDS: [&str; 3] = ["0: BSDF alone", "½", "1: light alone"];
const RATIO: ColorScale = ColorScale::Ratio { factor: 4.0 };
const RATIO_WORDS: [&str; 3] = ["¼", "1: as half", "4"];
/// Worst pixels that are shown, and how far around them.
const CROPS: usize = 4;
const CROP_RADIUS: u32 = 4;

/// Writes `results.csv`, `results.json`, `report.html` and `charts/`.
///
/// # Errors
/// As [`atomic::write`].
pub fn write(plan: &Plan, scenes: &[SceneReport]) -> Result<()> {
    let rows = scenes.iter().flat_map(|s| &s.levels).flat_map(|l| &l.results).map(|o| o.row.clone());
    let rows = rows.collect::<Vec<_>>();
    write_csv(&plan.folder.join("results.csv"), &rows)?;
    write_json(&plan.folder.join("results.json"), plan, &rows)?;
    let charts = plan.folder.join("charts");
    std::fs::create_dir_all(&charts)
        .map_err(|e| Error::CannotCreate(format!("{}: cannot create: {e}", charts.display())))?;
    if let Some(overview) = overview(plan, scenes) {
        write_text(&charts.join("overview.svg"), &overview.file())?;
    }
    for scene in scenes {
        for (name, chart) in scene_charts(scene) {
            write_text(&charts.join(format!("{}-{name}.svg", scene.name)), &chart.file())?;
        }
    }
    write_text(&plan.folder.join("report.html"), &page(plan, scenes)?)
}

fn write_text(path: &Path, text: &str) -> Result<()> {
    atomic::write(path, |file| Ok(Ok(std::io::Write::write_all(file, text.as_bytes())?)))
}

/// The same colour for an estimator everywhere: grey for `half` and its control.
fn color(name: &str) -> usize {
    const OTHERS: [usize; 4] = [3, 4, 5, 6];
    match name {
        "half" | super::CONTROL => 0,
        "progressive" => 1,
        "second-order" => 2,
        "oracle" => 7,
        _ => {
            let others = Estimator::all().into_iter().map(Estimator::name);
            let fixed = ["half", "progressive", "second-order", "oracle"];
            let at = others.filter(|n| !fixed.contains(&n.as_str())).position(|n| n == name);
            OTHERS[at.unwrap_or(0) % OTHERS.len()]
        }
    }
}

/// Rows to compare with `half`: no control, not `half` itself.
fn others(level: &Level) -> impl Iterator<Item = &Outcome> {
    level.results.iter().filter(|o| o.estimator.is_some_and(|e| e != Estimator::Method(Balance::Half)))
}

fn overview(plan: &Plan, scenes: &[SceneReport]) -> Option<DotPlot> {
    let kinds = others(scenes.first()?.top()?).map(|o| o.row.estimator.clone()).collect::<Vec<_>>();
    let kind = |row: &Row| kinds.iter().position(|k| *k == row.estimator);
    let dots = |scene: &SceneReport| {
        let outcomes = scene.top().into_iter().flat_map(others);
        let dot = |o: &Outcome| Some(Dot { value: o.row.ratio, error: o.row.ratio_se, kind: kind(&o.row)? });
        (scene.name.clone(), outcomes.filter_map(dot).collect::<Vec<_>>())
    };
    let rows = scenes.iter().map(dots).collect::<Vec<_>>();
    let values = rows.iter().flat_map(|(_, dots)| dots.iter().map(|d| d.value.clamp(0.05, 8.0))).chain([0.8, 1.1]);
    let spp = plan.spp.last().copied().unwrap_or(0);
    Some(DotPlot {
        title: format!("Variance over that of half, {spp} paths a pixel"),
        label: "mean over pixels; bars: two standard errors either way; left is better".to_owned(),
        axis: Axis::fit(Scale::Log, values),
        mark: Some((1.0, "as half".to_owned())),
        kinds: kinds.iter().map(|k| (k.clone(), color(k))).collect(),
        rows,
    })
}

/// The charts of a scene, by the names of their files.
fn scene_charts(scene: &SceneReport) -> Vec<(&'static str, Chart)> {
    let Some(top) = scene.top() else { return Vec::new() };
    let named = || top.results.iter().filter(|o| o.estimator.is_some()).map(|o| o.row.estimator.clone());
    let lines = |x: fn(&Row) -> f64| {
        let rows = |name: &str| {
            let all = scene.levels.iter().flat_map(|l| &l.results).filter(|o| o.row.estimator == name);
            all.map(|o| (x(&o.row), o.row.rel_mse)).collect::<Vec<_>>()
        };
        named().map(|name| Series { points: rows(&name), color: color(&name), name }).collect::<Vec<_>>()
    };
    let log = [Scale::Log; 2];
    let seconds =
        Chart::fitted("Error against time", ["CPU seconds a picture", "relMSE"], log, lines(|r| r.cpu_seconds));
    let samples = Chart::fitted("Error against samples", ["paths a pixel", "relMSE"], log, lines(|r| f64::from(r.spp)));
    let distribution = |outcome: &Outcome| {
        let mut ratios = outcome.ratios.iter().map(|r| r.ratio).collect::<Vec<_>>();
        ratios.sort_by(f64::total_cmp);
        let n = ratios.len();
        let steps = (0..=200).map(|i| (i * n.saturating_sub(1)) / 200).filter(|i| *i < n);
        let points = steps.map(|i| (ratios[i], (i + 1) as f64 / n as f64)).collect();
        let row = &outcome.row;
        let name = if outcome.estimator.is_none() { "half again (noise)" } else { &row.estimator };
        Series { name: name.to_owned(), points, color: color(&row.estimator) }
    };
    let half = Some(Estimator::Method(Balance::Half));
    let pixels = Chart {
        title: "Pixels by their variance ratio to half".to_owned(),
        x_label: "ratio as measured, with its noise".to_owned(),
        y_label: "share of pixels at or below".to_owned(),
        x: Axis::new(Scale::Log, 0.1, 10.0),
        y: Axis::new(Scale::Linear, 0.0, 1.0),
        series: top.results.iter().filter(|o| o.estimator != half).map(distribution).collect(),
        dots: false,
        marks: vec![(1.0, "1".to_owned())],
    };
    vec![("error-seconds", seconds), ("error-samples", samples), ("pixels", pixels)]
}

fn page(plan: &Plan, scenes: &[SceneReport]) -> Result<String> {
    let spp = plan.spp.last().copied().unwrap_or(0);
    let lead = format!(
        "How light and BSDF sampling share the work: every estimator against `half` (one sample of each a path, balance \
         heuristic), on {} scene{}, {}x{} pixels, {:?} light transport, {} replicas of every picture.",
        scenes.len(),
        if scenes.len() == 1 { "" } else { "s" },
        plan.width,
        plan.height,
        plan.integrator,
        plan.replicas
    );
    let mut page = Page::new(
        "Balance study",
        &lead.replace("Direct light", "direct light").replace("Path light", "path-traced light"),
    );
    page.section("Overview");
    if let Some(plot) = overview(plan, scenes) {
        page.wide(
            &plot.svg(),
            "The oracle is no method: it is the best fixed share of each pixel, found by brute force.",
        );
    }
    averages(&mut page, scenes, spp);
    method(&mut page, plan);
    for scene in scenes {
        scene_section(&mut page, plan, scene)?;
    }
    Ok(page.finish())
}

/// Means over scenes.
fn averages(page: &mut Page, scenes: &[SceneReport], spp: u32) {
    let Some(first) = scenes.first().and_then(SceneReport::top) else { return };
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
        let faint = matches!(outcome.estimator, Some(Estimator::Oracle | Estimator::Method(Balance::Half)));
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

fn method(page: &mut Page, plan: &Plan) {
    let parts = super::measure::REFERENCE_PARTS;
    page.details("How this was measured, and how sure it is", |page| {
        page.text(&format!(
            "Each picture was rendered {} times with different seeds; a pixel's variance is the sample variance of these \
             replicas, summed over the channels with the weights of relMSE, 1/(reference² + 0.01). The reference is the mean \
             of {parts} renders by `half` with {} paths a pixel together. Replica r has the same seed for every estimator, so that \
             what two estimators do alike cancels.",
            plan.replicas, plan.reference_spp
        ));
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

fn scene_section(page: &mut Page, plan: &Plan, scene: &SceneReport) -> Result<()> {
    page.section(&scene.name);
    let shown = Estimator::Method(scene.portrait.shown);
    let (Some(top), Some(outcome)) = (scene.top(), scene.outcome(shown)) else { return Ok(()) };
    page.text(&sentences(&outcome.row, plan));
    pictures(page, plan, scene, outcome)?;
    page.row(&scene_charts(scene).into_iter().map(|(_, c)| chart_figure(&c.svg(), "")).collect::<Vec<_>>());
    page.heading(&format!("{} paths a pixel", top.spp));
    page.table(&level_table(top));
    for level in scene.levels.iter().rev().skip(1) {
        page.details(&format!("{} paths a pixel", level.spp), |page| page.table(&level_table(level)));
    }
    by_eye(page, plan, scene)?;
    worst_pixels(page, plan, scene, outcome)
}

/// What the numbers say, and how sure.
fn sentences(row: &Row, plan: &Plan) -> String {
    let name = &row.estimator;
    let all = (plan.width * plan.height) as usize;
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
        ("/ oracle", "Variance ratio over that of the oracle"),
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
        let half = outcome.estimator == Some(Estimator::Method(Balance::Half));
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

fn with_relative_error(x: f64, error: f64) -> String {
    format!("{} ± {:.0} %", number(x), 100.0 * error / x)
}

/// Stops by which a picture is brightened: the log-mean luminance of what is not dark becomes middle grey.
fn exposure(picture: &[f32]) -> f32 {
    let luminances = || picture.chunks_exact(3).map(|p| bismar::color::luminance(glam::Vec3::new(p[0], p[1], p[2])));
    let dark = 0.05 * luminances().sum::<f32>() / (picture.len() / 3) as f32;
    let (sum, n) = luminances().filter(|l| *l > dark).fold((0.0, 0.0), |(sum, n), l| (sum + l.ln(), n + 1.0));
    if n > 0.0 { (0.18f32.ln() - sum / n) / std::f32::consts::LN_2 } else { 0.0 }
}

fn developed(width: u32, height: u32, radiance: &[f32], ev: f32) -> Picture {
    Picture::new(width, height, radiance.chunks_exact(3).map(|p| View::Agx.apply([p[0], p[1], p[2]], ev)))
}

fn pictures(page: &mut Page, plan: &Plan, scene: &SceneReport, outcome: &Outcome) -> Result<()> {
    let portrait = &scene.portrait;
    let name = &outcome.row.estimator;
    let (w, h) = (portrait.width, portrait.height);
    let ev = exposure(portrait.clean.picture(0));
    let shares = |values: &[f32], w, h| Picture::mapped(w, h, SHARE, values.iter().map(|&s| f64::from(s)));
    let mut pieces = vec![
        picture_figure(
            &developed(w, h, portrait.clean.picture(0), ev),
            &format!("{PORTRAIT_SPP} paths a pixel by `{name}`, exposure {ev:+.1} EV."),
        )?,
        map_figure(
            &shares(portrait.clean.shares_of(0), w, h),
            SHARE,
            SHARE_WORDS,
            &format!("Share of light samples that `{name}` found for each pixel of the picture on the left."),
        )?,
    ];
    let oracle = scene.outcome(Estimator::Oracle);
    if let Some(oracle) = oracle {
        pieces.push(map_figure(
            &shares(&oracle.shares, plan.width, plan.height),
            SHARE,
            SHARE_WORDS,
            "The oracle's shares, by brute force, at the measured size.",
        )?);
    }
    let mut ratios = vec![f64::NAN; (plan.width * plan.height) as usize];
    outcome.ratios.iter().for_each(|r| ratios[r.pixel] = r.ratio);
    pieces.push(map_figure(
        &Picture::mapped(plan.width, plan.height, RATIO, ratios.into_iter()),
        RATIO,
        RATIO_WORDS,
        &format!("Variance by `{name}` over that by `half`, pixel by pixel, noise included. Grey: not judged."),
    )?);
    page.row(&pieces);
    Ok(())
}

fn by_eye(page: &mut Page, plan: &Plan, scene: &SceneReport) -> Result<()> {
    let portrait = &scene.portrait;
    let shown = Estimator::Method(portrait.shown);
    let half = Estimator::Method(Balance::Half);
    let (Some(a), Some(b)) = (scene.outcome(half), scene.outcome(shown)) else { return Ok(()) };
    let (name, spp) = (shown.name(), portrait.spp);
    page.heading("By eye");
    let ev = exposure(portrait.clean.picture(0));
    let [left, right] = [0, 1].map(|i| developed(portrait.width, portrait.height, portrait.noisy[i].picture(0), ev));
    let caption = format!("The same {spp} paths a pixel. Pull the line: `half` on its left, `{name}` on its right.");
    let mut pieces =
        vec![slider((&left, &format!("half, {spp} spp")), (&right, &format!("{name}, {spp} spp")), &caption)?];
    let mut errors = a.variances.iter().map(|v| v.sqrt()).collect::<Vec<_>>();
    errors.sort_by(f64::total_cmp);
    let high = crate::balance::ratio::percentile(&errors, 0.99).max(1e-6);
    let scale = ColorScale::Amount { low: high / 100.0, high };
    let (low, middle, high) = (number(high / 100.0), number(high / 10.0), number(high));
    for (name, outcome) in [("half", a), (&name[..], b)] {
        pieces.push(map_figure(
            &Picture::mapped(plan.width, plan.height, scale, outcome.variances.iter().map(|v| v.sqrt())),
            scale,
            [&low, &middle, &high],
            &format!("Relative error of a pixel by `{name}`, {} paths a pixel.", outcome.row.spp),
        )?);
    }
    page.row(&pieces);
    Ok(())
}

fn worst_pixels(page: &mut Page, plan: &Plan, scene: &SceneReport, outcome: &Outcome) -> Result<()> {
    let name = &outcome.row.estimator;
    let mut sorted = outcome.ratios.iter().filter(|r| r.z(1.0) > 0.0).collect::<Vec<_>>();
    sorted.sort_by(|a, b| b.z(1.0).total_cmp(&a.z(1.0)));
    if sorted.is_empty() {
        return Ok(());
    }
    let (w, h) = (plan.width, plan.height);
    let reference = scene.reference.iter().map(|&x| x as f32).collect::<Vec<_>>();
    let ev = exposure(&reference);
    let all = [
        ("reference", developed(w, h, &reference, ev)),
        ("half", developed(w, h, &scene.examples[0], ev)),
        (name.as_str(), developed(w, h, &scene.examples[1], ev)),
        ("share", Picture::mapped(w, h, SHARE, outcome.shares.iter().map(|&s| f64::from(s)))),
    ];
    page.heading("The pixels that look worst");
    page.text(&format!(
        "The {} pixels in which `{name}` is worse than `half` with the largest z, in the middle of {side}x{side} pixels, \
         {} paths a pixel, one replica. With so many pixels, a z of 3 to 4 is noise.",
        sorted.len().min(CROPS),
        outcome.row.spp,
        side = 2 * CROP_RADIUS + 1
    ));
    for ratio in sorted.into_iter().take(CROPS) {
        let (x, y) = (ratio.pixel as u32 % w, ratio.pixel as u32 / w);
        let (low, high) = ((-ratio.log_error).exp() * ratio.ratio, ratio.log_error.exp() * ratio.ratio);
        let mut pieces = Vec::new();
        for (i, (what, picture)) in all.iter().enumerate() {
            let caption = match i {
                0 => format!(
                    "({x}, {y}): ratio {} ({} to {}), z {:.1}",
                    number(ratio.ratio),
                    number(low),
                    number(high),
                    ratio.z(1.0)
                ),
                3 => format!("share {:.2}", outcome.shares[ratio.pixel]),
                _ => what.to_string(),
            };
            pieces.push(crop_figure(&picture.around([x, y], CROP_RADIUS), &caption)?);
        }
        page.row(&pieces);
    }
    Ok(())
}
