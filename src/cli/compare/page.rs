//! A self-contained HTML page with two pictures under a slider, their FLIP error map and their errors.

use std::io::Write;
use std::path::Path;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use maud::{DOCTYPE, Markup, PreEscaped, html};

use super::difference::false_color;
use super::report::short;
use crate::film::compare::{Comparison, flip_map};
use crate::film::preview::{encoded, encoded_picture, to_byte};
use crate::film::{Exposure, Look, Picture, View, atomic};
use crate::{Result, console};

/// Writes the page; `curve` is the chart of a sequence, or empty.
pub fn write(path: &Path, names: [&Path; 2], pictures: [&Picture; 2], c: &Comparison, curve: &Markup) -> Result<()> {
    save(path, &page(names, pictures, c, curve)?)
}

pub fn save(path: &Path, page: &Markup) -> Result<()> {
    atomic::write(path, |file| Ok(Ok(file.write_all(page.0.as_bytes())?)))
}

/// A page with this style.
pub fn document(title: &str, style: &str, body: &Markup) -> Markup {
    html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="generator" content="bismar";
                meta name="viewport" content="width=device-width, initial-scale=1";
                title { (title) }
                style { (PreEscaped(style)) }
            }
            body { (body) }
        }
    }
}

/// The page, with something above the pictures. Both pictures have the view transform and the automatic exposure of B.
pub fn page(names: [&Path; 2], [a, b]: [&Picture; 2], c: &Comparison, above: &Markup) -> Result<Markup> {
    let view = if a.displayed && b.displayed { View::Srgb } else { View::Agx };
    let exposure = if view == View::Srgb { 0.0 } else { Exposure::Auto.of(b.colors()) };
    let look = Look { view: view.into(), exposure };
    let [width, height] = a.size().map(|n| n as u32);
    let map: Vec<u8> = flip_map(a, b).iter().flat_map(|e| false_color(*e).map(to_byte)).collect();
    let image = |png: &[u8], alt: &str| html! { img src=(data(png)) width=(width) height=(height) alt=(alt); };
    let [name_a, name_b] = names.map(|path| shown(&path.display().to_string()));
    let numbers = [("relMSE", c.rel_mse), ("RMSE", c.rmse), ("MAE", c.mae), ("FLIP, mean", c.flip)];
    let z = c.statistics.as_ref().map(|s| ("z of the bias", s.bias_z));
    let triples = [("mean of B", c.reference_mean), ("bias A − B", c.bias)].into_iter().chain(z);
    let body = html! {
        h1 { "A " (name_a) " against B " (name_b) }
        (above)
        figure {
            div.pair {
                (image(&encoded_picture(a, &look)?, &format!("A, {name_a}")))
                (image(&encoded_picture(b, &look)?, &format!("B, {name_b}, the reference")))
            }
            label {
                "A on the left of the line, B on its right"
                input type="range" min="0" max="100" step="1" value="50"
                    oninput="this.closest('figure').querySelector('.pair').style.setProperty('--at', this.value + '%')";
            }
            figcaption { (width) " × " (height) " pixels, view " (view.name()) ", exposure " (exposure) " EV." }
        }
        div.scroll tabindex="0" role="region" aria-label="Numbers" {
            table {
                @for (name, value) in numbers { tr { th scope="row" { (name) } td colspan="3" { (short(value)) } } }
                @for (name, values) in triples {
                    tr { th scope="row" { (name) ", R G B" } @for value in values { td { (short(value)) } } }
                }
            }
        }
        figure {
            (image(&encoded(width, height, &map)?, "FLIP error of each pixel"))
            div.scale {}
            div.ends { span { "0: no visible difference" } span { "1" } }
            figcaption { "FLIP: the difference that observers perceive when flipping between A and B." }
        }
    };
    Ok(document(&format!("{name_a} against {name_b}"), include_str!("page.css"), &body))
}

/// A PNG as a link.
pub fn data(png: &[u8]) -> String {
    format!("data:image/png;base64,{}", STANDARD.encode(png))
}

/// A line of text that changes no direction of the text around it. What XML 1.0 does not allow besides (U+FFFE, U+FFFF) becomes
/// spaces.
pub fn shown(text: &str) -> String {
    console::escaped(text).replace(['\n', '\t', '\u{FFFE}', '\u{FFFF}'], " ")
}
