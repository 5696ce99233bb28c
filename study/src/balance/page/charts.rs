//! Charts of one scene and of all scenes.

use maud::Markup;

use crate::balance::table::{Level, Outcome, Row};
use crate::balance::{CONTROL, Design, HALF, SceneResults};
use crate::report::{Axis, Chart, Dot, Figure, Scale, Series, dot_plot};

/// The same colour for an estimator everywhere: grey for `half` and its control.
fn color(name: &str) -> usize {
    match name {
        "half" | CONTROL => 0,
        "progressive" => 1,
        "second-order" => 2,
        "efficiency-aware" => 4,
        "power" => 5,
        "max" => 6,
        _ => 3,
    }
}

/// All but `half` and its control.
pub(super) fn others(level: &Level) -> impl Iterator<Item = &Outcome> {
    level.results.iter().filter(|o| o.estimator.is_some_and(|e| e != HALF))
}

pub(super) fn overview(design: &Design, scenes: &[SceneResults]) -> Option<Markup> {
    let kinds = others(scenes.first()?.top()?).map(|o| o.row.estimator.clone()).collect::<Vec<_>>();
    let kind = |row: &Row| kinds.iter().position(|k| *k == row.estimator);
    let dots = |scene: &SceneResults| {
        let outcomes = scene.top().into_iter().flat_map(others);
        let dot = |o: &Outcome| Some(Dot { value: o.row.ratio, error: o.row.ratio_se, kind: kind(&o.row)? });
        (scene.name.clone(), outcomes.filter_map(dot).collect::<Vec<_>>())
    };
    let spp = design.spp.last().copied().unwrap_or(0);
    Some(dot_plot(
        &format!("Variance over that of half, {spp} paths a pixel"),
        "variance ratio, mean over pixels; bars: two standard errors either way; left is better",
        "as half",
        &kinds.iter().map(|k| (k.clone(), color(k))).collect::<Vec<_>>(),
        &scenes.iter().map(dots).collect::<Vec<_>>(),
    ))
}

pub(super) fn scene_charts(scene: &SceneResults, top: &Level) -> [Figure; 3] {
    let named = || top.results.iter().filter(|o| o.estimator.is_some()).map(|o| o.row.estimator.clone());
    let lines = |x: fn(&Row) -> f64| {
        let line = |name: String| {
            let all = || scene.levels.iter().flat_map(|l| &l.results).filter(|o| o.row.estimator == name);
            let points = all().map(|o| (x(&o.row), o.row.rel_mse)).collect();
            let errors = all().map(|o| o.row.rel_mse_se).collect();
            Series { points, errors, color: color(&name), name: name.clone() }
        };
        named().map(line).collect::<Vec<_>>()
    };
    let log = [Scale::Log; 2];
    let error = |title, x_label, x| Chart::fitted(title, [x_label, "relMSE, mean over replicas"], log, lines(x));
    let seconds = error("Error against time", "CPU seconds a picture, median", |r| r.cpu_seconds);
    let samples = error("Error against samples", "paths a pixel", |r| f64::from(r.spp));
    let distribution = |outcome: &Outcome| {
        let mut ratios = outcome.ratios.iter().map(|r| r.ratio).collect::<Vec<_>>();
        ratios.sort_by(f64::total_cmp);
        let n = ratios.len();
        let steps = (0..=200).map(|i| (i * n.saturating_sub(1)) / 200).filter(|i| *i < n);
        let points = steps.map(|i| (ratios[i], (i + 1) as f64 / n as f64)).collect();
        let row = &outcome.row;
        let name = if outcome.estimator.is_none() { "half again (noise)" } else { &row.estimator };
        Series { name: name.to_owned(), points, errors: Vec::new(), color: color(&row.estimator) }
    };
    let pixels = Chart {
        title: "Pixels by their variance ratio to half".to_owned(),
        x_label: "variance ratio as measured, with its noise".to_owned(),
        y_label: "share of pixels at or below".to_owned(),
        x: Axis::new(Scale::Log, 0.1, 10.0),
        y: Axis::new(Scale::Linear, 0.0, 1.0),
        series: top.results.iter().filter(|o| o.estimator != Some(HALF)).map(distribution).collect(),
        dots: false,
        marks: vec![(1.0, "1".to_owned())],
    };
    let bars = "Bars: two standard errors either way. Lines that coincide are drawn side by side.";
    let noise = "Left of 1: less variance than `half` in that pixel. `half again` shows the scatter of noise alone.";
    let figure = |name: &str, chart: Chart, caption| (format!("{}-{name}", scene.name), chart.svg(), caption);
    [
        figure("error-seconds", seconds, bars),
        figure("error-samples", samples, "The same over samples."),
        figure("pixels", pixels, noise),
    ]
}
