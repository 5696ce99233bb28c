//! One HTML file that needs nothing else.

use std::path::Path;

use bismar::Result;
use bismar::console::escaped;
use image::RgbImage;
use maud::{DOCTYPE, Markup, PreEscaped, html};

use super::chart;
use super::picture::{ColorScale, data_uri, mapped};
use super::table::{Table, scrolling};
use crate::files;

const CSS: &str = "
:root{--bg:#fff;--ink:#1d232b;--soft:#5d6875;--rule:#e4e8ed;--card:#f6f8fa;--good:#00694c;--bad:#b03a00;--link:#0067a5}
@media(prefers-color-scheme:dark){:root{--bg:#14181d;--ink:#e8ecf1;--soft:#a3adb9;--rule:#333b45;--card:#1c2229;--good:#4fd3aa;
--bad:#ff9d61;--link:#5bb5f0}}
*{box-sizing:border-box}html{color-scheme:light dark}
body{margin:0 auto;padding:2rem 1.5rem 5rem;max-width:1180px;background:var(--bg);color:var(--ink);
font:16px/1.55 system-ui,sans-serif}
h1{font-size:1.9rem;line-height:1.2;margin:0 0 .4rem}h2{font-size:1.4rem;margin:3.2rem 0 .6rem;padding-top:1.2rem;
border-top:1px solid var(--rule)}h3{font-size:1.05rem;margin:1.8rem 0 .4rem}
p{max-width:74ch;margin:.5rem 0 .9rem}a{color:var(--link)}.lead{font-size:1.1rem;color:var(--soft)}
nav{display:flex;flex-wrap:wrap;gap:.3rem 1.1rem;margin:1rem 0 2rem}
.row{display:flex;flex-wrap:wrap;gap:1.4rem;align-items:flex-start;margin:1rem 0}
figure{margin:0}figcaption{font-size:.85rem;color:var(--soft);margin-top:.35rem;max-width:60ch}
.row figure{min-width:0;max-width:100%}.row figure.pic{width:256px}.row figure.wide{flex:1 1 480px;min-width:0;max-width:620px}
figure.full{max-width:860px;margin:1rem 0}
img{display:block;width:100%;image-rendering:pixelated;border-radius:3px;background:var(--card)}
svg.chart{display:block;width:100%;height:auto}
.legend{height:.6rem;border-radius:2px;margin-top:.35rem}.ends{display:flex;justify-content:space-between;font-size:.75rem;
color:var(--soft)}
.scroll{overflow-x:auto;margin:.8rem 0 .2rem}.scroll:focus-visible{outline:2px solid var(--link);outline-offset:2px}
.hint{display:none;font-size:.8rem;color:var(--soft);margin:0 0 .6rem}.over+.hint{display:block}
.columns{margin:.2rem 0 1rem;font-size:.86rem}dl{margin:.4rem 0;display:grid;grid-template-columns:max-content 1fr;gap:.15rem 1rem}
dt{font-weight:600}dd{margin:0;grid-column:2}@media(max-width:520px){dl{display:block}dd{margin:0 0 .4rem}}
table{border-collapse:collapse;font-size:.86rem;font-variant-numeric:tabular-nums}
th,td{padding:.28rem .7rem;text-align:right;white-space:nowrap;border-bottom:1px solid var(--rule)}
th{font-weight:600;color:var(--soft);cursor:help;vertical-align:bottom}th:first-child,td:first-child{text-align:left;
position:sticky;left:0;background:var(--bg)}
td.good{color:var(--good);font-weight:600}td.bad{color:var(--bad);font-weight:600}td.faint{color:var(--soft)}
.words{text-align:left;white-space:normal}
details{margin:1rem 0}summary{cursor:pointer;color:var(--link)}
code{font-size:.9em;background:var(--card);padding:.1em .3em;border-radius:3px}
@media print{body{max-width:none}nav{display:none}}";

/// Says of what is wider than the page that it scrolls, and takes the rest out of the way of the tabulator key.
const SCRIPT: &str = "\
const all=document.querySelectorAll('.scroll'),look=()=>all.forEach(s=>{const o=s.scrollWidth>s.clientWidth+1;\
s.classList.toggle('over',o);s.tabIndex=o?0:-1});\
addEventListener('resize',look);document.querySelectorAll('details').forEach(d=>d.addEventListener('toggle',look));look()";

/// A chart by the name of its file, with its caption.
pub type Figure = (String, Markup, &'static str);

#[derive(Debug)]
pub struct Page {
    title: String,
    lead: String,
    links: Vec<(String, String)>,
    content: String,
    /// Its charts, by the names of their files.
    charts: Vec<(String, Markup)>,
}

impl Page {
    /// A page with a title and a sentence or two that say what it is.
    pub fn new(title: &str, lead: &str) -> Self {
        let (title, lead) = (title.to_owned(), lead.to_owned());
        Self { title, lead, links: Vec::new(), content: String::new(), charts: Vec::new() }
    }

    pub fn add(&mut self, piece: Markup) {
        self.content += &piece.0;
    }

    /// Begins a part that the list at the top leads to.
    pub fn section(&mut self, title: &str) {
        let id = format!("s{}", self.links.len() + 1);
        self.add(html! { h2 id=(id) { (title) } });
        self.links.push((id, title.to_owned()));
    }

    pub fn heading(&mut self, title: &str) {
        self.add(html! { h3 { (title) } });
    }

    /// A paragraph. What stands between backticks is set as code.
    pub fn text(&mut self, text: &str) {
        self.add(html! { p { (marked(text)) } });
    }

    pub fn table(&mut self, table: &Table) {
        self.add(table.html());
    }

    /// Pieces side by side, as many as fit in a row.
    pub fn row(&mut self, pieces: impl IntoIterator<Item = Markup>) {
        self.add(html! { div.row { @for piece in pieces { (piece) } } });
    }

    /// A chart over the text's whole width.
    pub fn wide(&mut self, (name, svg, caption): Figure) {
        self.add(figure("full", scrolling("chart", svg.clone()), caption));
        self.charts.push((name, svg));
    }

    pub fn charts(&mut self, charts: impl IntoIterator<Item = Figure>) {
        let mut figures = Vec::new();
        for (name, svg, caption) in charts {
            figures.push(figure("wide", scrolling("chart", svg.clone()), caption));
            self.charts.push((name, svg));
        }
        self.row(figures);
    }

    /// Parts that only some readers want.
    pub(crate) fn details(&mut self, summary: &str, fill: impl FnOnce(&mut Page)) {
        let before = std::mem::take(&mut self.content);
        fill(self);
        let inside = PreEscaped(std::mem::replace(&mut self.content, before));
        self.add(html! { details { summary { (marked(summary)) } (inside) } });
    }

    /// Writes `report.html`, and `charts/NAME.svg` for each chart.
    pub fn write(&self, folder: &Path) -> Result<()> {
        let svgs = folder.join("charts");
        if !self.charts.is_empty() {
            files::folder(&svgs)?;
        }
        for (name, svg) in &self.charts {
            files::write(&svgs.join(format!("{name}.svg")), escaped(&chart::standalone(svg)))?;
        }
        files::write(&folder.join("report.html"), self.html())
    }

    fn html(&self) -> String {
        let page = html! {
            (DOCTYPE)
            html lang="en" {
                head {
                    meta charset="utf-8";
                    meta name="viewport" content="width=device-width";
                    title { (self.title) }
                    style { (PreEscaped(CSS)) (PreEscaped(chart::CSS)) }
                }
                body {
                    h1 { (self.title) }
                    p.lead { (marked(&self.lead)) }
                    nav { @for (id, title) in &self.links { a href={ "#" (id) } { (title) } } }
                    (PreEscaped(&self.content))
                    script { (PreEscaped(SCRIPT)) }
                }
            }
        };
        escaped(&page.0) + "\n"
    }
}

fn marked(text: &str) -> Markup {
    html! {
        @for (i, piece) in text.split('`').enumerate() {
            @if i % 2 == 1 { code { (piece) } } @else { (piece) }
        }
    }
}

fn figure(class: &str, content: Markup, caption: &str) -> Markup {
    html! { figure class=(class) { (content) @if !caption.is_empty() { figcaption { (marked(caption)) } } } }
}

/// A value a pixel in false colours with what they mean: words at the low end, in the middle and at the high end.
pub(crate) fn map_figure(
    size: [u32; 2],
    (scale, words): (ColorScale, [&str; 3]),
    values: impl Iterator<Item = f64>,
    caption: &str,
) -> Markup {
    let content = html! {
        (image(&mapped(size, scale, values), caption))
        div.legend style={ "background:" (scale.gradient()) } {}
        div.ends { @for word in words { span { (word) } } }
    };
    figure("pic", content, caption)
}

fn image(picture: &RgbImage, alt: &str) -> Markup {
    let (w, h) = picture.dimensions();
    html! { img src=(data_uri(picture)) width=(w) height=(h) style="height:auto" alt=(alt); }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_page_names_no_other_file_and_no_text_becomes_markup() {
        let mut page = Page::new("a < b", "with `code` & more");
        page.section("One <two>");
        page.text("x");
        page.row([map_figure([1, 1], (ColorScale::Share, ["0", "½", "1"]), std::iter::once(0.5), "\"quoted\"")]);
        page.details("more", |page| page.text("inside"));
        let html = page.html();
        assert!(html.contains("<h1>a &lt; b</h1>") && html.contains("<code>code</code> &amp; more"));
        assert!(html.contains(r##"<h2 id="s1">One &lt;two&gt;</h2>"##) && html.contains(r##"<a href="#s1">"##));
        for outside in ["http://", "https://", "src=\"/", "url(", "<link"] {
            assert!(!html.contains(outside), "{outside}");
        }
        assert_eq!(html.matches("src=\"data:image/png;base64,").count(), 1);
    }
}
