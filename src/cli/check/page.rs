//! A self-contained HTML page of golden pictures that are not identical: golden, new, FLIP error, and the place of the largest
//! error enlarged.

use std::fmt::Write as _;
use std::io::Write;
use std::path::Path;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;

use super::outcome::{Check, Limit, Outcome};
use super::report::{line, summary};
use crate::Result;
use crate::cli::compare::false_color;
use crate::cli::compare::page::escaped;
use crate::film::compare::flip_map;
use crate::film::preview::{encoded, encoded_picture, to_byte};
use crate::film::{Exposure, Look, Picture, View, atomic};

/// Side of the enlarged place in pixels.
const CROP: i64 = 48;
const HEAD: &str = "<!doctype html>\n<html lang=en>\n<meta charset=utf-8>\n<meta name=generator content=bismar>\n\
    <meta name=viewport content=\"width=device-width, initial-scale=1\">\n<title>Golden pictures</title>\n<style>\n\
    :root { color-scheme: light dark; }\n\
    body { font: 16px/1.5 system-ui, sans-serif; max-width: 80rem; margin: 0 auto; padding: 1rem; }\n\
    h2 { font-size: 1.1rem; overflow-wrap: anywhere; margin: 2rem 0 .25rem; }\n\
    .row { display: grid; grid-template-columns: repeat(3, minmax(0, 1fr)); gap: .75rem; }\n\
    figure { margin: .5rem 0; }\nfigcaption { font-size: .9rem; }\n\
    img { display: block; width: 100%; height: auto; }\n.crop img { image-rendering: pixelated; }\n\
    </style>\n<h1>Golden pictures</h1>\n";

/// Writes the page.
pub fn write(path: &Path, checks: &[Check], limit: Limit) -> Result<()> {
    let seconds = checks.iter().map(|check| check.seconds).sum();
    let mut text = HEAD.to_owned();
    let Limit { percentile, max_flip } = limit;
    let _ = writeln!(
        text,
        "<p>{}, rendering. FLIP: {percentile} % of the pixels within {max_flip}.</p>",
        summary(checks, seconds)
    );
    for check in checks.iter().filter(|check| !check.outcome.is_identical()) {
        let (name, said) = (escaped(&check.golden.display().to_string()), escaped(&line(check)));
        let _ = writeln!(text, "<h2>{name}</h2>\n<p>{said}</p>");
        if matches!(check.outcome, Outcome::Other { unlike: None, .. }) {
            text += &pictures(check)?;
        }
    }
    atomic::write(path, |file| Ok(Ok(file.write_all(text.as_bytes())?)))
}

/// Both pictures and their errors, with the exposure of the golden one.
fn pictures(check: &Check) -> Result<String> {
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
    let mut text = String::new();
    for (class, window) in [("row", golden.window), ("row crop", place)] {
        let _ = writeln!(text, "<div class=\"{class}\">");
        let at = format!("({}, {}) to ({}, {})", window[0], window[1], window[2], window[3]);
        for (what, picture) in [("golden", &golden), ("new", &new), ("FLIP error", &map)] {
            let shown = picture.within(window);
            let [width, height] = shown.size();
            let png = match what {
                "FLIP error" => {
                    let bytes: Vec<u8> = shown.rgb.iter().flat_map(|p| p.map(to_byte)).collect();
                    encoded(width as u32, height as u32, &bytes)?
                }
                _ => encoded_picture(&shown, &look)?,
            };
            let _ = writeln!(
                text,
                "<figure><img src=\"data:image/png;base64,{}\" width={width} height={height} alt=\"{what}\">\
                 <figcaption>{what}, {at}</figcaption></figure>",
                STANDARD.encode(png)
            );
        }
        text += "</div>\n";
    }
    Ok(text)
}
