//! Dot plots: one row a thing, one dot a kind, with its uncertainty.

use maud::{Markup, html};

use super::axis::{Axis, Scale, tick_text};
use super::chart::{dot, frame, ink, labelled, line, standalone, text};

/// One measured value in a row.
#[derive(Debug, Clone, Copy)]
pub struct Dot {
    pub value: f64,
    /// Its standard error; two of them are drawn either way.
    pub error: f64,
    /// Number of its kind in the list that the plot is made with.
    pub kind: usize,
}

/// Rows of ratios over one logarithmic axis, on which a line marks 1.
#[derive(Debug, Clone)]
pub struct DotPlot {
    title: String,
    label: String,
    axis: Axis,
    /// What a ratio of 1 is, in words.
    same: String,
    /// Names and colours of the kinds.
    kinds: Vec<(String, usize)>,
    rows: Vec<(String, Vec<Dot>)>,
}

const WIDTH: f64 = 760.0;
const LEFT: f64 = 170.0;
const RIGHT: f64 = 20.0;
const TOP: f64 = 54.0;
const LANE: f64 = 9.0;

impl DotPlot {
    /// A plot of `rows` of values around 1, where a line says `same`.
    pub fn ratios(
        title: &str,
        label: &str,
        same: &str,
        kinds: Vec<(String, usize)>,
        rows: Vec<(String, Vec<Dot>)>,
    ) -> Self {
        let shown = rows.iter().flat_map(|(_, dots)| dots.iter().map(|d| d.value.clamp(0.05, 8.0)));
        let axis = Axis::fit(Scale::Log, shown.chain([0.8, 1.2]));
        Self { title: title.to_owned(), label: label.to_owned(), axis, same: same.to_owned(), kinds, rows }
    }

    /// The picture, to stand in a page that has [`super::chart::CSS`].
    pub fn svg(&self) -> Markup {
        let row_height = LANE * self.kinds.len() as f64 + 12.0;
        let plot_height = row_height * self.rows.len() as f64;
        // The legend, in as many lines as it takes.
        let (mut legend, mut at) = (Vec::new(), (LEFT, 34.0));
        for (name, color) in &self.kinds {
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
        let content = html! {
            @for ((x, y), name, color) in legend {
                (dot((x, y), 4.0, color))
                (text((x + 8.0, y + 4.0), "", "start", name))
            }
            @for (tick, x) in self.axis.ticks().into_iter().filter_map(|t| Some((t, px(self.axis.position(t)?)))) {
                (line("grid", (x, head), (x, head + plot_height)))
                (text((x, head + plot_height + 16.0), "soft", "middle", &tick_text(tick)))
            }
            (text((LEFT + w / 2.0, head + plot_height + 36.0), "soft", "middle", &labelled(&self.label, &self.axis)))
            @if let Some(x) = self.axis.position(1.0).map(px) {
                (line("mark", (x, head - 4.0), (x, head + plot_height)))
                (text((x + 4.0, head + 6.0), "soft", "start", &self.same))
            }
            @for (i, (name, dots)) in self.rows.iter().enumerate() {
                @let top = head + row_height * i as f64;
                (line("grid", (0.0, top), (LEFT + w, top)))
                (text((0.0, top + row_height / 2.0 + 4.0), "", "start", name))
                @for dot in dots { (self.dot(dot, top + 6.0, px)) }
            }
        };
        frame((WIDTH, head + plot_height + 44.0), &self.title, content)
    }

    /// A dot with its uncertainty, in its kind's lane of a row that begins at `top`; nothing if it has no place.
    fn dot(&self, one: &Dot, top: f64, px: impl Fn(f64) -> f64) -> Markup {
        let position = |v: f64| self.axis.clamped(v).map(&px);
        let (Some((_, color)), Some(x)) = (self.kinds.get(one.kind), position(one.value)) else { return html! {} };
        let y = top + LANE * (one.kind as f64 + 0.5);
        let [a, b] = [-2.0, 2.0].map(|n| position(one.value + n * one.error).unwrap_or(x));
        html! {
            path d=(format!("M{a:.1} {y:.1}H{b:.1}")) stroke=(ink(*color)) stroke-width="2" opacity=".55" {}
            (dot((x, y), 3.5, *color))
        }
    }

    /// The picture as a file of its own.
    pub fn file(&self) -> String {
        standalone(self.svg())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_dot_is_drawn_beyond_the_axis_at_its_end() {
        let dot = |value, kind| Dot { value, error: 0.1, kind };
        let kinds = vec![("a".into(), 0), ("b".into(), 1)];
        let rows = vec![("x".into(), vec![dot(0.5, 0), dot(100.0, 1), dot(f64::NAN, 1)])];
        let plot = DotPlot::ratios("t", "l", "same", kinds, rows);
        // Two in the legend, two in the row.
        assert_eq!(plot.svg().0.matches("<circle").count(), 4);
        assert!(!plot.file().contains("NaN"));
    }
}
