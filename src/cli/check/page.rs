//! A self-contained HTML page of golden pictures that are not identical: golden, new, FLIP error, and the place of the largest
//! error enlarged.

use std::path::Path;

use maud::{Markup, html};

use super::outcome::{Check, Limit, Outcome};
use super::report::{line, summary};
use crate::Result;
use crate::cli::compare::false_color;
use crate::cli::compare::page::{data, document, save, shown};
use crate::film::compare::flip_map;
use crate::film::preview::{encoded, encoded_picture, to_byte};
use crate::film::{Exposure, Look, Picture, View};

/// Side of the enlarged place in pixels.
const CROP: i64 = 48;

pub fn write(path: &Path, checks: &[Check], Limit { percentile, max_flip }: Limit) -> Result<()> {
    let seconds = checks.iter().map(|check| check.seconds).sum();
    let mut parts = Vec::new();
    for check in checks.iter().filter(|check| !check.outcome.is_identical()) {
        let has_pictures = matches!(check.outcome, Outcome::Other { unlike: None, .. });
        parts.push(html! {
            h2 { (shown(&check.golden.display().to_string())) }
            p { (shown(&line(check))) }
            @if has_pictures { (pictures(check)?) }
        });
    }
    let body = html! {
        h1 { "Golden pictures" }
        p { (summary(checks, seconds)) ", rendering. FLIP: " (percentile) " % of the pixels within " (max_flip) "." }
        @for part in parts { (part) }
    };
    save(path, &document("Golden pictures", include_str!("page.css"), &body))
}

/// Both pictures and their errors, with the exposure of the golden one.
fn pictures(check: &Check) -> Result<Markup> {
    let (golden, new) = (Picture::open(&check.golden, None)?, Picture::open(&check.new, None)?);
    let look = Look { view: View::Agx.into(), exposure: Exposure::Auto.of(golden.colors()) };
    let errors = flip_map(&new, &golden);
    let [width, height] = golden.size();
    let largest = errors.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1)).map_or(0, |(i, _)| i);
    let corner = |at: usize, size: usize| (at as i64 - CROP / 2).min(size as i64 - CROP).max(0);
    let (x, y) = (corner(largest % width, width), corner(largest / width, height));
    let [x0, y0, ..] = golden.window;
    let end = |at: i64, size: usize| (at + CROP).min(size as i64);
    let place = [x0 + x, y0 + y, x0 + end(x, width), y0 + end(y, height)];
    // The errors as a picture, so that it can be cropped in the same way.
    let map = Picture {
        rgb: errors.iter().map(|e| false_color(*e)).collect(),
        variance: None,
        alpha: None,
        ..golden.clone()
    };
    let figure = |what: &str, picture: &Picture, window: [i64; 4]| -> Result<Markup> {
        let picture = picture.within(window);
        let [width, height] = picture.size();
        let png = if what == "FLIP error" {
            let bytes: Vec<u8> = picture.rgb.iter().flat_map(|p| p.map(to_byte)).collect();
            encoded(width as u32, height as u32, &bytes)?
        } else {
            encoded_picture(&picture, &look)?
        };
        let [x0, y0, x1, y1] = window;
        Ok(html! {
            figure {
                img src=(data(&png)) width=(width) height=(height) alt=(what);
                figcaption { (what) ", (" (x0) ", " (y0) ") to (" (x1) ", " (y1) ")" }
            }
        })
    };
    let row = |class: &str, window: [i64; 4]| -> Result<Markup> {
        Ok(html! {
            div class=(class) {
                (figure("golden", &golden, window)?) (figure("new", &new, window)?) (figure("FLIP error", &map, window)?)
            }
        })
    };
    Ok(html! { (row("row", golden.window)?) (row("row crop", place)?) })
}
