//! The page and its charts.

mod charts;

use std::path::Path;

use bismar::Result;

use super::measure::CONTROL;
use super::table::{BASELINE, Results, distinct, scenes};
use crate::report::{Page, Table, Tone, number, plural};
use charts::{costs, overview, picture};

/// Writes tables, `report.html` and `charts/`.
pub fn write(folder: &Path, results: &Results) -> Result<()> {
    results.write(folder)?;
    page(results, &scenes(results)).write(folder)
}

fn page(results: &Results, scenes: &[(&str, u64)]) -> Page {
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
         as the renderer uses it. {verdict} `docs/study-rays.md` says how this was measured, and what the columns mean.",
        scenes.len(),
        plural(scenes.len()),
    );
    let mut page = Page::new("Ray study", &lead);
    page.section("Overview");
    if let Some(svg) = overview(results) {
        let caption = "`embree (again)` is the baseline built a second time: its distance from 1 is noise.";
        page.wide(("overview".to_owned(), svg, caption));
    }
    page.heading("Speed over that of embree, geometric means over the scenes");
    page.table(&averages(results));
    let costs = costs(results);
    if !costs.is_empty() {
        page.section("Cost over the number of triangles");
        page.charts(costs);
    }
    for (name, triangles) in scenes {
        page.section(name);
        page.text(&format!("{triangles} triangles."));
        scene_section(&mut page, results, name);
    }
    if !results.notes.is_empty() {
        page.section("Notes");
        results.notes.iter().for_each(|note| page.text(note));
    }
    page.section("The machine");
    let host = "machine kernel embree embree_isa obvhs load_before load_after stolen_share";
    page.table(&Table::of_fields(&results.hosts, host));
    page
}

fn geometric_mean(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, n) = values.filter(|v| *v > 0.0).fold((0.0, 0), |(s, n), v| (s + v.ln(), n + 1));
    if n == 0 { f64::NAN } else { (sum / f64::from(n)).exp() }
}

fn averages(results: &Results) -> Table {
    let names = distinct(results.builds.iter().map(|b| &*b.backend));
    let mut table = Table::of(&names).column("contender", "", |name| *name);
    for stream in distinct(results.traces.iter().map(|t| &*t.stream)) {
        table = table.column(stream, "", |name| {
            let rows = results.traces.iter().filter(|t| t.backend == *name && t.stream == stream);
            let mean = geometric_mean(rows.map(|t| t.speed_ratio));
            (number(mean), Tone::above_one(mean, 0.02))
        });
    }
    table
        .column("picture", "", |name| {
            geometric_mean(results.pictures.iter().filter(|p| p.backend == *name).map(|p| p.speed_ratio))
        })
        .faint(|name| [CONTROL, BASELINE].contains(name))
        .end()
}

fn scene_section(page: &mut Page, results: &Results, scene: &str) {
    page.charts([(
        format!("{scene}-picture"),
        picture(results, scene),
        "Measured build, and measured seconds a path times the number of paths, over those of `embree`. Where a line falls below 1, \
         the longer build has paid off.",
    )]);
    let traces = results.traces.iter().filter(|t| t.scene == scene).collect::<Vec<_>>();
    let speed = "stream backend rays hit_share mrays_per_second speed_ratio>1";
    page.table(&Table::of_fields(&traces, speed));
    page.heading("Builds");
    let builds = results.builds.iter().filter(|b| b.scene == scene).collect::<Vec<_>>();
    let costs = "backend cpu_seconds wall_seconds one_thread_seconds bytes_per_triangle peak_bytes_per_triangle \
                 peak_process_bytes_per_triangle";
    page.table(&Table::of_fields(&builds, costs));
    page.heading("Pictures");
    let pictures = results.pictures.iter().filter(|p| p.scene == scene).collect::<Vec<_>>();
    page.table(&Table::of_fields(&pictures, "backend cpu_seconds_per_spp speed_ratio>1 crossover_spp bias_z"));
    let differing = results.agreements.iter().filter(|a| a.scene == scene && a.same < a.rays).collect::<Vec<_>>();
    if !differing.is_empty() {
        page.heading("Where answers differ");
        let classes = "backend stream rays same edge coplanar grazing self_hit alpha miss unexplained";
        page.table(&Table::of_fields(&differing, classes));
    }
}
