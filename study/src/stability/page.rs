//! Tables of the stability study as Markdown (for `docs`), an HTML page, and JSON.

use std::path::Path;

use bismar::Result;

use super::judge::{Outcome, Verdict};
use super::scenes::OTHER_SEEDS;
use super::simulate::Subject;
use super::{Control, Found, ModeResult, Results, guiding};
use crate::files;
use crate::provenance::Provenance;
use crate::report::{Page, Table, Tone, number};

/// Version of the JSON. It rises when a field changes its meaning or is removed.
const SCHEMA: u32 = 1;

/// A number with the mark and tone of its verdict.
fn marked(text: String, verdict: Verdict) -> (String, Tone) {
    match verdict {
        Verdict::Survives => (text, Tone::Plain),
        Verdict::Unsure => (format!("{text} ?"), Tone::Faint),
        Verdict::Fails => (format!("{text} ✗"), Tone::Bad),
        Verdict::Wrong => ("wrong ✗".to_owned(), Tone::Bad),
    }
}

/// A variance ratio with its verdict. It has three decimals if two would round it to the bar; an unsure one has its
/// standard error.
pub(super) fn judged(outcome: &Outcome, bar: f64, verdict: Verdict) -> (String, Tone) {
    let (worst, error) = (outcome.worst_ratio, outcome.worst_se);
    let text = match ratio(worst) {
        rounded if rounded == ratio(bar) && verdict != Verdict::Survives => format!("{worst:.3}"),
        rounded => rounded,
    };
    match verdict {
        Verdict::Unsure if worst - bar < 0.01 => marked(format!("{text} ± {error:.3}"), verdict),
        Verdict::Unsure => marked(format!("{text} ± {error:.2}"), verdict),
        _ => marked(text, verdict),
    }
}

/// The largest |z| of an estimator in a mode, with its verdict.
pub(super) fn largest_z(outcome: &Outcome, verdict: Verdict) -> (String, Tone) {
    let verdict = if verdict == Verdict::Wrong { Verdict::Fails } else { Verdict::Survives };
    marked(format!("{:.1}", outcome.z), verdict)
}

/// A variance ratio with two decimals, or three significant digits from 100 on.
pub(super) fn ratio(x: f64) -> String {
    match x {
        f64::INFINITY => "∞".to_owned(),
        x if x < 100.0 => format!("{x:.2}"),
        x => number(x),
    }
}

fn name_of(mode: &ModeResult) -> String {
    format!("{} {}", mode.mode, mode.name)
}

fn none() -> (String, Tone) {
    ("–".to_owned(), Tone::Faint)
}

/// A table with a row per mode, a column per estimator, and further columns.
fn by_mode(
    results: &Results,
    cell: impl Fn(&ModeResult, &Outcome) -> (String, Tone),
    last: &[(&str, &str)],
    others: impl Fn(&ModeResult) -> Vec<String>,
) -> Table {
    let mut table = Table::new(&[("mode", "failure mode")]);
    let names: Vec<_> = Subject::shown().into_iter().map(Subject::name).collect();
    table.columns.extend(names.iter().map(|name| (name.clone(), String::new())));
    table.columns.extend(last.iter().map(|(a, b)| ((*a).to_owned(), (*b).to_owned())));
    for mode in &results.modes {
        let mut row = vec![(name_of(mode), Tone::Plain)];
        let of = |name: &String| mode.outcomes.iter().find(|o| o.estimator == *name);
        row.extend(names.iter().map(|name| of(name).map_or_else(none, |o| cell(mode, o))));
        row.extend(others(mode).into_iter().map(|text| (text, Tone::Faint)));
        table.rows.push(row);
    }
    table
}

/// The worst pixel and channel of each mode and estimator, and the number of failures of each estimator.
pub fn survival(results: &Results) -> Table {
    let cell = |m: &ModeResult, o: &Outcome| judged(o, m.bar, results.verdict(m, o));
    let bar = ("bar", "largest variance ratio that survives");
    let mut table = by_mode(results, cell, &[bar], |m| vec![ratio(m.bar)]);
    let all = || results.modes.iter().flat_map(|m| m.outcomes.iter().map(move |o| (m, o)));
    let of = |subject: Subject| {
        let own = all().filter(|(_, o)| o.estimator == subject.name());
        own.map(|(m, o)| results.verdict(m, o)).collect::<Vec<_>>()
    };
    table.rows.push(failures(Subject::shown().into_iter().map(of)));
    table
}

/// The last row of the survival table: the number of certain failures of each estimator.
pub(super) fn failures(verdicts: impl Iterator<Item = Vec<Verdict>>) -> Vec<(String, Tone)> {
    let of = |own: Vec<Verdict>| {
        let failed = own.iter().filter(|v| matches!(v, Verdict::Fails | Verdict::Wrong)).count();
        (format!("{failed} of {}", own.len()), if failed > 0 { Tone::Bad } else { Tone::Good })
    };
    let name = ("fails for sure".to_owned(), Tone::Plain);
    std::iter::once(name).chain(verdicts.map(of)).chain([(String::new(), Tone::Faint)]).collect()
}

/// Mean variance ratios, and the least that a fixed share reaches.
fn means(results: &Results) -> Table {
    let best = ("best fixed share", "least variance of any fixed sample counts");
    let cell = |_: &ModeResult, o: &Outcome| (ratio(o.mean_ratio), Tone::Plain);
    by_mode(results, cell, &[best], |m| vec![m.best.map_or("–".to_owned(), ratio)])
}

/// Largest |z| of each mode and estimator.
fn unbiased(results: &Results) -> Table {
    let cell = |m: &ModeResult, o: &Outcome| largest_z(o, results.verdict(m, o));
    by_mode(results, cell, &[("tests", "z-tests per estimator")], |m| {
        vec![m.outcomes.first().map_or(0, |o| o.tests).to_string()]
    })
}

/// Mean share of light samples and its standard deviation.
fn shares(results: &Results) -> Table {
    let cell = |_: &ModeResult, o: &Outcome| (format!("{:.2} ± {:.2}", o.share, o.share_sd), Tone::Plain);
    by_mode(results, cell, &[], |_| vec![])
}

fn constructs(results: &Results) -> Table {
    let mut table = Table::new(&[("mode", ""), ("construction", ""), ("paths per pixel", ""), ("variances from", "")]);
    for m in &results.modes {
        let by = if m.rendered { "renders" } else { "exact sums" };
        let cells = [name_of(m), m.construct.to_owned(), m.paths.to_string(), by.to_owned()];
        table.rows.push(cells.map(|c| (c, Tone::Words)).to_vec());
    }
    table
}

fn facts(results: &Results) -> Table {
    let mut table = Table::new(&[("mode", ""), ("samples", ""), ("correct", "")]);
    let names = results.facts.first().map_or(&[][..], |f| &f.answers).iter();
    table.columns.extend(names.map(|(name, ..)| (name.clone(), String::new())));
    for fact in &results.facts {
        let mut row = [fact.mode, fact.shown, fact.right].map(|t| (t.to_owned(), Tone::Words)).to_vec();
        row.extend(fact.answers.iter().map(|(_, share, right)| {
            marked(format!("{share:.3}"), if *right { Verdict::Survives } else { Verdict::Fails })
        }));
        table.rows.push(row);
    }
    table
}

pub(super) fn controls(controls: &[Control]) -> Table {
    let mut table = Table::new(&[
        ("control", ""),
        ("deliberate error", ""),
        ("bias", ""),
        ("largest z", ""),
        ("worst ratio", ""),
        ("check", ""),
        ("caught", ""),
    ]);
    for c in controls {
        let o = &c.outcome;
        // Passes of the biased control are correlated: its exact variance is unknown.
        let worst = if c.check.starts_with('z') { "–".to_owned() } else { ratio(o.worst_ratio) };
        let cells = [
            (o.estimator.clone(), Tone::Words),
            (format!("{} ({})", c.name, c.mode), Tone::Words),
            (format!("{:+.2} %", 100.0 * o.bias).replace('-', "−"), Tone::Plain),
            (format!("{:.1}", o.z), Tone::Plain),
            (worst, Tone::Plain),
            (c.check.to_owned(), Tone::Words),
        ];
        let mut row = cells.to_vec();
        row.push(if c.caught { ("yes".to_owned(), Tone::Good) } else { ("NO".to_owned(), Tone::Bad) });
        table.rows.push(row);
    }
    table
}

const LEAD: &str = "Which `--balance` is safe in the failure modes of adaptive sampling. The numbers are variances over those \
of `half` with equal paths, in the worst pixel and colour channel: 1 is no harm, below 1 is a gain. F19 to F23 test path \
guiding.";
const WORST: &str = "✗: a pixel exceeds the mode's bar by more than chance explains. ?: the worst pixel (± its standard error) \
exceeds it, but chance may explain that. 1.00 may mean that a method learned nothing from so few samples, or nothing that it \
trusted: see its shares below. `power` and `max` do not adapt; their losses come from their weights. `ridge` and `minimax` \
are not values of `--balance` and appear in exact cases only. Both use the paper's passes: `ridge` its formula with one \
pseudo-observation, `minimax` the best share against the worst integrand with the same moments, with two.";
const SHARES: &str = "Mean share of light samples in the last pass ± its standard deviation over replicas. F10 tests how much \
the share varies where all pixels are equal.";
const FACTS: &str = "The share of light samples after samples that break naive rules. Invalid samples must not count.";

/// A section of the page.
pub(super) struct Part {
    pub title: &'static str,
    pub text: String,
    pub table: Table,
}

fn parts(found: &Found) -> Vec<Part> {
    let balance = found.balance.as_ref().map_or_else(Vec::new, of_balance);
    let guiding = found.guiding.as_ref().map_or_else(Vec::new, guiding::page::parts);
    balance.into_iter().chain(guiding).collect()
}

fn of_balance(results: &Results) -> Vec<Part> {
    let replicas = results.replicas();
    let family = format!(
        "Largest |mean − truth| in standard errors over all pixels, channels and the picture's mean, after {replicas} \
         replicas. The probability that any of the {} tests raises a false alarm is at most {} (Bonferroni, bound of the normal \
         tail): the limit is {:.2}. Exact cases are tested against the exact value, renders against renders by `half` with other \
         seeds.",
        results.tests, results.false_alarm, results.z_limit
    );
    let part = |title, text: &str, table| Part { title, text: text.to_owned(), table };
    vec![
        part("Who survives what", WORST, survival(results)),
        part("On average", "The same ratios, averaged over pixels and channels.", means(results)),
        part("Means", &family, unbiased(results)),
        part("Controls", "Deliberate errors that the checks must catch.", controls(&results.controls)),
        part("Shares", SHARES, shares(results)),
        part("Shares after hard samples", FACTS, facts(results)),
        part("The modes", METHOD, constructs(results)),
    ]
}

const METHOD: &str = "Exact cases are pictures of 4 x 4 pixels with a few atoms per integrand. A replica simulates an \
estimator's passes sample by sample, with the same functions as a render. The variance of its result follows exactly from \
the shares that it chose, as passes are uncorrelated. Renders have 4 x 4 pixels; their variances are measured over replicas \
with the same seeds for all estimators.";

/// The command that writes the tables.
fn command(found: &Found) -> String {
    let only = match (&found.balance, &found.guiding) {
        (Some(_), None) => " --only balance",
        (None, Some(_)) => " --only guiding",
        _ => "",
    };
    format!("bismar study stability --replicas {}{only} --out DIR", found.replicas())
}

/// The tables for `docs`.
pub fn markdown(found: &Found) -> String {
    let mut text = "# Where methods fail\n".to_owned();
    text += &format!("\n    {}\n\nwrote this; `make stability` copies it here.\n\n{LEAD}\n", command(found));
    for part in parts(found) {
        text += &format!("\n## {}\n\n{}\n\n{}", part.title, part.text, part.table.markdown());
    }
    text
}

/// Writes `report.html`, `stability.md` and `stability.json` into a folder.
///
/// # Errors
/// As [`files::write`].
pub fn write(folder: &Path, found: &Found) -> Result<()> {
    let mut page = Page::new("Where methods fail", LEAD);
    for part in parts(found) {
        page.section(part.title);
        page.text(&part.text);
        page.table(&part.table);
    }
    #[derive(serde::Serialize)]
    struct Document<'a> {
        schema: u32,
        version: &'a str,
        run: Provenance,
        #[serde(flatten)]
        found: &'a Found,
    }
    let run = Provenance::now(&[("replicas", 0), ("reference", OTHER_SEEDS)]);
    let document = Document { schema: SCHEMA, version: env!("CARGO_PKG_VERSION"), run, found };

    files::write_json(&folder.join("stability.json"), &document)?;
    files::write(&folder.join("stability.md"), markdown(found))?;
    files::write(&folder.join("report.html"), page.finish())
}
