//! Tables of the stability study as Markdown (for `docs`), an HTML page, and JSON.

use std::path::Path;

use bismar::Result;

use super::facts::Fact;
use super::judge::Verdict;
use super::scenes::OTHER_SEEDS;
use super::tables::{Part, by_estimator, controls, faint, largest_z, marked, name_of, ratio, survival};
use super::{Found, ModeResult, Results};
use crate::files;
use crate::provenance::Provenance;
use crate::report::{Columns, Page, Table};

/// Version of the JSON. It rises when a field changes its meaning or is removed.
const SCHEMA: u32 = 1;

fn facts(results: &Results) -> Table {
    let table = Table::of(&results.facts);
    let table = table.words("mode", |f| f.mode).words("samples", |f| f.shown).words("correct", |f| f.right);
    let names = results.facts.first().map_or(&[][..], |f| &f.answers).iter().enumerate();
    let share = |f: &Fact, i: usize| {
        let (_, share, right) = &f.answers[i];
        marked(format!("{share:.3}"), if *right { Verdict::Survives } else { Verdict::Fails })
    };
    names.fold(table, |table, (i, (name, ..))| table.column(name, "", |f| share(f, i))).end()
}

const LEAD: &str = "Which `--balance` is safe in the failure modes of adaptive sampling. The numbers are variances over those \
of `half` with equal paths, in the worst pixel and colour channel: 1 is no harm, below 1 is a gain. `half` fails nothing. F19 to \
F23 and F33 test path guiding, F26 to F32 path re-use.";
const WORST: &str = "✗: a pixel exceeds the mode's bar by more than chance explains. ?: the worst pixel (± its standard error) \
exceeds it, but chance may explain that. 1.00 may mean that a method learned nothing from so few samples, or nothing that it \
trusted: see its shares below. `power` and `max` do not adapt; their losses come from their weights.";
const SHARED: &str = "Variances with `--path-reuse` over those without, with equal paths, in the worst pixel, marked as those of \
balances are. 16:4 traces a quarter of the paths behind first surfaces, and costs less: with independent paths as few as that, \
the ratio would be about 4. All 16 pixels share; in a picture groups are drawn from 256.";
const GUIDED: &str = "`--guiding auto` is safe: where its pre-pass decides against a field, the picture equals that of `half` \
to the bit. The numbers are variances of `half` with `--guiding on` and `--guiding auto` over those of `half` without guiding, \
in the worst pixel, marked as those of balances are, with a bar of 1.05. An adversarial field was learned from wrong samples: \
it may add noise, but it must not change the mean. In these rows too, `auto` uses the field of its own pre-pass.";
const GUIDED_CONTROLS: &str = "Deliberate errors in the scene of F23. Averages weighted by measured variances are too dark: they \
prefer the half of the paths that missed the light. Guiding by the firefly's field is noisy but unbiased.";
const GUIDED_METHOD: &str = "Renders of the 4 x 4 pixels in the middle of 64 x 64, with 64 paths per pixel and at most 4 segments per \
path; the pre-pass covers all 64 x 64 pixels. A hundred replicas share a pre-pass.";
const SHARES: &str = "Mean share of light samples in the last pass ± its standard deviation over replicas. F10 tests how much \
the share varies where all pixels are equal.";
const FACTS: &str = "The share of light samples after samples that break naive rules. Invalid samples must not count.";

fn parts(found: &Found) -> Vec<Part> {
    let balance = found.balance.as_ref().map(of_balance);
    let guiding = found.guiding.as_ref().map(of_guiding);
    let path_reuse = found.path_reuse.as_ref().map(of_path_reuse);
    [balance, guiding, path_reuse].into_iter().flatten().flatten().collect()
}

fn of_guiding(results: &Results) -> Vec<Part> {
    let field = |m: &ModeResult| if m.adversarial == Some(true) { "adversarial" } else { "its pre-pass" };
    let means = by_estimator(results, |_, o| ratio(o.mean_ratio));
    let means = means.column("field of `on`", "", |m| faint(field(m))).end();
    let modes = Table::of(&results.modes).words("mode", name_of).words("construction", |m| m.construct);
    vec![
        Part::new("Guiding: who survives what", GUIDED, survival(results)),
        Part::new("Guiding: on average", "The same ratios, averaged over pixels.", means),
        Part::new("Guiding: means", &family(results), unbiased(results).end()),
        Part::new("Guiding: controls", GUIDED_CONTROLS, controls(&results.controls)),
        Part::new("Guiding: the modes", GUIDED_METHOD, modes.words("field of `on`", field).end()),
    ]
}

fn of_path_reuse(results: &Results) -> Vec<Part> {
    let means = by_estimator(results, |_, o| ratio(o.mean_ratio)).end();
    let modes = Table::of(&results.modes).words("mode", name_of).words("construction", |m| m.construct).end();
    vec![
        Part::new("Path re-use: who survives what", SHARED, survival(results)),
        Part::new("Path re-use: on average", "The same ratios, averaged over pixels.", means),
        Part::new("Path re-use: means", &family(results), unbiased(results).end()),
        Part::new("Path re-use: the modes", "Renders as above, with at most 3 segments per path.", modes),
    ]
}

/// The largest z of each mode and estimator.
fn unbiased(results: &Results) -> Columns<'_, ModeResult> {
    by_estimator(results, |m, o| largest_z(o, results.verdict(m, o)))
        .column("tests", "z-tests per estimator", |m| faint(m.outcomes.first().map_or(0, |o| o.tests).to_string()))
}

fn family(results: &Results) -> String {
    format!(
        "Largest |mean − truth| in standard errors over all pixels, channels and the picture's mean, after {} replicas. The \
         probability that any of the {} tests raises a false alarm is at most {} (Bonferroni, bound of the normal tail): the \
         limit is {:.2}. Exact cases are tested against the exact value, renders against renders by `half` with other seeds.",
        results.replicas, results.tests, results.false_alarm, results.z_limit
    )
}

fn of_balance(results: &Results) -> Vec<Part> {
    let means = by_estimator(results, |_, o| ratio(o.mean_ratio));
    let means = means.column("best fixed share", "least variance of any fixed sample counts", |m| {
        faint(m.best.map_or("–".to_owned(), ratio))
    });
    let shares = by_estimator(results, |_, o| format!("{:.2} ± {:.2}", o.share, o.share_sd));
    let modes = Table::of(&results.modes).words("mode", name_of).words("construction", |m| m.construct);
    let modes = modes.words("paths per pixel", |m| m.paths.to_string());
    let modes = modes.words("variances from", |m| if m.rendered { "renders" } else { "exact sums" });
    vec![
        Part::new("Who survives what", WORST, survival(results)),
        Part::new("On average", "The same ratios, averaged over pixels and channels.", means.end()),
        Part::new("Means", &family(results), unbiased(results).end()),
        Part::new("Controls", "Deliberate errors that the checks must catch.", controls(&results.controls)),
        Part::new("Shares", SHARES, shares.end()),
        Part::new("Shares after hard samples", FACTS, facts(results)),
        Part::new("The modes", METHOD, modes.end()),
    ]
}

const METHOD: &str = "Exact cases are pictures of 4 x 4 pixels with a few atoms per integrand. A replica simulates an \
estimator's passes sample by sample, with the same functions as a render. The variance of its result follows exactly from \
the shares that it chose, as passes are uncorrelated. Renders have 4 x 4 pixels; their variances are measured over replicas \
with the same seeds for all estimators. All replicas share what pre-passes decide and learn, which does not depend on the seed: in \
F18 and F24, where 16 pixels teach them, that is one draw of many.";

/// The command that writes the tables.
fn command(found: &Found) -> String {
    let only = match (&found.balance, &found.guiding, &found.path_reuse) {
        (Some(_), None, None) => " --only balance",
        (None, Some(_), None) => " --only guiding",
        (None, None, Some(_)) => " --only path-reuse",
        _ => "",
    };
    let replicas = found.all().next().map_or(0, |results| results.replicas);
    format!("bismar study stability --replicas {replicas}{only} --out DIR")
}

/// The tables for `docs`.
pub(crate) fn markdown(found: &Found) -> String {
    let mut text = "# Failure modes\n".to_owned();
    text += &format!("\n    {}\n\nwrote this page; `make stability` copies it here.\n\n{LEAD}\n", command(found));
    for part in parts(found) {
        text += &format!("\n## {}\n\n{}\n\n{}", part.title, part.text, part.table.markdown());
    }
    text
}

/// Writes `report.html`, `stability.md` and `stability.json` into a folder.
pub fn write(folder: &Path, found: &Found) -> Result<()> {
    let mut page = Page::new("Failure modes", LEAD);
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
    page.write(folder)
}
