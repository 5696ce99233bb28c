//! The page and charts of a study of pixels' variances.

mod charts;

use bismar::Result;
use maud::Markup;

use super::table::{self, Level, Outcome, Row};
use super::{Design, Estimator, HALF, SceneResults};
use crate::report::page::map_figure;
use crate::report::{Cell, ColorScale, Page, Table, Tone, percent, with_error};
use charts::{others, overview, scene_charts};

/// Writes `results.csv`, `results.json`, `report.html` and `charts/`.
pub fn write(design: &Design, scenes: &[SceneResults]) -> Result<()> {
    let rows = scenes.iter().flat_map(|s| &s.levels).flat_map(|l| &l.results).map(|o| o.row.clone());
    table::write(design, &rows.collect::<Vec<_>>())?;
    page(design, scenes).write(&design.folder)
}

fn page(design: &Design, scenes: &[SceneResults]) -> Page {
    let spp = design.spp.last().copied().unwrap_or(0);
    let lead = format!(
        "Every estimator against `half` (one light and one BSDF sample per path, balance heuristic): {}",
        design.measured(scenes.len())
    );
    let mut page = Page::new("Balance study", &lead);
    page.section("Overview");
    if let Some(svg) = overview(design, scenes) {
        page.wide(("overview".to_owned(), svg, ""));
    }
    averages(&mut page, scenes, spp);
    for scene in scenes {
        scene_section(&mut page, design, scene);
    }
    page
}

const COLUMNS: &str = "estimator rel_mse cpu_seconds inverse_efficiency time_ratio ratio<1 ratio_of_means<1 \
                       equal_time_ratio<1 worse_surely p50 worst_held_out bias_z";

fn averages(page: &mut Page, scenes: &[SceneResults], spp: u32) {
    let Some(first) = scenes.first().and_then(SceneResults::top) else { return };
    page.heading(&format!("Means over all scenes, {spp} paths a pixel"));
    let of = |estimator: Estimator| {
        let outcomes = scenes.iter().filter_map(SceneResults::top).flat_map(|level| &level.results);
        let own = outcomes.filter(|outcome| outcome.estimator == Some(estimator));
        let rows = own.map(|outcome| &outcome.row).collect::<Vec<_>>();
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
        .faint(|(estimator, _)| *estimator == HALF);
    page.table(&table.end());
}

/// A ratio that is good below 1.
pub(super) fn toned(ratio: f64, error: f64) -> Cell {
    (with_error(ratio, error), Tone::below_one(ratio, error)).into()
}

fn scene_section(page: &mut Page, design: &Design, scene: &SceneResults) {
    page.section(&scene.name);
    let Some(top) = scene.top() else { return };
    page.row(others(top).flat_map(|outcome| maps(design, outcome)));
    page.charts(scene_charts(scene, top));
    page.heading(&format!("{} paths a pixel", top.spp));
    page.table(&level_table(top));
    for level in scene.levels.iter().rev().skip(1) {
        page.details(&format!("{} paths a pixel", level.spp), |page| page.table(&level_table(level)));
    }
}

/// Maps of an estimator's shares and of its variances.
fn maps(design: &Design, outcome: &Outcome) -> [Markup; 2] {
    const RATIO: (ColorScale, [&str; 3]) = (ColorScale::Ratio { factor: 4.0 }, ["¼", "1: as half", "4"]);
    let (size, name) = ([design.width, design.height], &outcome.row.estimator);
    let mut ratios = vec![f64::NAN; (design.width * design.height) as usize];
    outcome.ratios.iter().for_each(|r| ratios[r.pixel] = r.ratio);
    let caption =
        format!("Variance by `{name}` over that by `half`, pixel by pixel, noise included. Grey: not judged.");
    [share_map(size, &outcome.shares, name), map_figure(size, RATIO, ratios.into_iter(), &caption)]
}

pub(super) fn share_map(size: [u32; 2], shares: &[f32], name: &str) -> Markup {
    const SHARE: (ColorScale, [&str; 3]) = (ColorScale::Share, ["0: BSDF alone", "½", "1: light alone"]);
    let shares = shares.iter().map(|&s| f64::from(s));
    map_figure(size, SHARE, shares, &format!("Share of light samples by `{name}`."))
}

fn level_table(level: &Level) -> Table {
    Table::of_fields(&level.results.iter().map(|o| &o.row).collect::<Vec<_>>(), COLUMNS)
}
