//! The page and charts of a study of pixels' variances.

mod charts;
pub(super) mod pictures;

use bismar::Result;

use super::scene_results::SceneResults;
use super::table::{self, Level, Row};
use super::{Design, Estimator, HALF};
use crate::report::{Cell, Page, Table, Tone, percent, with_error};
use charts::{overview, scene_charts};
use pictures::{by_eye, pictures, worst_pixels};

/// Writes `results.csv`, `results.json`, `report.html` and `charts/`.
pub fn write(design: &Design, scenes: &[SceneResults]) -> Result<()> {
    let rows = scenes.iter().flat_map(|s| &s.levels).flat_map(|l| &l.results).map(|o| o.row.clone());
    table::write(design, &rows.collect::<Vec<_>>())?;
    page(design, scenes)?.write(&design.folder)
}

fn page(design: &Design, scenes: &[SceneResults]) -> Result<Page> {
    let spp = design.spp.last().copied().unwrap_or(0);
    let lead = format!(
        "Every estimator against `half` (one light and one BSDF sample per path, balance heuristic): {}",
        design.measured(scenes.len())
    );
    let mut page = Page::new("Balance study", &lead);
    page.section("Overview");
    if let Some(svg) = overview(design, scenes) {
        let oracle = scenes.iter().any(|s| s.outcome(Estimator::Oracle).is_some());
        let caption = "The oracle is not a method: it is the best fixed share of each pixel, found by brute force.";
        page.wide(("overview".to_owned(), svg, if oracle { caption } else { "" }));
    }
    averages(&mut page, scenes, spp);
    for scene in scenes {
        scene_section(&mut page, design, scene)?;
    }
    Ok(page)
}

/// Columns of [`Row`].
const COLUMNS: &str = "estimator rel_mse cpu_seconds inverse_efficiency time_ratio ratio<1 ratio_of_means<1 \
                       equal_time_ratio<1 found_ratio to_oracle worse worse_surely p50 p95 p99 p100 \
                       worst_held_out bias_z";

fn averages(page: &mut Page, scenes: &[SceneResults], spp: u32) {
    let Some(first) = scenes.first().and_then(SceneResults::top) else { return };
    page.heading(&format!("Means over all scenes, {spp} paths a pixel"));
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
        .column("ratio", "", |r| toned(mean(r, |r| r.ratio), error(r, |r| r.ratio_se)))
        .column("worst scene", "", |(_, rows)| rows.iter().map(|r| r.ratio).fold(f64::NAN, f64::max))
        .column("equal time ratio", "", |r| {
            with_error(mean(r, |r| r.equal_time_ratio), error(r, |r| r.equal_time_ratio_se))
        })
        .column("time ratio", "", |r| mean(r, |r| r.time_ratio))
        .column("worse surely", "", |r| percent(mean(r, |r| r.worse_surely)))
        .faint(|(estimator, _)| matches!(*estimator, Estimator::Oracle | HALF));
    page.table(&table.end());
}

/// A ratio that is good below 1.
pub(super) fn toned(ratio: f64, error: f64) -> Cell {
    (with_error(ratio, error), Tone::below_one(ratio, error)).into()
}

fn scene_section(page: &mut Page, design: &Design, scene: &SceneResults) -> Result<()> {
    page.section(&scene.name);
    let Some(top) = scene.top() else { return Ok(()) };
    let outcome = scene.outcome(Estimator::Method(scene.portrait.shown));
    if let Some(outcome) = outcome {
        pictures(page, design, scene, outcome);
    }
    page.charts(scene_charts(scene, top));
    page.heading(&format!("{} paths a pixel", top.spp));
    page.table(&level_table(top));
    for level in scene.levels.iter().rev().skip(1) {
        page.details(&format!("{} paths a pixel", level.spp), |page| page.table(&level_table(level)));
    }
    by_eye(page, design, scene);
    outcome.map_or(Ok(()), |outcome| worst_pixels(page, design, scene, outcome))
}

fn level_table(level: &Level) -> Table {
    Table::of_fields(&level.results.iter().map(|o| &o.row).collect::<Vec<_>>(), COLUMNS)
}
