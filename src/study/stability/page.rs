//! The tables of the stability study: for `docs` as Markdown, for people as a page, for programs as JSON.

use std::path::Path;

use super::judge::{Outcome, Verdict};
use super::{ModeReport, Report};
use crate::balance::Balance;
use crate::film::atomic;
use crate::report::{Page, Table, Tone, number};
use crate::{Error, Result};

/// Raised when a field changes its meaning or goes away.
const SCHEMA: u32 = 1;

/// A number with its mark and tone.
fn marked(text: String, verdict: Verdict) -> (String, Tone) {
    match verdict {
        Verdict::Survives => (text, Tone::Plain),
        Verdict::Unsure => (format!("{text} ?"), Tone::Faint),
        Verdict::Fails => (format!("{text} ✗"), Tone::Bad),
        Verdict::Wrong => ("wrong ✗".to_owned(), Tone::Bad),
    }
}

/// Two decimals are what there is to compare; more digits of a large failure are noise.
fn ratio(x: f64) -> String {
    match x {
        f64::INFINITY => "∞".to_owned(),
        x if x < 100.0 => format!("{x:.2}"),
        x => number(x),
    }
}

fn name_of(mode: &ModeReport) -> String {
    format!("{} {}", mode.mode, mode.name)
}

/// A table with a row a mode and a column an estimator.
fn by_mode(report: &Report, last: &[(&str, &str)], mut cells: impl FnMut(&ModeReport) -> Vec<(String, Tone)>) -> Table {
    let mut table = Table::new(&[("mode", "failure mode")]);
    table.columns.extend(Balance::all().iter().map(|b| (b.name(), String::new())));
    table.columns.extend(last.iter().map(|(a, b)| ((*a).to_owned(), (*b).to_owned())));
    for mode in &report.modes {
        let mut row = vec![(name_of(mode), Tone::Plain)];
        row.extend(cells(mode));
        table.rows.push(row);
    }
    table
}

/// The worst pixel and channel of each.
pub fn survival(report: &Report) -> Table {
    let cell = |m: &ModeReport, o: &Outcome| marked(ratio(o.worst_ratio), report.verdict(m, o));
    by_mode(report, &[("bar", "largest ratio that counts as survived")], |m| {
        let own = m.outcomes.iter().map(|o| cell(m, o));
        own.chain([(ratio(m.bar), Tone::Faint)]).collect()
    })
}

/// Mean ratios, and the limit.
fn means(report: &Report) -> Table {
    by_mode(report, &[("best fixed share", "least variance of any counts that are fixed beforehand")], |m| {
        let own = m.outcomes.iter().map(|o| (ratio(o.mean_ratio), Tone::Plain));
        own.chain([(m.best.map_or("–".to_owned(), ratio), Tone::Faint)]).collect()
    })
}

/// Largest |z| of each, and the replicas.
fn unbiased(report: &Report) -> Table {
    by_mode(report, &[("tests", "z-tests an estimator"), ("replicas", "")], |m| {
        let tests = m.outcomes.first().map_or(0, |o| o.tests).to_string();
        let own = m.outcomes.iter().map(|o| {
            let wrong = report.verdict(m, o) == Verdict::Wrong;
            marked(format!("{:.1}", o.z), if wrong { Verdict::Fails } else { Verdict::Survives })
        });
        own.chain([(tests, Tone::Faint), (m.replicas.to_string(), Tone::Faint)]).collect()
    })
}

/// Mean share and its scatter.
fn shares(report: &Report) -> Table {
    by_mode(report, &[], |m| {
        m.outcomes.iter().map(|o| (format!("{:.2} ± {:.2}", o.share, o.share_sd), Tone::Plain)).collect()
    })
}

fn constructs(report: &Report) -> Table {
    let mut table = Table::new(&[("mode", ""), ("how it is posed", ""), ("paths a pixel", ""), ("by", "")]);
    for m in &report.modes {
        let by = if m.rendered { "renders" } else { "exact variances" };
        let cells = [name_of(m), m.construct.to_owned(), m.paths.to_string(), by.to_owned()];
        table.rows.push(cells.map(|c| (c, Tone::Plain)).to_vec());
    }
    table
}

fn facts(report: &Report) -> Table {
    let mut table = Table::new(&[("mode", ""), ("samples", ""), ("right", "")]);
    let names = report.facts.first().map_or(&[][..], |f| &f.answers).iter();
    table.columns.extend(names.map(|(name, ..)| (name.clone(), String::new())));
    for fact in &report.facts {
        let mut row = [fact.mode, fact.shown, fact.right].map(|t| (t.to_owned(), Tone::Plain)).to_vec();
        row.extend(fact.answers.iter().map(|(_, share, right)| {
            marked(format!("{share:.3}"), if *right { Verdict::Survives } else { Verdict::Fails })
        }));
        table.rows.push(row);
    }
    table
}

fn controls(report: &Report) -> Table {
    let mut table = Table::new(&[
        ("control", ""),
        ("what is wrong with it", ""),
        ("bias", ""),
        ("largest z", ""),
        ("worst ratio", ""),
        ("check", ""),
        ("caught", ""),
    ]);
    for c in &report.controls {
        let o = &c.outcome;
        // Its passes are correlated: there is no exact variance.
        let worst = if c.check.starts_with('z') { "–".to_owned() } else { ratio(o.worst_ratio) };
        let cells = [
            o.estimator.clone(),
            format!("{} ({})", c.name, c.mode),
            format!("{:+.2} %", 100.0 * o.bias).replace('-', "−"),
            format!("{:.1}", o.z),
            worst,
            c.check.to_owned(),
        ];
        let mut row = cells.map(|c| (c, Tone::Plain)).to_vec();
        row.push(if c.caught { ("yes".to_owned(), Tone::Good) } else { ("NO".to_owned(), Tone::Bad) });
        table.rows.push(row);
    }
    table
}

const LEAD: &str = "Every `--balance` through the failure modes of adaptive sampling. The numbers are variances over that \
of `half` with as many paths, in the worst pixel and colour channel: 1 is no harm, below 1 is a gain.";
const WORST: &str = "✗: beyond the mode's bar for sure, ?: beyond it by no more than chance explains. `power` and `max` do \
not adapt: what they lose, they lose by their weights.";
const SHARES: &str = "Mean share of light samples in the last pass ± its standard deviation between replicas: F10 asks how \
much it scatters where all pixels are alike.";
const FACTS: &str = "The share of light samples after samples that break naive rules. What is broken must not count.";

struct Part {
    title: &'static str,
    text: String,
    table: Table,
}

fn parts(report: &Report) -> Vec<Part> {
    let family = format!(
        "Largest |mean − truth| in standard errors over all pixels, channels and the picture's mean. All {} tests together \
         raise a false alarm with a chance of {} at most (Bonferroni, normal tail bounded): the limit is {:.2}. Exact cases \
         are tested against the exact truth, renders against renders by `half` with other seeds.",
        report.tests, report.false_alarm, report.z_limit
    );
    let part = |title, text: &str, table| Part { title, text: text.to_owned(), table };
    vec![
        part("Who survives what", WORST, survival(report)),
        part("On average", "The same ratios, averaged over pixels and channels.", means(report)),
        part("Means", &family, unbiased(report)),
        part("Controls", "Wrong on purpose: a check that does not catch them is worth nothing.", controls(report)),
        part("Shares", SHARES, shares(report)),
        part("Shares after hard samples", FACTS, facts(report)),
        part("The modes", METHOD, constructs(report)),
    ]
}

const METHOD: &str = "Exact cases are pictures of 4 x 4 pixels whose integrands have a few places each. A replica takes an \
estimator's passes sample by sample, with the same functions as a render; the variance of its result follows exactly from \
the shares that it chose (passes are uncorrelated). Renders are 4 x 4 pixels; their variances are measured over replicas \
that have the same seeds for all estimators.";

/// The tables for `docs`.
pub fn markdown(report: &Report) -> String {
    let mut text = "# Where methods fail\n\nWritten by `bismar study stability`; not by hand.\n".to_owned();
    text += &format!("\n{LEAD}\n");
    for part in parts(report) {
        text += &format!("\n## {}\n\n{}\n\n{}", part.title, part.text, part.table.markdown());
    }
    text
}

/// Writes `stability.md`, `stability.json` and `stability.html` into a folder.
///
/// # Errors
/// As [`atomic::write`].
pub fn write(folder: &Path, report: &Report) -> Result<()> {
    let mut page = Page::new("Where methods fail", LEAD);
    for part in parts(report) {
        page.section(part.title);
        page.text(&part.text);
        page.table(&part.table);
    }
    #[derive(serde::Serialize)]
    struct Results<'a> {
        schema: u32,
        version: &'a str,
        #[serde(flatten)]
        report: &'a Report,
    }
    let results = Results { schema: SCHEMA, version: env!("CARGO_PKG_VERSION"), report };
    let json = serde_json::to_string_pretty(&results).map_err(|e| Error::Bug(format!("JSON: {e}")))?;
    for (name, text) in [("md", markdown(report)), ("json", json), ("html", page.finish())] {
        let path = folder.join("stability").with_extension(name);
        atomic::write(&path, |file| Ok(Ok(std::io::Write::write_all(file, text.as_bytes())?)))?;
    }
    Ok(())
}
