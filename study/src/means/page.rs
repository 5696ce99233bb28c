//! Files of `bismar study means`.

use std::path::Path;

use bismar::Result;
use serde::Serialize;

use super::{Control, Results, Row};
use crate::files;
use crate::provenance::Provenance;
use crate::report::{Page, Table, Tone, number, with_error};

/// Raised when a field changes its meaning or is removed.
const SCHEMA: u32 = 1;

const LEAD: &str = "Random scenes, rendered in all ways that must have one mean, against `--balance half` with four times the \
paths. `docs/study-balance.md` says how this is tested.";

/// Means over all scenes, a row per way.
pub fn ways(results: &Results) -> Table {
    let difference =
        |mean: Option<f64>, error: Option<f64>| mean.zip(error).map(|(x, e)| with_error(100.0 * x, 100.0 * e));
    Table::of(&results.ways)
        .column("way", "", |way| way.way.clone())
        .column("scenes", "", |way| way.scenes.to_string())
        .column("rendered again", "scenes with a difference that chance may explain", |way| {
            way.rendered_again.to_string()
        })
        .column("wrong", "scenes that differ again, with other seeds", |way| {
            (way.wrong_scenes.to_string(), if way.wrong_scenes > 0 { Tone::Bad } else { Tone::Plain })
        })
        .column(
            "difference %",
            "of the means of whole pictures, over the scenes that are not wrong; marked where it or that of a block is",
            |way| {
                let text = difference(way.difference, way.difference_se).unwrap_or_default();
                (text, if way.wrong { Tone::Bad } else { Tone::Plain })
            },
        )
        .end()
}

/// Controls: what must be caught.
pub fn controls(controls: &[Control]) -> Table {
    Table::of(controls)
        .column("control", "", |control| control.name.clone())
        .column("caught", "by means over all scenes: ways of those that most scenes have", |control| {
            let tone = if control.is_caught() { Tone::Good } else { Tone::Bad };
            (format!("{} of {}", control.caught, control.of), tone)
        })
        .column("at least", "", |control| control.least.map_or("–".to_owned(), |least| least.to_string()))
        .end()
}

/// Wrong means, with a command for the worst of each scene.
pub fn wrong(results: &Results) -> Table {
    Table::of(&results.wrong().collect::<Vec<_>>())
        .column("scene", "", |row| row.seed.to_string())
        .words("way", |row| row.way.clone())
        .column("region", "0: the whole picture; else a block of 8 x 8 pixels", |row| row.region.to_string())
        .column("difference %", "", |row| row.again_difference.map(|x| number(100.0 * x)))
        .column("t", "in standard errors", |row| row.again_t)
        .words("smallest scene", |row| row.command.clone().unwrap_or_default())
        .end()
}

/// Writes `report.html`, `results.csv` and `results.json` into a folder.
pub fn write(folder: &Path, results: &Results) -> Result<()> {
    #[derive(Serialize)]
    struct Document<'a> {
        schema: u32,
        version: &'a str,
        run: Provenance,
        #[serde(flatten)]
        results: &'a Results,
    }
    let mut page = Page::new("One mean", LEAD);
    page.section("Ways");
    page.text(&format!(
        "{} scenes, {} pictures of {} paths per pixel in each way. The chance that a program without a fault is called wrong is \
         at most {:.2} %.",
        results.scenes,
        results.replicas,
        results.spp,
        100.0 * results.false_alarm
    ));
    page.table(&ways(results));
    page.section("Controls");
    page.table(&controls(&results.controls));
    page.section("Wrong means");
    page.table(&wrong(results));
    let run = Provenance::now(&[("scenes", results.rows.first().map_or(0, |row| row.seed))]);
    let document = Document { schema: SCHEMA, version: env!("CARGO_PKG_VERSION"), run, results };
    files::write_json(&folder.join("results.json"), &document)?;
    files::write_csv::<Row>(&folder.join("results.csv"), &results.rows)?;
    page.write(folder)
}
