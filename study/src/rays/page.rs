//! The page and its charts.

mod charts;
mod method;

use std::path::Path;

use bismar::Result;

use super::compare;
use super::measure::CONTROL;
use super::table::{BASELINE, Build, MAX_Z, Results, SceneRows, distinct, scenes};
use crate::report::page::chart_figure;
use crate::report::{self, Cell, Page, Table, Tone, number, plural, with_error};
use charts::{STREAM, costs, overview, picture};
use method::{hosts, method};

/// Writes tables, `report.html` and `charts/`.
pub fn write(folder: &Path, results: &Results) -> Result<()> {
    results.write(folder)?;
    let scenes = scenes(results);
    let pictures = scenes.iter().map(|s| (format!("{}-picture", s.file()), picture(s)));
    let charts = costs(results).into_iter().chain(pictures).map(|(name, chart)| (name, chart.file()));
    let overview = overview(results).map(|plot| ("overview".to_owned(), plot.file()));
    report::write(folder, page(results, &scenes), charts.chain(overview))
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
        plural(scenes.len()),
    );
    let mut page = Page::new("Ray study", &lead);
    page.section("Overview");
    if let Some(plot) = overview(results) {
        page.wide(plot.svg(), "`embree (again)` is the baseline built a second time: its distance from 1 is noise.");
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

fn streams(results: &Results) -> Vec<&str> {
    distinct(results.traces.iter().map(|t| &*t.stream))
}

fn geometric_mean(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, n) = values.filter(|v| *v > 0.0).fold((0.0, 0), |(s, n), v| (s + v.ln(), n + 1));
    if n == 0 { f64::NAN } else { (sum / f64::from(n)).exp() }
}

fn averages(results: &Results, scenes: &[SceneRows]) -> Table {
    let reference = |name: &str| name == CONTROL || name == BASELINE;
    let builds = |name: &str| {
        let built = scenes.iter().filter_map(|s| Some((s.base_build()?, s.builds().find(|b| b.backend == name)?)));
        built.collect::<Vec<_>>()
    };
    let of_base = |name: &str, of: fn(&Build) -> f64| {
        geometric_mean(builds(name).into_iter().map(|(base, own)| of(own) / of(base)))
    };
    let names = distinct(results.builds.iter().map(|b| &*b.backend));
    let mut table = Table::of(&names).column("contender", "Backend with its options", |name| *name).column(
        "scenes",
        "Number of scenes",
        |name| builds(name).len() as u64,
    );
    for stream in streams(results) {
        let speed = |name: &&str| {
            let rows = results.traces.iter().filter(|t| t.backend == *name && t.stream == stream);
            let mean = geometric_mean(rows.map(|t| t.speed_ratio));
            (number(mean), Tone::above_one(mean, 0.02))
        };
        table = table.column(
            stream,
            "Geometric mean over scenes of the speed over that of embree: above 1 is faster",
            speed,
        );
    }
    table
        .column(
            "build",
            "Geometric mean over scenes of the CPU seconds of a build over those of embree: below 1 is faster",
            |name| of_base(name, |b| b.cpu_seconds),
        )
        .column("memory", "Geometric mean over scenes of the bytes of the structure over those of embree", |name| {
            of_base(name, |b| b.bytes_per_triangle)
        })
        .column(
            "picture",
            "Geometric mean over scenes of the speed of a whole render over that with embree, without the build",
            |name| geometric_mean(results.pictures.iter().filter(|p| p.backend == *name).map(|p| p.speed_ratio)),
        )
        .faint(|name| reference(name))
        .column("unexplained", "Answers that differ from embree's without an explanation, over all scenes", |name| {
            let unexplained = results.agreements.iter().filter(|a| a.backend == *name).map(|a| a.unexplained).sum();
            match unexplained {
                0 if reference(name) => ("0".to_owned(), Tone::Faint).into(),
                n => errors(n),
            }
        })
        .end()
}

/// A number that is to be zero.
fn errors(n: u64) -> Cell {
    (n.to_string(), if n > 0 { Tone::Bad } else { Tone::Plain }).into()
}

/// A speed ratio that is good above 1; differences below 2 % do not count.
fn speed(ratio: f64, error: f64) -> Cell {
    (with_error(ratio, error), Tone::above_one(ratio, error.max(0.01))).into()
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
         the longer build has paid off.",
    )]);
    page.heading("Mrays/s of one thread, and speed over that of embree");
    let names = distinct(scene.builds().map(|b| &*b.backend));
    let mut table = Table::of(&names).column("contender", "Backend with its options", |name| *name);
    for stream in streams {
        let trace = |name: &str| scene.traces().find(|t| t.backend == name && t.stream == stream);
        table = table
            .column(stream, "Million rays a CPU second, median of the rounds", |name| {
                trace(name).map(|t| t.mrays_per_second)
            })
            .column(
                "",
                "Speed over that of embree in the same rounds, with the standard error of the median",
                |name| {
                    let other = trace(name).filter(|t| t.speed_ratio_se != 0.0 || t.speed_ratio != 1.0);
                    other.map(|t| speed(t.speed_ratio, t.speed_ratio_se))
                },
            );
    }
    page.table(&table.end());
    page.heading("Building, and pictures");
    page.table(&builds(scene, &names));
    page.details("Agreement with embree, answer by answer", |page| page.table(&agreement(scene)));
}

fn builds(scene: &SceneRows, names: &[&str]) -> Table {
    let rows = names.iter().filter_map(|name| scene.builds().find(|b| b.backend == *name)).collect::<Vec<_>>();
    let picture = |b: &Build| {
        let pictures = &scene.results.pictures;
        pictures.iter().find(|p| p.machine == b.machine && p.scene == b.scene && p.backend == b.backend)
    };
    let scaling = |b: &Build| {
        let scalings = &scene.results.scalings;
        scalings.iter().find(|s| s.machine == b.machine && s.scene == b.scene && s.backend == b.backend)
    };
    let diffuse = |b: &Build| scene.traces().find(|t| t.backend == b.backend && t.stream == STREAM);
    Table::of(&rows)
        .column("contender", "Backend with its options", |b| &*b.backend)
        .column("build, CPU s", "Processor seconds of all threads, median of the builds", |b| b.cpu_seconds)
        .column("wall s", "Seconds with all threads; other load on the machine counts", |b| b.wall_seconds)
        .column("one thread, s", "Wall seconds with one thread", |b| b.one_thread_seconds)
        .column("bytes/triangle", "Of the finished structure, as the library counts them", |b| b.bytes_per_triangle)
        .column(
            "peak, library",
            "Largest number of bytes a triangle that the library held while building, if it says so",
            |b| b.peak_bytes_per_triangle,
        )
        .column(
            "peak, process",
            "Largest growth of the process while building, in bytes a triangle, by the system's count",
            |b| b.peak_process_bytes_per_triangle,
        )
        .column("picture, ms/spp", "CPU milliseconds of one path in every pixel, without the build", |b| {
            picture(b).map(|p| 1e3 * p.cpu_seconds_per_spp)
        })
        .column("speed", "Of a picture over that with embree in the same rounds", |b| {
            picture(b).map(|p| speed(p.speed_ratio, p.speed_ratio_se))
        })
        .column("crossover, spp", "Paths a pixel from which on the longer build pays off", |b| {
            picture(b).and_then(|p| p.crossover_spp)
        })
        .column("z", "Picture mean against that with embree, other seeds, in standard errors, worst channel", |b| {
            picture(b).map(|p| (number(p.bias_z), if p.bias_z.abs() > MAX_Z { Tone::Bad } else { Tone::Plain }))
        })
        .column("instructions", "Instructions per ray of a diffuse bounce; needs hardware counters", |b| {
            diffuse(b).and_then(|t| t.instructions_per_ray)
        })
        .column("threads", "Speed of diffuse bounces with all threads over that with one, by the wall clock", |b| {
            scaling(b).map(|s| format!("{}: {}", s.threads, with_error(s.speedup, s.speedup_se)))
        })
        .end()
}

fn agreement(scene: &SceneRows) -> Table {
    let rows = scene.agreements().filter(|a| a.same < a.rays).collect::<Vec<_>>();
    Table::of(&rows)
        .column("contender", "Backend with its options", |a| &*a.backend)
        .column("stream", "Kind of rays", |a| &*a.stream)
        .column("rays", "Compared answers", |a| a.rays)
        .column("edge", "Different triangles, within rounding of an edge", |a| a.edge)
        .column("coplanar", "Different triangles at the same distance, within rounding", |a| a.coplanar)
        .column("grazing", "The ray lies nearly in the triangle's plane", |a| a.grazing)
        .column("self", "Within rounding of the start or end of the ray's interval", |a| a.self_hit)
        .column("alpha", "The texel at which alpha is looked up differs", |a| a.alpha)
        .column("miss", "One ray passed at an edge and hit nothing", |a| a.miss)
        .column("unexplained", "Rounding does not explain it", |a| errors(a.unexplained))
        .end()
}
