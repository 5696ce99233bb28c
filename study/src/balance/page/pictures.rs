//! Figures of a scene: pictures, shares and errors in false colours, the worst pixels.

use bismar::Result;
use bismar::film::View;
use bismar::film::exposure::automatic;
use image::RgbImage;

use crate::balance::portrait::PORTRAIT_SPP;
use crate::balance::scene_results::SceneResults;
use crate::balance::table::Outcome;
use crate::balance::{Design, Estimator, HALF};
use crate::report::page::{map_figure, picture_figure, slider};
use crate::report::picture::{around, mapped, picture};
use crate::report::{ColorScale, Page, number};
use crate::statistics::quantiles;

/// False colours of values with what they mean.
type Legend = (ColorScale, [&'static str; 3]);

/// Share of light samples in false colours.
pub(in crate::balance) const SHARE: Legend = (ColorScale::Share, ["0: BSDF alone", "½", "1: light alone"]);
const RATIO: Legend = (ColorScale::Ratio { factor: 4.0 }, ["¼", "1: as half", "4"]);
/// Worst pixels that are shown, and how far around them.
const CROPS: usize = 4;
const CROP_RADIUS: u32 = 4;

pub(in crate::balance) fn exposure(width: u32, picture: &[f32]) -> f32 {
    automatic((width as usize, picture.chunks_exact(3).map(|p| [p[0], p[1], p[2]])))
}

pub(in crate::balance) fn developed(size: [u32; 2], radiance: &[f32], ev: f32) -> RgbImage {
    picture(size, radiance.chunks_exact(3).map(|p| View::Agx.apply([p[0], p[1], p[2]], ev)))
}

pub(super) fn pictures(page: &mut Page, design: &Design, scene: &SceneResults, outcome: &Outcome) {
    let portrait = &scene.portrait;
    let name = &outcome.row.estimator;
    let (whole, measured) = ([portrait.width, portrait.height], [design.width, design.height]);
    let ev = exposure(portrait.width, portrait.clean.picture(0));
    let shares =
        |size, values: &[f32], caption: &str| map_figure(size, SHARE, values.iter().map(|&s| f64::from(s)), caption);
    let mut pieces = vec![
        picture_figure(
            "pic",
            &developed(whole, portrait.clean.picture(0), ev),
            &format!("{PORTRAIT_SPP} paths a pixel by `{name}`, exposure {ev:+.1} EV."),
        ),
        shares(
            whole,
            portrait.clean.shares_of(0),
            &format!("Share of light samples that `{name}` found for each pixel of the picture on the left."),
        ),
    ];
    if let Some(oracle) = scene.outcome(Estimator::Oracle) {
        let caption = "The oracle's shares of the measured pixels, by brute force.";
        pieces.push(shares(measured, &oracle.shares, caption));
    }
    let mut ratios = vec![f64::NAN; (design.width * design.height) as usize];
    outcome.ratios.iter().for_each(|r| ratios[r.pixel] = r.ratio);
    let caption =
        format!("Variance by `{name}` over that by `half`, pixel by pixel, noise included. Grey: not judged.");
    pieces.push(map_figure(measured, RATIO, ratios.into_iter(), &caption));
    page.row(pieces);
}

pub(super) fn by_eye(page: &mut Page, design: &Design, scene: &SceneResults) {
    let portrait = &scene.portrait;
    let shown = Estimator::Method(portrait.shown);
    let (Some(a), Some(b)) = (scene.outcome(HALF), scene.outcome(shown)) else { return };
    let (name, spp) = (shown.name(), portrait.spp);
    page.heading("By eye");
    let ev = exposure(portrait.width, portrait.clean.picture(0));
    let [left, right] = [0, 1].map(|i| developed([portrait.width, portrait.height], portrait.noisy[i].picture(0), ev));
    let caption = format!("The same {spp} paths a pixel. Pull the line: `half` on its left, `{name}` on its right.");
    let mut pieces =
        vec![slider((&left, &format!("half, {spp} spp")), (&right, &format!("{name}, {spp} spp")), &caption)];
    let [high] = quantiles(a.variances.iter().map(|v| v.sqrt()).collect(), [0.99]);
    let high = high.max(1e-6);
    let scale = ColorScale::Amount { low: high / 100.0, high };
    let words = [high / 100.0, high / 10.0, high].map(number);
    for (name, outcome) in [("half", a), (&name[..], b)] {
        pieces.push(map_figure(
            [design.width, design.height],
            (scale, [&words[0], &words[1], &words[2]]),
            outcome.variances.iter().map(|v| v.sqrt()),
            &format!("Relative error of the measured pixels by `{name}`, {} paths each.", outcome.row.spp),
        ));
    }
    page.row(pieces);
}

pub(super) fn worst_pixels(page: &mut Page, design: &Design, scene: &SceneResults, outcome: &Outcome) -> Result<()> {
    let name = &outcome.row.estimator;
    let mut sorted = outcome.ratios.iter().filter(|r| r.z(1.0) > 0.0).collect::<Vec<_>>();
    sorted.sort_by(|a, b| b.z(1.0).total_cmp(&a.z(1.0)));
    if sorted.is_empty() {
        return Ok(());
    }
    let (size, w) = ([design.width, design.height], design.width);
    let reference = scene.reference.iter().map(|&x| x as f32).collect::<Vec<_>>();
    let ev = exposure(w, &reference);
    let all = [
        ("reference", developed(size, &reference, ev)),
        ("half", developed(size, &scene.examples[0], ev)),
        (name.as_str(), developed(size, &scene.examples[1], ev)),
        ("share", mapped(size, SHARE.0, outcome.shares.iter().map(|&s| f64::from(s)))),
    ];
    page.heading("The pixels that look worst");
    page.text(&format!(
        "The {} pixels in which `{name}` is worse than `half` with the largest z, in the middle of {side}x{side} of the measured \
         pixels, {} paths a pixel, one replica. With so many pixels, a z of 3 to 4 is noise.",
        sorted.len().min(CROPS),
        outcome.row.spp,
        side = 2 * CROP_RADIUS + 1
    ));
    let mosaic = design.mosaic()?;
    for ratio in sorted.into_iter().take(CROPS) {
        let ([px, py], x, y) = (mosaic.coordinates(ratio.pixel), ratio.pixel as u32 % w, ratio.pixel as u32 / w);
        let (low, high) = ((-ratio.log_error).exp() * ratio.ratio, ratio.log_error.exp() * ratio.ratio);
        let mut pieces = Vec::new();
        for (i, (what, picture)) in all.iter().enumerate() {
            let caption = match i {
                0 => format!(
                    "({px}, {py}): ratio {} ({} to {}), z {:.1}",
                    number(ratio.ratio),
                    number(low),
                    number(high),
                    ratio.z(1.0)
                ),
                3 => format!("share {:.2}", outcome.shares[ratio.pixel]),
                _ => what.to_string(),
            };
            pieces.push(picture_figure("crop", &around(picture, [x, y], CROP_RADIUS), &caption));
        }
        page.row(pieces);
    }
    Ok(())
}
