//! Cells, columns and tables that both halves of the page have.

use super::judge::{Control, Outcome, Verdict};
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

/// A table with a row per mode and a column per estimator. `cell` is `None` where an estimator lacks a mode.
pub(super) fn by_mode<'a, M, C: Into<Cell>>(
    modes: &'a [M],
    name: fn(&M) -> String,
    estimators: &[String],
    cell: impl Fn(&'a M, &str) -> Option<C>,
) -> Columns<'a, M> {
    let table = Table::of(modes).column("mode", "failure mode", name);
    estimators.iter().fold(table, |table, estimator| {
        table.column(estimator, "", |mode| cell(mode, estimator).map_or_else(|| faint("–"), C::into))
    })
}

/// The last row of the survival table: the number of certain failures of each estimator.
pub(super) fn failures(verdicts: impl Iterator<Item = Vec<Verdict>>) -> impl Iterator<Item = Cell> {
    let of = |own: Vec<Verdict>| {
        let failed = own.iter().filter(|v| matches!(v, Verdict::Fails | Verdict::Wrong)).count();
        (format!("{failed} of {}", own.len()), if failed > 0 { Tone::Bad } else { Tone::Good }).into()
    };
    std::iter::once("fails for sure".into()).chain(verdicts.map(of)).chain([faint("")])
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
