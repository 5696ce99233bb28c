//! The tables of guiding's failure modes.

use super::{Guided, ModeResult, Results};
use crate::report::{Table, Tone};
use crate::stability::cases::BAR;
use crate::stability::judge::Verdict;
use crate::stability::page::{Part, controls, failures, judged, largest_z, ratio};

/// Rows of modes, columns of estimators; then one that is the mode's own.
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

/// Whose field leads `on`.
fn field_of(mode: &ModeResult) -> &'static str {
    if mode.lies { "lies" } else { "the pilot's" }
}

/// What is no mode of the product's: a field of lies has leave to be noisy.
fn lied_to(mode: &ModeResult, own: &Guided) -> bool {
    mode.lies && own.outcome.estimator == "on"
}

/// The worst pixel of each, and how often each one failed.
pub fn survival(results: &Results) -> Table {
    let cell = |m: &ModeResult, o: &Guided| match lied_to(m, o) && results.verdict(o) != Verdict::Wrong {
        true => (format!("{} (lies)", ratio(o.outcome.worst_ratio)), Tone::Faint),
        false => judged(&o.outcome, BAR, results.verdict(o)),
    };
    let led = |m: &ModeResult| format!("{:.0} %", 100.0 * m.outcomes[1].led);
    let mut table = by_mode(results, cell, ("auto guides", "share of pilots that decide for it"), led);
    let of = |estimator: usize| {
        let own = results.modes.iter().map(|m| (m, &m.outcomes[estimator])).filter(|(m, o)| !lied_to(m, o));
        own.map(|(_, o)| results.verdict(o)).collect::<Vec<_>>()
    };
    table.rows.push(failures([0, 1].into_iter().map(of)));
    table
}

/// Mean ratios.
fn means(results: &Results) -> Table {
    let cell = |_: &ModeResult, o: &Guided| (ratio(o.outcome.mean_ratio), Tone::Plain);
    by_mode(results, cell, ("field of `on`", ""), |m| field_of(m).to_owned())
}

/// Largest |z| of each.
fn unbiased(results: &Results) -> Table {
    let cell = |_: &ModeResult, o: &Guided| largest_z(&o.outcome, results.verdict(o));
    let tests = |m: &ModeResult| m.outcomes[0].outcome.tests.to_string();
    by_mode(results, cell, ("tests", "z-tests an estimator"), tests)
}

fn constructs(results: &Results) -> Table {
    let mut table = Table::new(&[("mode", ""), ("how it is posed", ""), ("field of `on`", "")]);
    for m in &results.modes {
        let cells = [format!("{} {}", m.mode, m.name), m.construct.to_owned(), field_of(m).to_owned()];
        table.rows.push(cells.map(|c| (c, Tone::Words)).to_vec());
    }
    table
}

const WORST: &str = "`half` with `--guiding on` and with `--guiding auto` through the failure modes of guiding: variances \
over those of `half` without guiding, in the worst pixel, marked as those of balances are, with a bar of 1.05. `auto` is \
what is safe: where its pilot decides against a field, the picture is `half`'s to the bit. A field of lies was taught what is \
not so: its noise may be what it likes, its mean may not move. In these rows too `auto` has the pilot's own field.";
const CONTROLS: &str = "Wrong on purpose, in the room of F23. Averages by measured variances, as if these were known, are \
dark: that half of the paths is believed which missed the light. What follows the firefly is noisy without being wrong.";
const METHOD: &str = "Renders of 4 x 4 pixels in the middle of 64 x 64, of which the pilots are; 64 paths a pixel, of at most \
4 segments. A hundred replicas share a pilot; the first of them is, to the bit, what `render` makes of these settings.";

/// The sections of the page.
pub(in crate::stability) fn parts(results: &Results) -> Vec<Part> {
    let family = format!(
        "Largest |mean − truth| in standard errors over all pixels and the picture's mean, after {} replicas; the truth are renders \
         by `half` with other seeds. These tests are a family of their own: all {} together \
         raise a false alarm with a chance of {} at most: the limit is {:.2}.",
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
