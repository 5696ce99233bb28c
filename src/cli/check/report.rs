//! Checks as text, JSON and JUnit XML.

use std::fmt::Write as _;
use std::path::Path;

use maud::{PreEscaped, html};
use serde_json::json;

use super::outcome::{Check, Limit, Outcome};
use crate::Result;
use crate::cli::compare::page::{save, shown};
use crate::job;

/// Schema version of the JSON; raised when a field changes its meaning or is removed.
const SCHEMA: u32 = 1;
/// Channels that a line names.
const MOST_CHANNELS: usize = 6;

/// What became of a golden picture, in a line.
pub fn line(check: &Check) -> String {
    let updated = if check.updated { "; updated" } else { "" };
    match &check.outcome {
        Outcome::Pending | Outcome::Identical => check.outcome.name().into(),
        Outcome::Failed { error, .. } => error.clone(),
        Outcome::Other { unlike: Some(why), .. } => format!("differs: {why}{updated}"),
        Outcome::Other { flip, channels, .. } => {
            let named = channels.iter().take(MOST_CHANNELS).map(|c| format!("{} ({})", c.name, c.pixels));
            let named = named.collect::<Vec<_>>().join(", ");
            let more = if channels.len() > MOST_CHANNELS { ", …" } else { "" };
            format!("{}: FLIP {flip:.4}; pixels that differ: {named}{more}{updated}", check.outcome.name())
        }
    }
}

/// How many became what.
pub fn summary(checks: &[Check], seconds: f64) -> String {
    let mut text = format!("{} golden pictures:", checks.len());
    for name in ["identical", "alike", "differs", "failed"] {
        let count = checks.iter().filter(|check| check.outcome.name() == name).count();
        let name = if name == "differs" { "different" } else { name };
        let _ = write!(text, " {count} {name},");
    }
    let updated = checks.iter().filter(|check| check.updated).count();
    if updated > 0 {
        let _ = write!(text, " {updated} updated,");
    }
    let _ = write!(text, " in {seconds:.1} s");
    text
}

pub fn write_json(path: &Path, checks: &[Check], limit: Limit, seconds: f64) -> Result<()> {
    let one = |check: &Check| {
        let mut value = json!({
            "golden": check.golden.display().to_string(),
            "scene": check.scene,
            "outcome": check.outcome.name(),
            "passes": check.outcome.passes(),
            "updated": check.updated,
            "seconds": check.seconds,
        });
        match &check.outcome {
            Outcome::Other { flip, channels, unlike, .. } => {
                value["flip"] = json!(flip);
                value["channels"] = json!(channels);
                value["new"] = json!((!check.updated).then(|| check.new.display().to_string()));
                value["error"] = json!(unlike);
            }
            Outcome::Failed { exit_code, error } => {
                value["exit_code"] = json!(exit_code);
                value["error"] = json!(error);
            }
            Outcome::Pending | Outcome::Identical => {}
        }
        value
    };
    let goldens: Vec<_> = checks.iter().map(one).collect();
    let version = env!("CARGO_PKG_VERSION");
    job::write_json(
        path,
        &json!({ "schema": SCHEMA, "version": version, "seconds": seconds, "limit": limit, "goldens": goldens }),
    )
}

/// Writes JUnit XML: a test case for each golden picture.
pub(crate) fn write_junit(path: &Path, checks: &[Check]) -> Result<()> {
    let is_error = |check: &Check| check.outcome.exit_code().is_some();
    let is_failure = |check: &Check| !is_error(check) && !check.outcome.passes() && !check.updated;
    let count = |of: &dyn Fn(&Check) -> bool| checks.iter().filter(|check| of(check)).count();
    let seconds = |seconds: f64| format!("{seconds:.3}");
    let all = checks.iter().map(|check| check.seconds).sum();
    save(
        path,
        &html! {
            (PreEscaped("<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n"))
            testsuite name="bismar check" tests=(checks.len()) failures=(count(&is_failure)) errors=(count(&is_error))
                time=(seconds(all)) {
                @for check in checks {
                    testcase classname="bismar" name=(shown(&check.golden.display().to_string())) time=(seconds(check.seconds)) {
                        @if is_error(check) { error message=(shown(&line(check))) {} }
                        @if is_failure(check) { failure message=(shown(&line(check))) {} }
                    }
                }
            }
        },
    )
}
