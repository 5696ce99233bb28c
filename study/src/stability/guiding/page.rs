//! Tables of guiding's failure modes.

use super::{Guided, ModeResult, Results};
use crate::report::{Table, Tone};
use crate::stability::cases::BAR;
use crate::stability::judge::Verdict;
use crate::stability::page::{Part, controls, failures, judged, largest_z, ratio};

/// A table with a row per mode, a column per estimator, and a last column per mode.
fn by_mode(
    results: &Results,
    cell: impl Fn(&ModeResult, &Guided) -> (String, Tone),
    (last, meaning): (&str, &str),
    other: impl Fn(&ModeResult) -> String,
) -> Table {
    let mut table = Table::new(&[("mode", "failure mode")]);
    let names = results.modes.first().map_or(&[][..], |m| &m.outcomes[..]).iter().map(|o| &o.outcome.estimator);
    table.columns.extend(names.map(|name| (name.clone(), String::new())));
    table.columns.push((last.to_owned(), meaning.to_owned()));
    for mode in &results.modes {
        let mut row = vec![(format!("{} {}", mode.mode, mode.name), Tone::Plain)];
        row.extend(mode.outcomes.iter().map(|o| cell(mode, o)));
        row.push((other(mode), Tone::Faint));
        table.rows.push(row);
    }
    table
}

/// Which field `on` uses.
fn field_of(mode: &ModeResult) -> &'static str {
    if mode.adversarial { "adversarial" } else { "its pre-pass" }
}

/// Whether an adversarial field guides the renders. Their noise is not judged: the program makes no such field.
fn is_adversarial(mode: &ModeResult, own: &Guided) -> bool {
    mode.adversarial && own.outcome.estimator == "on"
}

/// The worst pixel of each mode and estimator, and the number of failures of each estimator.
pub fn survival(results: &Results) -> Table {
    let cell = |m: &ModeResult, o: &Guided| match is_adversarial(m, o) && results.verdict(o) != Verdict::Wrong {
        true => (format!("{} (adversarial)", ratio(o.outcome.worst_ratio)), Tone::Faint),
        false => judged(&o.outcome, BAR, results.verdict(o)),
    };
    let guided = |m: &ModeResult| format!("{:.0} %", 100.0 * m.outcomes[1].guided_fraction);
    let mut table = by_mode(results, cell, ("auto guides", "fraction of pre-passes that decide for guiding"), guided);
    let of = |estimator: usize| {
        let own = results.modes.iter().map(|m| (m, &m.outcomes[estimator])).filter(|(m, o)| !is_adversarial(m, o));
        own.map(|(_, o)| results.verdict(o)).collect::<Vec<_>>()
    };
    table.rows.push(failures([0, 1].into_iter().map(of)));
    table
}

/// Mean variance ratios.
fn means(results: &Results) -> Table {
    let cell = |_: &ModeResult, o: &Guided| (ratio(o.outcome.mean_ratio), Tone::Plain);
    by_mode(results, cell, ("field of `on`", ""), |m| field_of(m).to_owned())
}

/// Largest |z| of each mode and estimator.
fn unbiased(results: &Results) -> Table {
    let cell = |_: &ModeResult, o: &Guided| largest_z(&o.outcome, results.verdict(o));
    let tests = |m: &ModeResult| m.outcomes[0].outcome.tests.to_string();
    by_mode(results, cell, ("tests", "z-tests per estimator"), tests)
}

fn constructs(results: &Results) -> Table {
    let mut table = Table::new(&[("mode", ""), ("construction", ""), ("field of `on`", "")]);
    for m in &results.modes {
        let cells = [format!("{} {}", m.mode, m.name), m.construct.to_owned(), field_of(m).to_owned()];
        table.rows.push(cells.map(|c| (c, Tone::Words)).to_vec());
    }
    table
}

const WORST: &str = "`--guiding auto` is safe: where its pre-pass decides against a field, the picture equals that of `half` \
to the bit. The numbers are variances of `half` with `--guiding on` and `--guiding auto` over those of `half` without guiding, \
in the worst pixel, marked as those of balances are, with a bar of 1.05. An adversarial field was learned from wrong samples: \
it may add noise, but it must not change the mean. In these rows too, `auto` uses the field of its own pre-pass.";
const CONTROLS: &str = "Deliberate errors in the scene of F23. Averages weighted by measured variances are too dark: they \
prefer the half of the paths that missed the light. Guiding by the firefly's field is noisy but unbiased.";
const METHOD: &str = "Renders of the 4 x 4 pixels in the middle of 64 x 64, with 64 paths per pixel and at most 4 segments per \
path; the pre-pass covers all 64 x 64 pixels. A hundred replicas share a pre-pass; the first of them equals, to the bit, what \
`render` makes with these settings.";

/// The sections of the page.
pub(in crate::stability) fn parts(results: &Results) -> Vec<Part> {
    let family = format!(
        "Largest |mean − truth| in standard errors over all pixels and the picture's mean, after {} replicas. The truth is estimated \
         from renders by `half` with other seeds. The probability that any of these {} tests raises a false alarm is at most {}: \
         the limit is {:.2}.",
        results.replicas, results.tests, results.false_alarm, results.z_limit
    );
    let part = |title, text: &str, table| Part { title, text: text.to_owned(), table };
    vec![
        part("Guiding: who survives what", WORST, survival(results)),
        part("Guiding: on average", "The same ratios, averaged over pixels.", means(results)),
        part("Guiding: means", &family, unbiased(results)),
        part("Guiding: controls", CONTROLS, controls(&results.controls)),
        part("Guiding: the modes", METHOD, constructs(results)),
    ]
}
