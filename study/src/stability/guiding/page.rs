//! Tables of guiding's failure modes.

use super::{Guided, ModeResult, Results};
use crate::report::{Cell, Columns, Table};
use crate::stability::cases::BAR;
use crate::stability::judge::Verdict;
use crate::stability::tables::{Part, by_mode, controls, failures, faint, judged, largest_z, ratio};

/// [`by_mode`] for `on` and `auto`.
fn guidings<'a, C: Into<Cell>>(
    results: &'a Results,
    cell: impl Fn(&'a ModeResult, &'a Guided) -> C,
) -> Columns<'a, ModeResult> {
    let first = results.modes.first().map_or(&[][..], |m| &m.outcomes[..]);
    let names = first.iter().map(|o| o.outcome.estimator.clone()).collect::<Vec<_>>();
    by_mode(&results.modes, name_of, &names, |mode, name| {
        mode.outcomes.iter().find(|o| o.outcome.estimator == name).map(|o| cell(mode, o))
    })
}

fn name_of(mode: &ModeResult) -> String {
    format!("{} {}", mode.mode, mode.name)
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
    let table = guidings(results, |m, o| match is_adversarial(m, o) && results.verdict(o) != Verdict::Wrong {
        true => faint(format!("{} (adversarial)", ratio(o.outcome.worst_ratio))),
        false => judged(&o.outcome, BAR, results.verdict(o)),
    });
    let table = table.column("auto guides", "fraction of pre-passes that decide for guiding", |m| {
        faint(format!("{:.0} %", 100.0 * m.outcomes[1].guided_fraction))
    });
    let mut table = table.end();
    let of = |estimator: usize| {
        let own = results.modes.iter().map(|m| (m, &m.outcomes[estimator])).filter(|(m, o)| !is_adversarial(m, o));
        own.map(|(_, o)| results.verdict(o)).collect::<Vec<_>>()
    };
    table.push(failures([0, 1].into_iter().map(of)));
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
    let field = |table: Columns<_>| table.column("field of `on`", "", |m| faint(field_of(m))).end();
    let unbiased = guidings(results, |_, o| largest_z(&o.outcome, results.verdict(o)));
    let unbiased =
        unbiased.column("tests", "z-tests per estimator", |m| faint(m.outcomes[0].outcome.tests.to_string()));
    let modes = Table::of(&results.modes).words("mode", name_of).words("construction", |m| m.construct);
    vec![
        Part::new("Guiding: who survives what", WORST, survival(results)),
        Part::new(
            "Guiding: on average",
            "The same ratios, averaged over pixels.",
            field(guidings(results, |_, o| ratio(o.outcome.mean_ratio))),
        ),
        Part::new("Guiding: means", &family, unbiased.end()),
        Part::new("Guiding: controls", CONTROLS, controls(&results.controls)),
        Part::new("Guiding: the modes", METHOD, modes.words("field of `on`", field_of).end()),
    ]
}
