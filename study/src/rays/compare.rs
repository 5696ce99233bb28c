//! Agreement of two studies of the same scenes: two machines, or two runs under different names.

use super::table::{BASELINE, Results, Trace, distinct};
use crate::report::{Page, Table, number, with_error};

/// Largest relative difference of stable ratios.
const WITHIN: f64 = 0.05;

/// A speed ratio that was measured twice.
struct Pair<'a> {
    a: &'a Trace,
    b: &'a Trace,
}

impl Pair<'_> {
    /// The larger ratio over the smaller, minus 1.
    fn apart(&self) -> f64 {
        let quotient = self.a.speed_ratio / self.b.speed_ratio;
        quotient.max(1.0 / quotient) - 1.0
    }
}

/// Ratios that both measured, the most different first, without the baseline.
fn pairs<'a>(results: &'a Results, a: &str, b: &str) -> Vec<Pair<'a>> {
    let of = |machine: &str| {
        let own = move |t: &&Trace| t.machine == machine && t.backend != BASELINE;
        results.traces.iter().filter(own).collect::<Vec<_>>()
    };
    let others = of(b);
    let same = |a: &&Trace, b: &&Trace| a.scene == b.scene && a.backend == b.backend && a.stream == b.stream;
    let pair = |a: &'a Trace| others.iter().find(|b| same(&a, b)).map(|b| Pair { a, b });
    let mut all = of(a).into_iter().filter_map(pair).collect::<Vec<_>>();
    all.sort_by(|a, b| b.apart().total_cmp(&a.apart()));
    all
}

/// A section for all pairs of machines with common measurements, if there are any.
pub(super) fn section(page: &mut Page, results: &Results) {
    let names = distinct(results.traces.iter().map(|t| &*t.machine));
    let mut all = Vec::new();
    for (i, a) in names.iter().enumerate() {
        all.extend(
            names[i + 1..].iter().map(|b| (*a, *b, pairs(results, a, b))).filter(|(.., pairs)| !pairs.is_empty()),
        );
    }
    if all.is_empty() {
        return;
    }
    page.section("Two studies of the same");
    page.text(
        "By how much the speeds over that of embree differ between two runs, or two machines, that measured the same \
         contenders with the same streams.",
    );
    let at = |pairs: &[Pair], share: f64| pairs[((1.0 - share) * (pairs.len() - 1) as f64).round() as usize].apart();
    let table = Table::of(&all)
        .column("one", "Machine or run", |(a, ..)| *a)
        .column("the other", "Machine or run", |(_, b, _)| *b)
        .column("ratios", "Number of speed ratios that both measured", |(.., pairs)| pairs.len() as u64)
        .column("median", "Of the differences", |(.., pairs)| percent(at(pairs, 0.5)))
        .column("95th percentile", "Of the differences", |(.., pairs)| percent(at(pairs, 0.95)))
        .column("largest", "Of the differences", |(.., pairs)| percent(at(pairs, 1.0)))
        .column("within 5 %", "Number of ratios", |(.., pairs)| {
            let within = pairs.iter().filter(|p| p.apart() <= WITHIN).count();
            format!("{within} ({:.1} %)", 100.0 * within as f64 / pairs.len() as f64)
        });
    page.table(&table.end());
    for (a, b, pairs) in &all {
        let beyond = pairs.iter().filter(|p| p.apart() > WITHIN).collect::<Vec<_>>();
        if beyond.is_empty() {
            continue;
        }
        page.details(&format!("{} ratios that differ by more than 5 %: {a}, {b}", beyond.len()), |page| {
            let ratio = |t: &Trace| with_error(t.speed_ratio, t.speed_ratio_se);
            let speed = "Speed over that of embree, with the standard error of the median";
            let table = Table::of(&beyond)
                .column("scene", "", |p| &*p.a.scene)
                .column("contender", "Backend with its options", |p| &*p.a.backend)
                .column("stream", "Kind of rays", |p| &*p.a.stream)
                .column(a, speed, |p| ratio(p.a))
                .column(b, speed, |p| ratio(p.b))
                .column("apart", "The larger over the other", |p| percent(p.apart()));
            page.table(&table.end());
        });
    }
}

fn percent(share: f64) -> String {
    format!("{} %", number(100.0 * share))
}
