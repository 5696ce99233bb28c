//! Line charts as SVG, with each line's name at its end.
//!
//! Charts are drawn here because plotters 0.3, which was tried, would replace only axes and ticks. It has few dependencies,
//! but it writes fixed colours (no dark scheme by CSS variables) and whole pixels, and it has neither names at the ends of
//! lines nor an offset between lines that coincide. charming 0.6 needs scripts.

use maud::{Markup, html};

use super::axis::{Axis, Scale, tick_text};

/// Style of charts in light and dark. Colours after Wong (2011), *Points of view: Color blindness*, made darker
/// or lighter to stand out from the ground.
pub const CSS: &str = "
.chart{--ink:#1d232b;--soft:#5d6875;--grid:#e4e8ed;--s0:#6b7684;--s1:#0067a5;--s2:#c84e00;--s3:#00805d;--s4:#a8487f;
--s5:#3a97d3;--s6:#b37a00;--s7:#1d232b;font:12px system-ui,sans-serif;color:var(--ink)}
@media(prefers-color-scheme:dark){.chart{--ink:#e8ecf1;--soft:#a3adb9;--grid:#333b45;--s0:#98a4b2;--s1:#5bb5f0;
--s2:#ff9350;--s3:#2fc79b;--s4:#e893c4;--s5:#a5d5f5;--s6:#f0c24b;--s7:#ffffff}}
.chart text{fill:var(--ink)}.chart .soft{fill:var(--soft)}.chart .title{font-weight:600;font-size:13px}
.chart .grid{stroke:var(--grid);stroke-width:1}.chart .mark{stroke:var(--soft);stroke-width:1;stroke-dasharray:3 3}
.chart .line{fill:none;stroke-width:2;stroke-linejoin:round}";

pub const COLORS: usize = 8;
/// Dashes tell apart what colours alone might not.
const DASHES: [&str; COLORS] = ["5 3", "", "", "8 3", "2 3", "8 3 2 3", "4 2", "1 2"];

#[derive(Debug, Clone)]
pub struct Series {
    /// Written at its end.
    pub name: String,
    /// In order of x.
    pub points: Vec<(f64, f64)>,
    /// Standard error of each point's y, of which two are drawn either way; or none.
    pub errors: Vec<f64>,
    /// Which of the [`COLORS`]; 0 is grey, for what others are compared with.
    pub color: usize,
}

/// A chart of lines over two axes.
#[derive(Debug, Clone)]
pub struct Chart {
    pub title: String,
    pub x_label: String,
    /// Above the vertical axis.
    pub y_label: String,
    pub x: Axis,
    pub y: Axis,
    pub series: Vec<Series>,
    /// A dot at every point?
    pub dots: bool,
    /// Vertical lines at values that matter, with a word.
    pub marks: Vec<(f64, String)>,
}

const WIDTH: f64 = 560.0;
const HEIGHT: f64 = 340.0;
const LEFT: f64 = 58.0;
/// Room for the names of lines, at least.
const RIGHT: f64 = 128.0;
/// A letter's, about.
const LETTER: f64 = 6.6;
const TOP: f64 = 50.0;
const BOTTOM: f64 = 44.0;
/// Lines nearer than this all along are drawn side by side, so far apart.
const APART: f64 = 4.0;
/// Between the names of two lines.
const LABEL_GAP: f64 = 14.0;

impl Chart {
    /// A chart whose axes fit its lines.
    pub fn fitted(title: &str, [x_label, y_label]: [&str; 2], scales: [Scale; 2], series: Vec<Series>) -> Self {
        let all = || series.iter().flat_map(|s| &s.points);
        Self {
            title: title.to_owned(),
            x_label: x_label.to_owned(),
            y_label: y_label.to_owned(),
            x: Axis::fit(scales[0], all().map(|p| p.0)),
            y: Axis::fit(scales[1], all().map(|p| p.1)),
            series,
            dots: true,
            marks: Vec::new(),
        }
    }

    /// The picture, to stand in a page that has [`CSS`].
    pub fn svg(&self) -> Markup {
        let (w, h) = (WIDTH - LEFT - RIGHT, HEIGHT - TOP - BOTTOM);
        let longest = self.series.iter().map(|s| s.name.chars().count()).max().unwrap_or(0);
        let width = LEFT + w + RIGHT.max(16.0 + LETTER * longest as f64);
        let (px, py) = (|p: f64| LEFT + p * w, |p: f64| TOP + (1.0 - p) * h);
        let placed = |&(x, y): &(f64, f64)| Some((px(self.x.clamped(x)?), py(self.y.clamped(y)?)));
        let lines = self.series.iter().filter_map(|series| {
            let points = series.points.iter().filter_map(placed).collect::<Vec<_>>();
            Some((*points.last()?, points, series))
        });
        let lines = drawn_apart(lines.collect());
        // Two standard errors either way, where the point is drawn.
        let bars = |series: &Series, points: &[(f64, f64)]| {
            let known = series.points.iter().zip(&series.errors).filter(|(point, _)| placed(point).is_some());
            let ends = known.zip(points).filter_map(|((&(_, y), error), &(x, _))| {
                let [low, high] = [-2.0, 2.0].map(|n| self.y.clamped(y + n * error).map(py));
                Some((x, low?, high?))
            });
            ends.collect::<Vec<_>>()
        };
        let labels = spread(&lines.iter().map(|((_, y), ..)| *y).collect::<Vec<_>>(), (TOP + 6.0, TOP + h));
        let edge = LEFT + w + 14.0;
        let content = html! {
            (text((0.0, 32.0), "soft", "start", &labelled(&self.y_label, &self.y)))
            (text((LEFT + w / 2.0, HEIGHT - 8.0), "soft", "middle", &labelled(&self.x_label, &self.x)))
            @for (tick, x) in self.x.ticks().into_iter().filter_map(|t| Some((t, px(self.x.position(t)?)))) {
                (line("grid", (x, TOP), (x, TOP + h)))
                (text((x, TOP + h + 16.0), "soft", "middle", &tick_text(tick)))
            }
            @for (tick, y) in self.y.ticks().into_iter().filter_map(|t| Some((t, py(self.y.position(t)?)))) {
                (line("grid", (LEFT, y), (LEFT + w, y)))
                (text((LEFT - 7.0, y + 4.0), "soft", "end", &tick_text(tick)))
            }
            @for (word, x) in self.marks.iter().filter_map(|(v, word)| Some((word, px(self.x.position(*v)?)))) {
                (line("mark", (x, TOP), (x, TOP + h)))
                (text((x + 4.0, TOP + 11.0), "soft", "start", word))
            }
            @for (_, points, series) in &lines {
                polyline.line points=(points.iter().map(|(x, y)| format!("{x:.1},{y:.1}")).collect::<Vec<_>>().join(" "))
                    stroke=(ink(series.color)) stroke-dasharray=(DASHES[series.color % COLORS]) {}
                @for (x, low, high) in bars(series, points) {
                    path d=(format!("M{x:.1} {low:.1}V{high:.1}")) stroke=(ink(series.color)) stroke-width="1.5" opacity=".6" {}
                }
                @if self.dots {
                    @for &at in points { (dot(at, 3.0, series.color)) }
                }
            }
            @for (((x, y), _, series), at) in lines.iter().zip(labels) {
                path d=(format!("M{:.1} {y:.1}L{:.1} {at:.1}", x + 4.0, edge - 3.0)) stroke=(ink(series.color))
                    stroke-width="1" fill="none" opacity=".6" {}
                text x=(tenth(edge)) y=(tenth(at + 4.0)) style={ "fill:" (ink(series.color)) } { (series.name) }
            }
        };
        frame((width, HEIGHT), &self.title, content)
    }
}

/// A picture as a file of its own, with the look that pages give it.
pub(super) fn standalone(svg: &Markup) -> String {
    let ground = ".chart{background:#fff}@media(prefers-color-scheme:dark){.chart{background:#14181d}}";
    svg.0.replacen('>', &format!("><metadata>bismar-study</metadata><style>{CSS}{ground}</style>"), 1)
}

/// A picture of a size, with its title.
pub(super) fn frame((width, height): (f64, f64), title: &str, content: Markup) -> Markup {
    html! {
        // Its letters are 12 high at full width: no narrower than that they are 10.
        svg.chart xmlns="http://www.w3.org/2000/svg" viewBox={ "0 0 " (width) " " (height) } role="img" aria-label=(title)
            style={ "min-width:" (format!("{:.0}", width * 10.0 / 12.0 + 1.0)) "px" } {
            text.title x="0" y="13" { (title) }
            (content)
        }
    }
}

pub(super) fn text((x, y): (f64, f64), class: &str, anchor: &str, words: &str) -> Markup {
    html! { text class=(class) x=(tenth(x)) y=(tenth(y)) text-anchor=(anchor) { (words) } }
}

pub(super) fn line(class: &str, a: (f64, f64), b: (f64, f64)) -> Markup {
    html! { path class=(class) d=(format!("M{:.1} {:.1}L{:.1} {:.1}", a.0, a.1, b.0, b.1)) {} }
}

pub(super) fn dot((x, y): (f64, f64), radius: f64, color: usize) -> Markup {
    html! { circle cx=(tenth(x)) cy=(tenth(y)) r=(radius) fill=(ink(color)) {} }
}

/// One of the [`COLORS`] as pages name it.
pub(super) fn ink(color: usize) -> String {
    format!("var(--s{})", color % COLORS)
}

/// The label, with its scale if that is logarithmic.
pub(super) fn labelled(label: &str, axis: &Axis) -> String {
    if axis.is_log() && !label.is_empty() { format!("{label} (log scale)") } else { label.to_owned() }
}

type Line<'a> = ((f64, f64), Vec<(f64, f64)>, &'a Series);

/// Lines that would hide each other, side by side.
fn drawn_apart(lines: Vec<Line>) -> Vec<Line> {
    let coincide = |a: &[(f64, f64)], b: &[(f64, f64)]| {
        let near = |(p, q): (&(f64, f64), &(f64, f64))| (p.0 - q.0).abs() < APART && (p.1 - q.1).abs() < APART;
        a.len() == b.len() && a.iter().zip(b).all(near)
    };
    let mut apart: Vec<Line> = Vec::new();
    for (i, (_, points, series)) in lines.iter().enumerate() {
        let hidden = lines[..i].iter().filter(|(_, earlier, _)| coincide(earlier, points)).count() as f64;
        // Across the line: to its right, and up where it falls, else down.
        let falls = points.last().zip(points.first()).is_some_and(|(last, first)| last.1 > first.1);
        let (dx, dy) = (hidden * APART * 0.7, hidden * APART * if falls { -0.7 } else { 0.7 });
        let moved: Vec<_> = points.iter().map(|(x, y)| (x + dx, y + dy)).collect();
        apart.push((moved.last().copied().unwrap_or_default(), moved, series));
    }
    apart
}

fn tenth(x: f64) -> String {
    format!("{x:.1}")
}

/// Places near the wanted ones, in the same order, at least [`LABEL_GAP`] apart and, if there is room, in the range.
fn spread(wanted: &[f64], (low, high): (f64, f64)) -> Vec<f64> {
    let mut order = (0..wanted.len()).collect::<Vec<_>>();
    order.sort_by(|&a, &b| wanted[a].total_cmp(&wanted[b]));
    let mut placed = order.iter().map(|&i| wanted[i].max(low)).collect::<Vec<_>>();
    for i in 1..placed.len() {
        placed[i] = placed[i].max(placed[i - 1] + LABEL_GAP);
    }
    let mut limit = high;
    for place in placed.iter_mut().rev() {
        *place = place.min(limit);
        limit = *place - LABEL_GAP;
    }
    let mut result = vec![0.0; wanted.len()];
    order.iter().zip(placed).for_each(|(&i, p)| result[i] = p);
    result
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_do_not_overlap_and_keep_their_order() {
        let places = spread(&[100.0, 101.0, 99.0, 300.0], (50.0, 290.0));
        assert!(places[2] < places[0] && places[0] < places[1] && places[1] < places[3]);
        let mut sorted = places.clone();
        sorted.sort_by(f64::total_cmp);
        assert!(sorted.windows(2).all(|w| w[1] - w[0] >= LABEL_GAP - 1e-9), "{places:?}");
        assert!(sorted[3] <= 290.0);
    }

    fn series(name: &str, points: &[(f64, f64)], errors: &[f64]) -> Series {
        Series { name: name.into(), points: points.into(), errors: errors.into(), color: 9 }
    }

    fn chart(series: Vec<Series>) -> Chart {
        Chart::fitted("t & u", ["x", "y"], [Scale::Log; 2], series)
    }

    #[test]
    fn a_chart_has_a_line_and_a_name_for_each_series_and_no_markup_from_names() {
        let points = [(1.0, 0.1), (10.0, 0.01)];
        let chart = chart(vec![series("a", &points, &[]), series("<b>", &points, &[])]);
        let svg = chart.svg();
        assert_eq!(svg.0.matches("<polyline").count(), 2);
        assert!(svg.0.contains("&lt;b&gt;") && !svg.0.contains("<b>") && svg.0.contains("t &amp; u"));
        assert!(standalone(&svg).contains("<style>"));
    }

    #[test]
    fn errors_are_bars_and_lines_that_coincide_are_drawn_apart() {
        let line = |y: f64| series("", &[(1.0, y), (10.0, y / 9.0)], &[0.1 * y, 0.1]);
        let svg = chart(vec![line(1.0), line(1.0), line(3.0)]).svg().0;
        // Six points with a bar each; one reaches below 0 and ends at the axis.
        assert_eq!(svg.matches("stroke-width=\"1.5\"").count(), 6);
        assert!(svg.contains("y (log scale)") && !svg.contains("NaN"));
        let mut starts = svg.split("points=\"").skip(1).map(|line| line.split(' ').next());
        assert!(starts.next() != starts.next(), "{svg}");
    }

    #[test]
    fn a_series_without_points_or_with_values_off_the_scale_is_no_reason_to_fail() {
        let svg = chart(vec![series("none", &[], &[]), series("bad", &[(0.0, f64::NAN), (1.0, 0.0)], &[1.0; 2])]).svg();
        assert!(!svg.0.contains("NaN") && !svg.0.contains("inf"));
    }
}
