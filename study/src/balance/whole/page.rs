//! What whole pictures showed, for people: `results.csv`, `results.json`, `report.html` and its charts.

use bismar::Result;
use bismar::render::Integrator;
use serde::Serialize;

use super::{Pictures, Row, SceneResults};
use crate::balance::measure::{REFERENCE_PARTS, seeds};
use crate::balance::page::pictures::{SHARE, SHARE_WORDS, developed, exposure};
use crate::balance::{Design, Estimator, HALF};
use crate::files;
use crate::provenance::Provenance;
use crate::report::page::{chart_figure, map_figure, picture_figure, slider};
use crate::report::{
    Axis, Chart, ColorScale, Dot, DotPlot, Page, Picture, Scale, Series, Table, Tone, number, with_error,
    with_relative_error,
};

/// Side of the blocks whose errors are compared.
const BLOCK: u32 = 8;
/// Error over that of `half` in false colours.
const RATIO: ColorScale = ColorScale::Ratio { factor: 8.0 };
const RATIO_WORDS: [&str; 3] = ["⅛", "1: as half", "8"];
/// Raised when a column changes its meaning or goes away.
const SCHEMA: u32 = 1;

/// What `results.json` says besides the rows.
#[derive(Serialize)]
struct Results<'a> {
    schema: u32,
    version: &'static str,
    run: Provenance,
    whole: bool,
    integrator: Integrator,
    width: u32,
    height: u32,
    replicas: u32,
    reference_spp: u32,
    rows: &'a [Row],
}

/// Writes tables, page and charts.
///
/// # Errors
/// As [`files::write`].
pub fn write(design: &Design, scenes: &[SceneResults]) -> Result<()> {
    let rows = scenes.iter().flat_map(|s| s.rows.clone()).collect::<Vec<_>>();
    files::write_csv(&design.folder.join("results.csv"), &rows)?;
    let &Design { integrator, width, height, replicas, reference_spp, .. } = design;
    let (version, run, rows) = (env!("CARGO_PKG_VERSION"), Provenance::now(&seeds::ALL), &rows[..]);
    let schema = SCHEMA;
    let json = Results { schema, version, run, whole: true, integrator, width, height, replicas, reference_spp, rows };
    files::write_json(&design.folder.join("results.json"), &json)?;
    let charts = design.folder.join("charts");
    files::folder(&charts)?;
    files::write(&charts.join("overview.svg"), overview(design, scenes).file())?;
    for scene in scenes {
        for (name, chart) in scene_charts(design, scene) {
            files::write(&charts.join(format!("{}-{name}.svg", scene.name)), chart.file())?;
        }
    }
    files::write(&design.folder.join("report.html"), page(design, scenes)?)
}

/// All but `half`.
fn others(design: &Design) -> impl Iterator<Item = Estimator> {
    design.estimators.iter().copied().filter(|e| *e != HALF)
}

/// The same colour everywhere: grey for `half`.
fn color(design: &Design, estimator: Estimator) -> usize {
    others(design).position(|e| e == estimator).map_or(0, |i| 1 + i % 6)
}

fn page(design: &Design, scenes: &[SceneResults]) -> Result<String> {
    let light = match design.integrator {
        Integrator::Direct => "direct light",
        Integrator::Path => "path-traced light",
    };
    let lead = format!(
        "Error against CPU seconds of every technique, what it spends on learning included: {} scene{}, pictures of {}x{} \
         pixels, {light}, {} replicas of every picture.",
        scenes.len(),
        if scenes.len() == 1 { "" } else { "s" },
        design.width,
        design.height,
        design.replicas
    );
    let mut page = Page::new("Error against time", &lead);
    page.section("Overview");
    page.wide(
        overview(design, scenes).svg(),
        "Geometric mean over the numbers of paths. Left of 1: less error in the same time, or less time for the same error.",
    );
    page.heading("relMSE × CPU seconds over that of half");
    page.table(&scores(design, scenes, None));
    for spp in design.spp.iter().rev() {
        page.details(&format!("{spp} paths a pixel"), |page| page.table(&scores(design, scenes, Some(*spp))));
    }
    page.details("How this was measured, and how sure it is", |page| {
        page.text(&format!(
            "relMSE is the mean over pixels and channels of (x − reference)²/(reference² + 0.01). The reference is the mean of \
             {REFERENCE_PARTS} renders by `{}` with {} paths a pixel together and seeds of their own; its own error, which its parts \
             tell, is taken off. Replica r has the same seed for every technique.",
            design.reference().name(),
            design.reference_spp
        ));
        page.text(
            "Seconds are CPU seconds of all threads from the scene in memory to the last pixel, pilots of guiding included. The \
             techniques took turns, replica by replica, and the time ratio is the median over replicas of a picture's time over \
             that of `half` in the same round. ± is one standard error, by the jackknife over replicas. Few replicas of pictures \
             with rare bright spots say little.",
        );
    });
    for scene in scenes {
        scene_section(&mut page, design, scene)?;
    }
    Ok(page.finish())
}

fn overview(design: &Design, scenes: &[SceneResults]) -> DotPlot {
    let kinds = others(design).map(|e| (e.name(), color(design, e))).collect();
    let dots = |scene: &SceneResults| {
        let dot = |(kind, estimator)| {
            let (value, error) = scene.score(estimator);
            Dot { value, error, kind }
        };
        (scene.name.clone(), others(design).enumerate().map(dot).collect::<Vec<_>>())
    };
    let rows = scenes.iter().map(dots).collect::<Vec<_>>();
    let values = rows.iter().flat_map(|(_, dots)| dots.iter().map(|d| d.value.clamp(0.05, 8.0))).chain([0.8, 1.1]);
    DotPlot {
        title: "relMSE × CPU seconds over that of half".to_owned(),
        label: "bars: two standard errors either way; left is better".to_owned(),
        axis: Axis::fit(Scale::Log, values),
        mark: Some((1.0, "as half".to_owned())),
        kinds,
        rows,
    }
}

/// Products over those of `half`, a row a scene and one of geometric means: at so many paths, or all together.
fn scores(design: &Design, scenes: &[SceneResults], spp: Option<u32>) -> Table {
    let names = others(design).map(Estimator::name).collect::<Vec<_>>();
    let what = "relMSE times CPU seconds over that of half at as many paths: below 1 is better";
    let mut columns = vec![("scene", "Which")];
    columns.extend(names.iter().map(|name| (name.as_str(), what)));
    let mut table = Table::new(&columns);
    let score = |scene: &SceneResults, estimator| match spp {
        None => scene.score(estimator),
        Some(spp) => {
            let row = scene.of(estimator).find(|row| row.spp == spp);
            row.map_or((f64::NAN, f64::NAN), |row| (row.product_ratio, row.product_ratio_se))
        }
    };
    for scene in scenes {
        let cells = others(design).map(|e| score(scene, e)).map(|(x, e)| (with_error(x, e), tone(x, e)));
        table.rows.push([(scene.name.clone(), Tone::Plain)].into_iter().chain(cells).collect());
    }
    let n = scenes.len() as f64;
    let mean = |estimator| {
        let all = scenes.iter().map(|scene| score(scene, estimator)).collect::<Vec<_>>();
        let mean = (all.iter().map(|(x, _)| x.ln()).sum::<f64>() / n).exp();
        let error = mean * all.iter().map(|(x, e)| (e / x).powi(2)).sum::<f64>().sqrt() / n;
        (with_error(mean, error), tone(mean, error))
    };
    let means = others(design).map(mean);
    table.rows.push([("geometric mean".to_owned(), Tone::Plain)].into_iter().chain(means).collect());
    table
}

fn tone(ratio: f64, error: f64) -> Tone {
    match () {
        () if ratio + 2.0 * error < 1.0 => Tone::Good,
        () if ratio - 2.0 * error > 1.0 => Tone::Bad,
        () => Tone::Plain,
    }
}

/// The charts of a scene, by the names of their files.
fn scene_charts(design: &Design, scene: &SceneResults) -> [(&'static str, Chart); 2] {
    let series = |estimator: Estimator, point: fn(&Row) -> (f64, f64), error: fn(&Row) -> f64| Series {
        name: estimator.name(),
        points: scene.of(estimator).map(point).collect(),
        errors: scene.of(estimator).map(error).collect(),
        color: color(design, estimator),
    };
    let all = [HALF].into_iter().chain(others(design));
    let error = all.map(|e| series(e, |r| (r.cpu_seconds, r.rel_mse), |r| r.rel_mse_se)).collect();
    let product =
        others(design).map(|e| series(e, |r| (f64::from(r.spp), r.product_ratio), |r| r.product_ratio_se)).collect();
    let log = [Scale::Log; 2];
    let seconds = ["CPU seconds a picture, median", "relMSE, mean over replicas"];
    let paths = ["paths a pixel", "relMSE × CPU seconds over that of half"];
    [
        ("error-seconds", Chart::fitted("Error against time", seconds, log, error)),
        ("score-samples", Chart::fitted("Error × time over that of half", paths, log, product)),
    ]
}

fn scene_section(page: &mut Page, design: &Design, scene: &SceneResults) -> Result<()> {
    page.section(&scene.name);
    let captions = [
        "Bars: two standard errors either way. Lower and to the left is better.",
        "Below 1: better than `half` with as many paths.",
    ];
    let charts = scene_charts(design, scene).into_iter().zip(captions);
    page.row(charts.map(|((_, chart), caption)| chart_figure(chart.svg(), caption)));
    page.table(&rows(scene));
    pictures(page, design, scene)
}

fn rows(scene: &SceneResults) -> Table {
    let mut table = Table::new(&[
        ("technique", "What was used"),
        ("paths", "A pixel, mean"),
        ("relMSE", "Mean over replicas, the reference's own error taken off"),
        ("CPU s", "Median CPU seconds of a picture, all threads, learning included"),
        ("relMSE × s", "Inverse efficiency: less is better"),
        ("error", "relMSE over that of half"),
        ("time", "CPU time over that of half in the same round, median"),
        ("product", "relMSE × CPU seconds over that of half"),
        ("guided", "Share of replicas whose pilot found that guiding pays"),
        ("guiding promised", "Variance that the pilot expected guiding to leave, over that without"),
        ("pilot s", "Seconds that the pilot of guiding took"),
        (
            "adaptive promised",
            "relMSE × CPU seconds that the pilot of adaptive paths expected to leave, over that without",
        ),
        ("bias z", "Difference of the picture's mean from the reference's in standard errors, worst channel"),
    ]);
    for row in &scene.rows {
        let half = row.estimator == HALF.name();
        let plain = if half { Tone::Faint } else { Tone::Plain };
        let toned = |x: f64, e: f64| (with_error(x, e), if half { Tone::Faint } else { tone(x, e) });
        let optional = |x: Option<f64>| (x.map_or(String::new(), number), plain);
        table.rows.push(vec![
            (row.estimator.clone(), plain),
            (number(row.paths_mean), plain),
            (with_relative_error(row.rel_mse, row.rel_mse_se), plain),
            (number(row.cpu_seconds), plain),
            (number(row.inverse_efficiency), plain),
            toned(row.rel_mse_ratio, row.rel_mse_ratio_se),
            toned(row.time_ratio, row.time_ratio_se),
            toned(row.product_ratio, row.product_ratio_se),
            optional(row.guided),
            optional(row.guiding_variance),
            optional(row.guiding_seconds),
            optional(row.adaptive_left),
            (format!("{:.1}", row.bias_z), if row.bias_z.abs() > 4.0 { Tone::Bad } else { plain }),
        ]);
    }
    table
}

/// What there is to see: the scene, the shares, the paths, and where each technique has less error than `half`.
fn pictures(page: &mut Page, design: &Design, scene: &SceneResults) -> Result<()> {
    let (w, h) = (design.width, design.height);
    let reference = scene.reference.iter().map(|&x| x as f32).collect::<Vec<_>>();
    let ev = exposure(&reference);
    let Some(half) = scene.pictures.iter().find(|p| p.estimator == HALF) else { return Ok(()) };
    let mut pieces =
        vec![picture_figure(&developed(w, h, &reference, ev), &format!("The reference, exposure {ev:+.1} EV."))?];
    for own in scene.pictures.iter().filter(|p| p.estimator != HALF) {
        let name = own.estimator.name();
        if own.shares.iter().any(|s| *s != own.shares[0]) {
            let shares = Picture::mapped(w, h, SHARE, own.shares.iter().map(|&s| f64::from(s)));
            pieces.push(map_figure(&shares, SHARE, SHARE_WORDS, &format!("Share of light samples by `{name}`."))?);
        }
        if own.paths.iter().any(|n| *n != own.paths[0]) {
            let [low, high] =
                [f32::min, f32::max].map(|of| f64::from(own.paths.iter().copied().fold(own.paths[0], of)));
            let scale = ColorScale::Amount { low, high };
            let words = [low, (low * high).sqrt(), high].map(number);
            let paths = Picture::mapped(w, h, scale, own.paths.iter().map(|&n| f64::from(n)));
            let caption = format!("Paths of each pixel by `{name}`.");
            pieces.push(map_figure(&paths, scale, [&words[0], &words[1], &words[2]], &caption)?);
        }
        if own.errors == half.errors {
            continue;
        }
        let caption =
            format!("Squared error by `{name}` over that by `half`, blocks of {BLOCK}x{BLOCK} pixels, noise included.");
        pieces.push(map_figure(&Picture::mapped(w, h, RATIO, worth(own, half, w)), RATIO, RATIO_WORDS, &caption)?);
    }
    if let Some(field) = &scene.field {
        let shares = Picture::mapped(w, h, SHARE, field.shares.iter().copied());
        let words = ["0: BSDF alone", "½", "1: field alone"];
        let caption =
            format!("Share of samples that follow the field of guiding where a pixel looks; {} cells.", field.cells);
        pieces.push(map_figure(&shares, SHARE, words, &caption)?);
        let directions = Picture::new(w, h, field.directions.iter().copied());
        pieces.push(picture_figure(
            &directions,
            "Where to, in the mean: red toward +x, green up, blue toward +z, grey in all directions; black where nothing follows.",
        )?);
    }
    page.row(pieces);
    let score = |p: &&Pictures| scene.score(p.estimator).0;
    let best = scene.pictures.iter().filter(|p| p.estimator != HALF).min_by(|a, b| score(a).total_cmp(&score(b)));
    if let (Some(best), Some(spp)) = (best, design.spp.first()) {
        let [left, right] = [half, best].map(|p| developed(w, h, &p.example, ev));
        let name = best.estimator.name();
        let caption =
            format!("{spp} paths a pixel. Pull the line: `half` on its left, `{name}`, which does best, on its right.");
        page.row([slider((&left, &format!("half, {spp} spp")), (&right, &format!("{name}, {spp} spp")), &caption)?]);
    }
    Ok(())
}

/// A technique's error over that of `half`, pixel by pixel the same in each block.
fn worth(own: &Pictures, half: &Pictures, width: u32) -> impl Iterator<Item = f64> {
    let block = move |i: usize| (i as u32 % width / BLOCK, i as u32 / width / BLOCK);
    let columns = width.div_ceil(BLOCK);
    let index = move |i: usize| (block(i).1 * columns + block(i).0) as usize;
    let sums = |errors: &[f64]| {
        let mut sums = vec![0.0; errors.len().max(1).div_ceil(width as usize) * columns as usize];
        errors.iter().enumerate().for_each(|(i, error)| sums[index(i)] += error);
        sums
    };
    let (a, b, n) = (sums(&own.errors), sums(&half.errors), own.errors.len());
    (0..n).map(move |i| a[index(i)] / b[index(i)])
}
