//! The page and charts of a study of whole pictures.

use bismar::Result;
use maud::Markup;

use super::{Pictures, Row, SceneResults};
use crate::balance::page::{share_map, toned};
use crate::balance::{Design, Estimator, HALF, table};
use crate::report::page::map_figure;
use crate::report::{Chart, ColorScale, Dot, Figure, Page, Scale, Series, Table, dot_plot, number};
use crate::statistics::mean_of;

/// Side of the blocks whose errors are compared.
const BLOCK: u32 = 8;
/// Error over that of `half` in false colours.
const RATIO: (ColorScale, [&str; 3]) = (ColorScale::Ratio { factor: 8.0 }, ["⅛", "1: as half", "8"]);
/// Writes `results.csv`, `results.json`, `report.html` and `charts/`.
pub fn write(design: &Design, scenes: &[SceneResults]) -> Result<()> {
    table::write(design, &scenes.iter().flat_map(|s| s.rows.clone()).collect::<Vec<_>>())?;
    page(design, scenes).write(&design.folder)
}

/// All but `half`.
fn others(design: &Design) -> impl Iterator<Item = Estimator> {
    design.estimators.iter().copied().filter(|e| *e != HALF)
}

/// The same colour everywhere: grey for `half`.
fn color(design: &Design, estimator: Estimator) -> usize {
    others(design).position(|e| e == estimator).map_or(0, |i| 1 + i % 6)
}

fn page(design: &Design, scenes: &[SceneResults]) -> Page {
    let lead = format!(
        "Error against CPU seconds of every technique, including the cost of learning: {}",
        design.measured(scenes.len())
    );
    let mut page = Page::new("Error against time", &lead);
    page.section("Overview");
    page.wide((
        "overview".to_owned(),
        overview(design, scenes),
        "Geometric mean over the numbers of paths. Left of 1: less error in the same time, or less time for the same error.",
    ));
    page.heading("relMSE × CPU seconds over that of half");
    page.table(&scores(design, scenes, None));
    for spp in design.spp.iter().rev() {
        page.details(&format!("{spp} paths a pixel"), |page| page.table(&scores(design, scenes, Some(*spp))));
    }
    for scene in scenes {
        scene_section(&mut page, design, scene);
    }
    page
}

fn overview(design: &Design, scenes: &[SceneResults]) -> Markup {
    let kinds = others(design).map(|e| (e.name(), color(design, e))).collect::<Vec<_>>();
    let dots = |scene: &SceneResults| {
        let dot = |(kind, estimator)| {
            let (value, error) = scene.score(estimator);
            Dot { value, error, kind }
        };
        (scene.name.clone(), others(design).enumerate().map(dot).collect::<Vec<_>>())
    };
    let rows = scenes.iter().map(dots).collect::<Vec<_>>();
    let label = "bars: two standard errors either way; left is better";
    dot_plot("relMSE × CPU seconds over that of half", label, "as half", &kinds, &rows)
}

/// relMSE × CPU seconds over that of `half`, per scene and as geometric mean over scenes: at `spp` paths, or all numbers of
/// paths together.
fn scores(design: &Design, scenes: &[SceneResults], spp: Option<u32>) -> Table {
    let score = |scene: &SceneResults, estimator| match spp {
        None => scene.score(estimator),
        Some(spp) => {
            let row = scene.of(estimator).find(|row| row.spp == spp);
            row.map_or((f64::NAN, f64::NAN), |row| (row.product_ratio, row.product_ratio_se))
        }
    };
    let what = "relMSE times CPU seconds over that of half at as many paths: below 1 is better";
    let mut table = Table::of(scenes).column("scene", "", |scene| &*scene.name);
    let mut means = vec!["geometric mean".into()];
    for estimator in others(design) {
        let cell = |scene: &SceneResults| {
            let (x, error) = score(scene, estimator);
            toned(x, error)
        };
        table = table.column(&estimator.name(), what, cell);
        let all = scenes.iter().map(|scene| score(scene, estimator)).collect::<Vec<_>>();
        let mean = mean_of(all.iter().map(|(x, _)| x.ln())).exp();
        let squares = all.iter().map(|(x, e)| (e / x).powi(2)).sum::<f64>();
        means.push(toned(mean, mean * squares.sqrt() / scenes.len() as f64));
    }
    let mut table = table.end();
    table.push(means);
    table
}

fn scene_charts(design: &Design, scene: &SceneResults) -> [Figure; 2] {
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
    let figure = |name: &str, title: &str, labels, series, caption| {
        (format!("{}-{name}", scene.name), Chart::fitted(title, labels, [Scale::Log; 2], series).svg(), caption)
    };
    let seconds = ["CPU seconds a picture, median", "relMSE, mean over replicas"];
    let bars = "Bars: two standard errors either way. Lower and to the left is better.";
    let paths = ["paths a pixel", "relMSE × CPU seconds over that of half"];
    let below = "Below 1: better than `half` with as many paths.";
    [
        figure("error-seconds", "Error against time", seconds, error, bars),
        figure("score-samples", "Error × time over that of half", paths, product, below),
    ]
}

const COLUMNS: &str = "estimator paths_mean rel_mse cpu_seconds inverse_efficiency rel_mse_ratio<1 time_ratio<1 \
                       product_ratio<1 guided guiding_variance guiding_seconds adaptive_left bias_z";

fn scene_section(page: &mut Page, design: &Design, scene: &SceneResults) {
    page.section(&scene.name);
    page.charts(scene_charts(design, scene));
    page.table(&Table::of_fields(&scene.rows, COLUMNS));
    maps(page, design, scene);
}

/// Maps of light shares, paths, and the error of each technique over that of `half`.
fn maps(page: &mut Page, design: &Design, scene: &SceneResults) {
    let size = [design.width, design.height];
    let Some(half) = scene.pictures.iter().find(|p| p.estimator == HALF) else { return };
    let mut pieces = Vec::new();
    let varies = |values: &[f32]| values.iter().any(|x| *x != values[0]);
    for own in scene.pictures.iter().filter(|p| p.estimator != HALF) {
        let name = own.estimator.name();
        if varies(&own.shares) {
            pieces.push(share_map(size, &own.shares, &name));
        }
        if varies(&own.paths) {
            let paths = own.paths.iter().map(|&n| f64::from(n));
            let [low, high] = [f64::min, f64::max].map(|of| paths.clone().fold(f64::from(own.paths[0]), of));
            let words = [low, (low * high).sqrt(), high].map(number);
            let legend = (ColorScale::Amount { low, high }, [&words[0][..], &words[1], &words[2]]);
            pieces.push(map_figure(size, legend, paths, &format!("Paths of each pixel by `{name}`.")));
        }
        if own.errors != half.errors {
            let blocks = format!("blocks of {BLOCK}x{BLOCK} pixels, noise included");
            let caption = format!("Squared error by `{name}` over that by `half`, {blocks}.");
            pieces.push(map_figure(size, RATIO, error_ratios(own, half, design.width), &caption));
        }
    }
    page.row(pieces);
}

/// A technique's error over that of `half`, pixel by pixel the same in each block.
fn error_ratios(own: &Pictures, half: &Pictures, width: u32) -> impl Iterator<Item = f64> {
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
