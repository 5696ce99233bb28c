//! What was measured, for people: `report.html` and its charts.

mod charts;
mod method;

use std::path::Path;

use bismar::Result;

use super::compare;
use super::measure::CONTROL;
use super::table::{Agreement, Build, MOST_Z, Results, Trace};
use crate::files;
use crate::report::page::chart_figure;
use crate::report::{Page, Table, Tone, number, with_error};
use charts::{STREAM, costs, overview, picture};
use method::{hosts, method};

/// The baseline's name.
pub(super) const BASELINE: &str = "embree";
/// Writes tables, `report.html` and `charts/`.
///
/// # Errors
/// As [`files::write`].
pub fn write(folder: &Path, results: &Results) -> Result<()> {
    results.write(folder)?;
    let charts = folder.join("charts");
    files::folder(&charts)?;
    if let Some(plot) = overview(results) {
        files::write(&charts.join("overview.svg"), plot.file())?;
    }
    let scenes = scenes(results);
    let all = costs(results).into_iter().chain(scenes.iter().map(|s| (format!("{}-picture", s.file()), picture(s))));
    for (name, chart) in all {
        files::write(&charts.join(format!("{name}.svg")), chart.file())?;
    }
    files::write(&folder.join("report.html"), page(results, &scenes))
}

/// The rows of one scene on one machine.
struct SceneRows<'a> {
    results: &'a Results,
    machine: &'a str,
    name: &'a str,
    triangles: u64,
}

fn scenes(results: &Results) -> Vec<SceneRows<'_>> {
    let mut all: Vec<SceneRows> = Vec::new();
    for row in &results.builds {
        if !all.iter().any(|s| s.machine == row.machine && s.name == row.scene) {
            all.push(SceneRows { results, machine: &row.machine, name: &row.scene, triangles: row.triangles });
        }
    }
    all.sort_by_key(|s| s.triangles);
    all
}

impl<'a> SceneRows<'a> {
    fn traces(&self) -> impl Iterator<Item = &'a Trace> {
        let (machine, name) = (self.machine, self.name);
        self.results.traces.iter().filter(move |r| r.machine == machine && r.scene == name)
    }

    fn builds(&self) -> impl Iterator<Item = &'a Build> {
        let (machine, name) = (self.machine, self.name);
        self.results.builds.iter().filter(move |r| r.machine == machine && r.scene == name)
    }

    fn agreements(&self) -> impl Iterator<Item = &'a Agreement> {
        let (machine, name) = (self.machine, self.name);
        self.results.agreements.iter().filter(move |r| r.machine == machine && r.scene == name)
    }

    fn base_build(&self) -> Option<&'a Build> {
        self.builds().next()
    }

    /// With its machine, where there are several.
    fn title(&self) -> String {
        let several = self.results.builds.iter().any(|b| b.machine != self.machine);
        if several { format!("{}, {}", self.name, self.machine) } else { self.name.to_owned() }
    }

    fn file(&self) -> String {
        let machines = self.results.hosts.iter().map(|h| &h.machine).collect::<Vec<_>>();
        match machines.iter().position(|m| **m == self.machine) {
            None | Some(0) => self.name.to_owned(),
            Some(other) => format!("{}-machine{}", self.name, other + 1),
        }
    }
}

fn page(results: &Results, scenes: &[SceneRows]) -> String {
    let differing = results.differing_pictures();
    let rays = results.agreements.iter().map(|a| a.rays).sum::<u64>();
    let verdict = match (results.unexplained(), differing) {
        (0, 0) => format!("They agree: rounding explains every difference among {rays} compared answers."),
        (hits, pictures) => {
            format!("They do not agree: {hits} of {rays} answers and {pictures} pictures differ without explanation.")
        }
    };
    let lead = format!(
        "Embree and obvhs on the same triangles and the same recorded rays: {} scene{}, every contender in turn with `embree` \
         as the renderer uses it. {verdict}",
        scenes.len(),
        if scenes.len() == 1 { "" } else { "s" },
    );
    let mut page = Page::new("Ray study", &lead);
    page.section("Overview");
    if let Some(plot) = overview(results) {
        page.wide(plot.svg(), "`embree (again)` is the baseline built a second time: where it is not at 1 is noise.");
    }
    page.heading("Over all scenes");
    page.text("Geometric means over the scenes that a contender was measured on, relative to `embree` there.");
    page.table(&averages(results, scenes));
    let costs = costs(results);
    if !costs.is_empty() {
        page.section("Cost over the number of triangles");
        page.row(costs.iter().map(|(_, chart)| chart_figure(chart.svg(), "")));
    }
    compare::section(&mut page, results);
    method(&mut page, results);
    for scene in scenes {
        scene_section(&mut page, scene);
    }
    if !results.notes.is_empty() {
        page.section("Notes");
        results.notes.iter().for_each(|note| page.text(note));
    }
    hosts(&mut page, results);
    page.finish()
}

/// In the order in which they were measured, the baseline first.
pub(super) fn distinct<'a>(names: impl Iterator<Item = &'a str>) -> Vec<&'a str> {
    let mut all: Vec<&str> = Vec::new();
    for name in names {
        if !all.contains(&name) {
            all.push(name);
        }
    }
    all
}

fn streams(results: &Results) -> Vec<&str> {
    distinct(results.traces.iter().map(|t| &*t.stream))
}

fn geometric_mean(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, n) = values.filter(|v| *v > 0.0).fold((0.0, 0), |(s, n), v| (s + v.ln(), n + 1));
    if n == 0 { f64::NAN } else { (sum / f64::from(n)).exp() }
}

fn averages(results: &Results, scenes: &[SceneRows]) -> Table {
    let streams = streams(results);
    let mut columns = vec![("contender", "Backend with its choices"), ("scenes", "How many it was measured on")];
    let speed = "Geometric mean over scenes of the speed over that of embree: above 1 is faster";
    columns.extend(streams.iter().map(|s| (*s, speed)));
    columns.extend([
        ("build", "Geometric mean over scenes of the CPU seconds of a build over those of embree: below 1 is faster"),
        ("memory", "Geometric mean over scenes of the bytes of the structure over those of embree"),
        (
            "picture",
            "Geometric mean over scenes of the speed of a whole render over that with embree, without the build",
        ),
        ("unexplained", "Answers that differ from embree's without an explanation, over all scenes"),
    ]);
    let mut table = Table::new(&columns);
    for name in distinct(results.builds.iter().map(|b| &*b.backend)) {
        let tone = if name == CONTROL || name == BASELINE { Tone::Faint } else { Tone::Plain };
        let built = scenes.iter().filter_map(|s| Some((s.base_build()?, s.builds().find(|b| b.backend == name)?)));
        let built = built.collect::<Vec<_>>();
        let mut row = vec![(name.to_owned(), tone), (built.len().to_string(), tone)];
        for stream in &streams {
            let rows = results.traces.iter().filter(|t| t.backend == name && t.stream == *stream);
            let mean = geometric_mean(rows.map(|t| t.speed_ratio));
            let own = if tone == Tone::Faint { tone } else { judged(mean, 0.02) };
            row.push((number(mean), own));
        }
        let ratio = |of: &dyn Fn(&Build) -> f64| geometric_mean(built.iter().map(|(base, own)| of(own) / of(base)));
        row.push((number(ratio(&|b| b.cpu_seconds)), tone));
        row.push((number(ratio(&|b| b.bytes_per_triangle)), tone));
        let pictures = results.pictures.iter().filter(|p| p.backend == name);
        row.push((number(geometric_mean(pictures.map(|p| p.speed_ratio))), tone));
        let unexplained = results.agreements.iter().filter(|a| a.backend == name).map(|a| a.unexplained).sum::<u64>();
        row.push((unexplained.to_string(), if unexplained > 0 { Tone::Bad } else { tone }));
        table.rows.push(row);
    }
    table
}

/// Good above 1, bad below, beyond two errors.
fn judged(ratio: f64, error: f64) -> Tone {
    match () {
        () if ratio - 2.0 * error > 1.0 => Tone::Good,
        () if ratio + 2.0 * error < 1.0 => Tone::Bad,
        () => Tone::Plain,
    }
}

fn scene_section(page: &mut Page, scene: &SceneRows) {
    page.section(&scene.title());
    let streams = distinct(scene.traces().map(|t| &*t.stream));
    let sizes = streams.iter().filter_map(|s| scene.traces().find(|t| t.stream == *s));
    let sizes = sizes.map(|t| format!("{} {} rays, {:.0} % of them hit", t.stream, t.rays, 100.0 * t.hit_share));
    page.text(&format!("{} triangles. Streams: {}.", scene.triangles, sizes.collect::<Vec<_>>().join("; ")));
    page.row([chart_figure(
        picture(scene).svg(),
        "Measured build, and measured seconds a path times the number of paths, over those of `embree`. Where a line falls below 1, \
         the longer build has paid.",
    )]);
    page.heading("Mrays/s of one thread, and speed over that of embree");
    let mut columns = vec![("contender", "Backend with its choices")];
    for stream in &streams {
        columns.push((stream, "Million rays a CPU second, median of the rounds"));
        columns.push(("", "Speed over that of embree in the same rounds, with the standard error of the median"));
    }
    let mut table = Table::new(&columns);
    let names = distinct(scene.builds().map(|b| &*b.backend));
    for name in &names {
        let mut row = vec![((*name).to_owned(), Tone::Plain)];
        for stream in &streams {
            let found = scene.traces().find(|t| t.backend == *name && t.stream == *stream);
            let (rate, ratio, tone) = match found {
                None => (String::new(), String::new(), Tone::Plain),
                Some(t) if t.speed_ratio_se == 0.0 && t.speed_ratio == 1.0 => {
                    (number(t.mrays_per_second), String::new(), Tone::Faint)
                }
                Some(t) => (
                    number(t.mrays_per_second),
                    with_error(t.speed_ratio, t.speed_ratio_se),
                    judged(t.speed_ratio, t.speed_ratio_se.max(0.01)),
                ),
            };
            row.extend([(rate, Tone::Plain), (ratio, tone)]);
        }
        table.rows.push(row);
    }
    page.table(&table);
    page.heading("Building, and pictures");
    page.table(&builds(scene, &names));
    page.details("Agreement with embree, answer by answer", |page| page.table(&agreement(scene)));
}

fn builds(scene: &SceneRows, names: &[&str]) -> Table {
    let mut table = Table::new(&[
        ("contender", "Backend with its choices"),
        ("build, CPU s", "Processor seconds of all threads, median of the builds"),
        ("wall s", "Seconds with all threads; what else the machine did counts"),
        ("one thread, s", "Wall seconds with one thread"),
        ("bytes/triangle", "Of the finished structure, as the library counts them"),
        ("peak, library", "Bytes a triangle that the library held at most while building, where it says so"),
        ("peak, process", "Bytes a triangle by which the process grew at most while building, by the system's count"),
        ("picture, ms/spp", "CPU milliseconds of one path in every pixel, without the build"),
        ("speed", "Of a picture over that with embree in the same rounds"),
        ("crossover, spp", "Paths a pixel from which on the longer build has paid"),
        ("z", "Picture mean against that with embree, other seeds, in standard errors, worst channel"),
        ("instructions", "Instructions of the processor for one ray of a diffuse bounce; where counters are there"),
        ("threads", "Speed of diffuse bounces with all threads over that with one, by the wall clock"),
    ]);
    for name in names {
        let Some(build) = scene.builds().find(|b| b.backend == *name) else { continue };
        let of_scene =
            |machine: &str, own: &str, backend: &str| machine == scene.machine && own == scene.name && backend == *name;
        let results = scene.results;
        let picture = results.pictures.iter().find(|p| of_scene(&p.machine, &p.scene, &p.backend));
        let scaling = results.scalings.iter().find(|s| of_scene(&s.machine, &s.scene, &s.backend));
        let diffuse = scene.traces().find(|t| t.backend == *name && t.stream == STREAM);
        let text = |value: Option<f64>| value.map_or(String::new(), number);
        let plain = |text: String| (text, Tone::Plain);
        table.rows.push(vec![
            plain((*name).to_owned()),
            plain(number(build.cpu_seconds)),
            plain(number(build.wall_seconds)),
            plain(text(build.one_thread_seconds)),
            plain(number(build.bytes_per_triangle)),
            plain(text(build.peak_bytes_per_triangle)),
            plain(number(build.peak_process_bytes_per_triangle)),
            plain(text(picture.map(|p| 1e3 * p.cpu_seconds_per_spp))),
            picture.map_or(plain(String::new()), |p| {
                (with_error(p.speed_ratio, p.speed_ratio_se), judged(p.speed_ratio, p.speed_ratio_se.max(0.01)))
            }),
            plain(text(picture.and_then(|p| p.crossover_spp))),
            picture.map_or(plain(String::new()), |p| {
                (number(p.bias_z), if p.bias_z.abs() > MOST_Z { Tone::Bad } else { Tone::Plain })
            }),
            plain(text(diffuse.and_then(|t| t.instructions_per_ray))),
            plain(scaling.map_or(String::new(), |s| format!("{}: {}", s.threads, with_error(s.speedup, s.speedup_se)))),
        ]);
    }
    table
}

fn agreement(scene: &SceneRows) -> Table {
    let mut table = Table::new(&[
        ("contender", "Backend with its choices"),
        ("stream", "Which rays"),
        ("rays", "Compared answers"),
        ("edge", "Different triangles, within rounding of an edge"),
        ("coplanar", "Different triangles at the same distance, within rounding"),
        ("grazing", "The ray lies in the triangle's plane, nearly"),
        ("self", "Within rounding of where the ray's interval starts or ends"),
        ("alpha", "The texel at which alpha is looked up differs"),
        ("miss", "One slipped through at an edge and hit nothing"),
        ("unexplained", "Rounding does not explain it"),
    ]);
    for row in scene.agreements().filter(|a| a.same < a.rays) {
        let mut cells = vec![(row.backend.clone(), Tone::Plain), (row.stream.clone(), Tone::Plain)];
        let counts = [row.rays, row.edge, row.coplanar, row.grazing, row.self_hit, row.alpha, row.miss];
        cells.extend(counts.map(|n| (n.to_string(), Tone::Plain)));
        cells.push((row.unexplained.to_string(), if row.unexplained > 0 { Tone::Bad } else { Tone::Plain }));
        table.rows.push(cells);
    }
    table
}
