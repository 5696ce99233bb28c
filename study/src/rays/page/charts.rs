//! Charts of a scene, and over all.

use maud::Markup;

use crate::rays::measure::CONTROL;
use crate::rays::table::{BASELINE, Build, Picture, Results, Trace, distinct, scenes};
use crate::report::{COLORS, Chart, Dot, Figure, Scale, Series, dot_plot};

/// Those that charts show first, each with its own colour; others take the colours that these leave.
const SHOWN: [(&str, usize); 8] = [
    ("embree", 0),
    ("embree+high", 1),
    ("embree+low", 5),
    ("embree+single", 3),
    ("obvhs", 2),
    ("obvhs+fastest", 6),
    ("obvhs+very-slow", 4),
    ("obvhs+bvh2", 7),
];

/// The contenders that charts show, with their colours: as many as there are colours.
fn shown(results: &Results) -> Vec<(&str, usize)> {
    let there = distinct(results.builds.iter().map(|b| b.backend.as_str()));
    let mut shown = SHOWN.into_iter().filter(|(name, _)| there.contains(name)).collect::<Vec<_>>();
    let free = (1..COLORS).filter(|color| shown.iter().all(|(_, used)| used != color)).collect::<Vec<_>>();
    let others = there.into_iter().filter(|name| *name != CONTROL && SHOWN.iter().all(|(known, _)| known != name));
    shown.extend(others.zip(free));
    shown
}

/// The stream that stands for all in charts.
const STREAM: &str = "diffuse";

/// Build and render against paths a pixel, over the baseline's: times themselves are in the tables, and would lie on each
/// other.
pub(super) fn picture(results: &Results, scene: &str) -> Markup {
    let rows = results.pictures.iter().filter(|p| p.scene == scene).collect::<Vec<_>>();
    let base = rows.iter().find(|r| r.backend == CONTROL);
    let shown = shown(results);
    let seconds = |r: &Picture, spp: f64| r.build_cpu_seconds + spp * r.cpu_seconds_per_spp;
    let line = |r: &&Picture| {
        let name = if r.backend == CONTROL { BASELINE } else { &r.backend };
        let color = shown.iter().find(|(shown, _)| *shown == name)?.1;
        let at = |spp: f64| Some((spp, seconds(r, spp) / seconds(base?, spp)));
        let points = (0..=10).filter_map(|i| at(f64::from(1 << i))).collect();
        Some(Series { name: name.to_owned(), points, errors: Vec::new(), color })
    };
    let side = rows.first().map_or(0.0, |p| (p.pixels as f64).sqrt());
    let labels = ["paths a pixel", "CPU time of build and render over that of embree"];
    let title = format!("Time to a picture of {side:.0} x {side:.0}, less is faster");
    let mut chart = Chart::fitted(&title, labels, [Scale::Log; 2], rows.iter().filter_map(line).collect());
    chart.dots = false;
    chart.svg()
}

pub(super) fn overview(results: &Results) -> Option<Markup> {
    let scenes = scenes(results);
    let mut kinds = vec![(CONTROL, 0)];
    kinds.extend(shown(results).into_iter().filter(|(name, _)| *name != BASELINE));
    let dots = |(scene, _): &(&str, u64)| {
        let of = |(kind, (name, _)): (usize, &(&str, usize))| {
            let own = |t: &&Trace| t.scene == *scene && t.stream == STREAM && t.backend == *name;
            let row = results.traces.iter().find(own)?;
            Some(Dot { value: row.speed_ratio, error: row.speed_ratio_se, kind })
        };
        ((*scene).to_owned(), kinds.iter().enumerate().filter_map(of).collect::<Vec<_>>())
    };
    let rows = scenes.iter().map(dots).collect::<Vec<_>>();
    if rows.is_empty() {
        return None;
    }
    Some(dot_plot(
        "Speed of diffuse bounces over that of embree, one thread",
        "speed ratio, median of rounds; bars: two standard errors either way; right is faster",
        "as embree",
        &kinds.iter().map(|(name, color)| ((*name).to_owned(), *color)).collect::<Vec<_>>(),
        &rows,
    ))
}

/// Build and trace over the number of triangles, for each kind of generated scene.
pub(super) fn costs(results: &Results) -> Vec<Figure> {
    let (mut charts, shown) = (Vec::new(), shown(results));
    for shape in distinct(results.builds.iter().filter_map(|b| b.shape.as_deref())) {
        let lines = |of: &dyn Fn(&str) -> Vec<(f64, f64)>| {
            let line = |&(name, color): &(&str, usize)| {
                let mut points = of(name);
                points.sort_by(|a, b| a.0.total_cmp(&b.0));
                Series { name: name.to_owned(), points, errors: Vec::new(), color }
            };
            shown.iter().map(line).filter(|s| s.points.len() > 1).collect::<Vec<_>>()
        };
        let of_shape = |own: &Option<String>| own.as_deref() == Some(shape);
        let builds = lines(&|name| {
            let rows = results.builds.iter().filter(|b| of_shape(&b.shape) && b.backend == name);
            let base = |b: &Build| {
                let base = results.builds.iter().find(|o| o.scene == b.scene && o.backend == BASELINE);
                base.map(|base| base.cpu_seconds)
            };
            rows.filter_map(|b| Some((b.built_triangles as f64, b.cpu_seconds / base(b)?))).collect()
        });
        let traces = lines(&|name| {
            let rows = results.traces.iter().filter(|t| of_shape(&t.shape) && t.backend == name && t.stream == STREAM);
            rows.map(|t| (t.triangles as f64, 1.0 / t.speed_ratio)).collect()
        });
        if builds.is_empty() {
            continue;
        }
        let mut add = |what: &str, title: String, y_label: &str, lines| {
            let chart = Chart::fitted(&title, ["triangles", y_label], [Scale::Log; 2], lines);
            charts.push((format!("cost-{what}-{shape}"), chart.svg(), ""));
        };
        add("build", format!("Building: {shape}"), "CPU time of a build over that of embree", builds);
        let title = format!("Tracing diffuse bounces: {shape}");
        add("trace", title, "time of a ray over that with embree, one thread", traces);
    }
    charts
}
