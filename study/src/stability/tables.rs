//! Cells, columns and tables that all parts of the page have.

use super::judge::{Control, Outcome, Verdict};
use super::{ModeResult, Results};
use crate::report::{Cell, Columns, Table, Tone, number};

/// A section of the page.
pub(super) struct Part {
    pub title: &'static str,
    pub text: String,
    pub table: Table,
}

impl Part {
    pub fn new(title: &'static str, text: &str, table: Table) -> Self {
        Self { title, text: text.to_owned(), table }
    }
}

/// A text with the mark and tone of its verdict.
pub(super) fn marked(text: String, verdict: Verdict) -> Cell {
    match verdict {
        Verdict::Survives => text.into(),
        Verdict::Unsure => (format!("{text} ?"), Tone::Faint).into(),
        Verdict::Fails => (format!("{text} ✗"), Tone::Bad).into(),
        Verdict::Wrong => ("wrong ✗".to_owned(), Tone::Bad).into(),
    }
}

/// A variance ratio with its verdict. It has three decimals if two would round it to the bar; an unsure one has its
/// standard error.
pub(super) fn judged(outcome: &Outcome, bar: f64, verdict: Verdict) -> Cell {
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
pub(super) fn largest_z(outcome: &Outcome, verdict: Verdict) -> Cell {
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

pub(super) fn faint(text: impl Into<String>) -> Cell {
    (text.into(), Tone::Faint).into()
}

pub(super) fn name_of(mode: &ModeResult) -> String {
    format!("{} {}", mode.mode, mode.name)
}

/// A table with a row per mode and a column per estimator.
pub(super) fn by_estimator<'a, C: Into<Cell>>(
    results: &'a Results,
    cell: impl Fn(&'a ModeResult, &'a Outcome) -> C,
) -> Columns<'a, ModeResult> {
    let table = Table::of(&results.modes).column("mode", "failure mode", name_of);
    results.estimators().fold(table, |table, name| {
        table.column(name, "", |mode| {
            let own = mode.outcomes.iter().find(|o| o.estimator == *name);
            own.map_or_else(|| faint("–"), |own| cell(mode, own).into())
        })
    })
}

/// The worst pixel and channel of each mode and estimator, and the number of failures of each estimator.
pub(crate) fn survival(results: &Results) -> Table {
    let table = by_estimator(results, |m, o| match results.verdict(m, o) {
        verdict if m.misleads(o) && verdict != Verdict::Wrong => {
            faint(format!("{} (adversarial)", ratio(o.worst_ratio)))
        }
        verdict => judged(o, m.bar, verdict),
    });
    let guided = |m: &ModeResult| m.outcomes.last().and_then(|auto| auto.guided_fraction);
    let table = if results.modes.iter().any(|m| guided(m).is_some()) {
        table.column("auto guides", "fraction of pre-passes that decide for guiding", |m| {
            faint(format!("{:.0} %", 100.0 * guided(m).unwrap_or(0.0)))
        })
    } else {
        table.column("bar", "largest variance ratio that survives", |m| faint(ratio(m.bar)))
    };
    let mut table = table.end();
    let failures = |name: &String| -> Cell {
        let all = results.modes.iter().flat_map(|m| m.outcomes.iter().map(move |o| (m, o)));
        let own = all.filter(|(m, o)| o.estimator == *name && !m.misleads(o));
        let verdicts = own.map(|(m, o)| results.verdict(m, o)).collect::<Vec<_>>();
        let failed = verdicts.iter().filter(|v| matches!(v, Verdict::Fails | Verdict::Wrong)).count();
        (format!("{failed} of {}", verdicts.len()), if failed > 0 { Tone::Bad } else { Tone::Good }).into()
    };
    table.push(["fails for sure".into()].into_iter().chain(results.estimators().map(failures)).chain([faint("")]));
    table
}

pub(super) fn controls(controls: &[Control]) -> Table {
    // Passes of the biased control are correlated: its exact variance is unknown.
    let worst = |c: &Control| if c.check.starts_with('z') { "–".to_owned() } else { ratio(c.outcome.worst_ratio) };
    Table::of(controls)
        .words("control", |c| &*c.outcome.estimator)
        .words("deliberate error", |c| format!("{} ({})", c.name, c.mode))
        .column("bias", "", |c| format!("{:+.2} %", 100.0 * c.outcome.bias).replace('-', "−"))
        .column("largest z", "", |c| format!("{:.1}", c.outcome.z))
        .column("worst ratio", "", worst)
        .words("check", |c| c.check)
        .column("caught", "", |c| if c.caught { ("yes".to_owned(), Tone::Good) } else { ("NO".to_owned(), Tone::Bad) })
        .end()
}
