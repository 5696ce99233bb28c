//! Dot plots: one row a thing, one dot a kind, with its uncertainty.

use std::fmt::Write;

use super::axis::{Axis, tick_text};
use super::chart::{COLORS, line, open, standalone, text};

/// One measured value in a row.
#[derive(Debug, Clone, Copy)]
pub struct Dot {
    /// The value.
    pub value: f64,
    /// Its standard error; two of them are drawn either way.
    pub error: f64,
    /// Index into [`DotPlot::kinds`].
    pub kind: usize,
}

/// Rows of dots over one axis.
#[derive(Debug, Clone)]
pub struct DotPlot {
    /// Above it.
    pub title: String,
    /// Below it.
    pub label: String,
    /// The axis.
    pub axis: Axis,
    /// A value that matters, with a word.
    pub mark: Option<(f64, String)>,
    /// Names and colours of the kinds.
    pub kinds: Vec<(String, usize)>,
    /// Names and dots.
    pub rows: Vec<(String, Vec<Dot>)>,
}

const WIDTH: f64 = 760.0;
const LEFT: f64 = 170.0;
const RIGHT: f64 = 20.0;
const TOP: f64 = 54.0;
const LANE: f64 = 9.0;

impl DotPlot {
    /// The picture, to stand in a page that has [`super::chart::CSS`].
    pub fn svg(&self) -> String {
        let row_height = LANE * self.kinds.len() as f64 + 12.0;
        let body = row_height * self.rows.len() as f64;
        // The legend, in as many lines as it takes.
        let (mut legend, mut x, mut y) = (String::new(), LEFT, 34.0);
        for (name, color) in &self.kinds {
            let (color, width) = (color % COLORS, 24.0 + 7.2 * name.chars().count() as f64);
            if x > LEFT && x + width > WIDTH {
                (x, y) = (LEFT, y + 16.0);
            }
            let _ = write!(legend, r#"<circle cx="{x:.1}" cy="{y:.1}" r="4" fill="var(--s{color})"/>"#);
            text(&mut legend, (x + 8.0, y + 4.0), "", "start", name);
            x += width;
        }
        let head = TOP + y - 34.0;
        let mut out = open(WIDTH, head + body + 44.0, &self.title) + &legend;
        let w = WIDTH - LEFT - RIGHT;
        let px = |p: f64| LEFT + p * w;
        for tick in self.axis.ticks() {
            let Some(x) = self.axis.place(tick).map(px) else { continue };
            line(&mut out, "grid", (x, head), (x, head + body));
            text(&mut out, (x, head + body + 16.0), "soft", "middle", &tick_text(tick));
        }
        text(&mut out, (LEFT + w / 2.0, head + body + 36.0), "soft", "middle", &self.label);
        if let Some((x, word)) = self.mark.as_ref().and_then(|(v, word)| Some((px(self.axis.place(*v)?), word))) {
            line(&mut out, "mark", (x, head - 4.0), (x, head + body));
            text(&mut out, (x + 4.0, head + 6.0), "soft", "start", word);
        }
        for (i, (name, dots)) in self.rows.iter().enumerate() {
            let top = head + row_height * i as f64;
            line(&mut out, "grid", (0.0, top), (LEFT + w, top));
            text(&mut out, (0.0, top + row_height / 2.0 + 4.0), "", "start", name);
            for dot in dots {
                let Some((_, color)) = self.kinds.get(dot.kind) else { continue };
                let Some(x) = self.axis.clamped(dot.value).map(px) else { continue };
                let (y, color) = (top + 6.0 + LANE * (dot.kind as f64 + 0.5), color % COLORS);
                let end = |v: f64| self.axis.clamped(v).map_or(x, px);
                let (a, b) = (end(dot.value - 2.0 * dot.error), end(dot.value + 2.0 * dot.error));
                let _ = write!(
                    out,
                    r#"<path d="M{a:.1} {y:.1}H{b:.1}" stroke="var(--s{color})" stroke-width="2" opacity=".55"/><circle cx="{x:.1}" cy="{y:.1}" r="3.5" fill="var(--s{color})"/>"#
                );
            }
        }
        out + "</svg>"
    }

    /// The picture as a file of its own.
    pub fn file(&self) -> String {
        standalone(&self.svg())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::Scale;

    #[test]
    fn every_dot_is_drawn_beyond_the_axis_at_its_end() {
        let dot = |value, kind| Dot { value, error: 0.1, kind };
        let plot = DotPlot {
            title: "t".into(),
            label: "l".into(),
            axis: Axis::new(Scale::Log, 0.1, 10.0),
            mark: Some((1.0, "same".into())),
            kinds: vec![("a".into(), 0), ("b".into(), 1)],
            rows: vec![("x".into(), vec![dot(0.5, 0), dot(100.0, 1), dot(f64::NAN, 1)])],
        };
        // Two in the legend, two in the row.
        assert_eq!(plot.svg().matches("<circle").count(), 4);
        assert!(!plot.file().contains("NaN"));
    }
}
