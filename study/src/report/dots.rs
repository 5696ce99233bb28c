//! Dot plots: one row a thing, one dot a kind, with its uncertainty.

use maud::{Markup, html};

use super::axis::{Axis, Scale, tick_text};
use super::chart::{dot, frame, ink, labelled, line, text};

/// One measured value in a row.
#[derive(Debug, Clone, Copy)]
pub struct Dot {
    pub value: f64,
    /// Its standard error; two of them are drawn either way.
    pub error: f64,
    /// Number of its kind in the list that the plot is made with.
    pub kind: usize,
}

const WIDTH: f64 = 760.0;
const LEFT: f64 = 170.0;
const RIGHT: f64 = 20.0;
const TOP: f64 = 54.0;
const LANE: f64 = 9.0;

/// Rows of ratios over one logarithmic axis, on which a line marks 1 and says `same`. Kinds have names and colours. To stand
/// in a page that has [`super::chart::CSS`].
pub fn dot_plot(
    title: &str,
    label: &str,
    same: &str,
    kinds: &[(String, usize)],
    rows: &[(String, Vec<Dot>)],
) -> Markup {
    let shown = rows.iter().flat_map(|(_, dots)| dots.iter().map(|d| d.value.clamp(0.05, 8.0)));
    let axis = Axis::fit(Scale::Log, shown.chain([0.8, 1.2]));
    let row_height = LANE * kinds.len() as f64 + 12.0;
    let plot_height = row_height * rows.len() as f64;
    // The legend, in as many lines as it takes.
    let (mut legend, mut at) = (Vec::new(), (LEFT, 34.0));
    for (name, color) in kinds {
        let width = 24.0 + 7.2 * name.chars().count() as f64;
        if at.0 > LEFT && at.0 + width > WIDTH {
            at = (LEFT, at.1 + 16.0);
        }
        legend.push((at, name, *color));
        at.0 += width;
    }
    let head = TOP + at.1 - 34.0;
    let w = WIDTH - LEFT - RIGHT;
    let px = |p: f64| LEFT + p * w;
    // A dot with its uncertainty, in its kind's lane of a row that begins at `top`; nothing if it has no place.
    let drawn = |one: &Dot, top: f64| {
        let position = |v: f64| axis.clamped(v).map(px);
        let (Some((_, color)), Some(x)) = (kinds.get(one.kind), position(one.value)) else { return html! {} };
        let y = top + LANE * (one.kind as f64 + 0.5);
        let [a, b] = [-2.0, 2.0].map(|n| position(one.value + n * one.error).unwrap_or(x));
        html! {
            path d=(format!("M{a:.1} {y:.1}H{b:.1}")) stroke=(ink(*color)) stroke-width="2" opacity=".55" {}
            (dot((x, y), 3.5, *color))
        }
    };
    let content = html! {
        @for ((x, y), name, color) in legend {
            (dot((x, y), 4.0, color))
            (text((x + 8.0, y + 4.0), "", "start", name))
        }
        @for (tick, x) in axis.ticks().into_iter().filter_map(|t| Some((t, px(axis.position(t)?)))) {
            (line("grid", (x, head), (x, head + plot_height)))
            (text((x, head + plot_height + 16.0), "soft", "middle", &tick_text(tick)))
        }
        (text((LEFT + w / 2.0, head + plot_height + 36.0), "soft", "middle", &labelled(label, &axis)))
        @if let Some(x) = axis.position(1.0).map(px) {
            (line("mark", (x, head - 4.0), (x, head + plot_height)))
            (text((x + 4.0, head + 6.0), "soft", "start", same))
        }
        @for (i, (name, dots)) in rows.iter().enumerate() {
            @let top = head + row_height * i as f64;
            (line("grid", (0.0, top), (LEFT + w, top)))
            (text((0.0, top + row_height / 2.0 + 4.0), "", "start", name))
            @for dot in dots { (drawn(dot, top + 6.0)) }
        }
    };
    frame((WIDTH, head + plot_height + 44.0), title, content)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_dot_is_drawn_beyond_the_axis_at_its_end() {
        let dot = |value, kind| Dot { value, error: 0.1, kind };
        let kinds = [("a".into(), 0), ("b".into(), 1)];
        let rows = [("x".into(), vec![dot(0.5, 0), dot(100.0, 1), dot(f64::NAN, 1)])];
        let svg = dot_plot("t", "l", "same", &kinds, &rows).0;
        // Two in the legend, two in the row.
        assert_eq!(svg.matches("<circle").count(), 4);
        assert!(!svg.contains("NaN"));
    }
}
