//! Figures of a scene: pictures, shares and errors in false colours, the worst pixels.

use bismar::Result;
use bismar::film::View;
use bismar::film::exposure::automatic;

use crate::balance::portrait::PORTRAIT_SPP;
use crate::balance::scene_results::SceneResults;
use crate::balance::table::Outcome;
use crate::balance::{Design, Estimator, HALF};
use crate::report::page::{crop_figure, map_figure, picture_figure, slider};
use crate::report::{ColorScale, Page, Picture, number};
use crate::statistics::quantiles;

/// Share of light samples in false colours.
pub(in crate::balance) const SHARE: ColorScale = ColorScale::Difference { middle: 0.5, half_width: 0.5 };
pub(in crate::balance) const SHARE_WORDS: [&str; 3] = ["0: BSDF alone", "½", "1: light alone"];
const RATIO: ColorScale = ColorScale::Ratio { factor: 4.0 };
const RATIO_WORDS: [&str; 3] = ["¼", "1: as half", "4"];
/// Worst pixels that are shown, and how far around them.
const CROPS: usize = 4;
const CROP_RADIUS: u32 = 4;

pub(in crate::balance) fn exposure(width: u32, picture: &[f32]) -> f32 {
    automatic((width as usize, picture.chunks_exact(3).map(|p| [p[0], p[1], p[2]])))
}

pub(in crate::balance) fn developed(width: u32, height: u32, radiance: &[f32], ev: f32) -> Picture {
    Picture::new(width, height, radiance.chunks_exact(3).map(|p| View::Agx.apply([p[0], p[1], p[2]], ev)))
}

pub(super) fn pictures(page: &mut Page, design: &Design, scene: &SceneResults, outcome: &Outcome) -> Result<()> {
    let portrait = &scene.portrait;
    let name = &outcome.row.estimator;
    let (w, h) = (portrait.width, portrait.height);
    let ev = exposure(portrait.width, portrait.clean.picture(0));
    let shares = |values: &[f32], w, h| Picture::mapped(w, h, SHARE, values.iter().map(|&s| f64::from(s)));
    let mut pieces = vec![
        picture_figure(
            &developed(w, h, portrait.clean.picture(0), ev),
            &format!("{PORTRAIT_SPP} paths a pixel by `{name}`, exposure {ev:+.1} EV."),
        )?,
        map_figure(
            &shares(portrait.clean.shares_of(0), w, h),
            SHARE,
            SHARE_WORDS,
            &format!("Share of light samples that `{name}` found for each pixel of the picture on the left."),
        )?,
    ];
    let oracle = scene.outcome(Estimator::Oracle);
    if let Some(oracle) = oracle {
        pieces.push(map_figure(
            &shares(&oracle.shares, design.width, design.height),
            SHARE,
            SHARE_WORDS,
            "The oracle's shares of the measured pixels, by brute force.",
        )?);
    }
    let mut ratios = vec![f64::NAN; (design.width * design.height) as usize];
    outcome.ratios.iter().for_each(|r| ratios[r.pixel] = r.ratio);
    pieces.push(map_figure(
        &Picture::mapped(design.width, design.height, RATIO, ratios.into_iter()),
        RATIO,
        RATIO_WORDS,
        &format!("Variance by `{name}` over that by `half`, pixel by pixel, noise included. Grey: not judged."),
    )?);
    page.row(pieces);
    Ok(())
}

pub(super) fn by_eye(page: &mut Page, design: &Design, scene: &SceneResults) -> Result<()> {
    let portrait = &scene.portrait;
    let shown = Estimator::Method(portrait.shown);
    let (Some(a), Some(b)) = (scene.outcome(HALF), scene.outcome(shown)) else { return Ok(()) };
    let (name, spp) = (shown.name(), portrait.spp);
    page.heading("By eye");
    let ev = exposure(portrait.width, portrait.clean.picture(0));
    let [left, right] = [0, 1].map(|i| developed(portrait.width, portrait.height, portrait.noisy[i].picture(0), ev));
    let caption = format!("The same {spp} paths a pixel. Pull the line: `half` on its left, `{name}` on its right.");
    let mut pieces =
        vec![slider((&left, &format!("half, {spp} spp")), (&right, &format!("{name}, {spp} spp")), &caption)?];
    let [high] = quantiles(a.variances.iter().map(|v| v.sqrt()).collect(), [0.99]);
    let high = high.max(1e-6);
    let scale = ColorScale::Amount { low: high / 100.0, high };
    let (low, middle, high) = (number(high / 100.0), number(high / 10.0), number(high));
    for (name, outcome) in [("half", a), (&name[..], b)] {
        pieces.push(map_figure(
            &Picture::mapped(design.width, design.height, scale, outcome.variances.iter().map(|v| v.sqrt())),
            scale,
            [&low, &middle, &high],
            &format!("Relative error of the measured pixels by `{name}`, {} paths each.", outcome.row.spp),
        )?);
    }
    page.row(pieces);
    Ok(())
}

pub(super) fn worst_pixels(page: &mut Page, design: &Design, scene: &SceneResults, outcome: &Outcome) -> Result<()> {
    let name = &outcome.row.estimator;
    let mut sorted = outcome.ratios.iter().filter(|r| r.z(1.0) > 0.0).collect::<Vec<_>>();
    sorted.sort_by(|a, b| b.z(1.0).total_cmp(&a.z(1.0)));
    if sorted.is_empty() {
        return Ok(());
    }
    let (w, h) = (design.width, design.height);
    let reference = scene.reference.iter().map(|&x| x as f32).collect::<Vec<_>>();
    let ev = exposure(design.width, &reference);
    let all = [
        ("reference", developed(w, h, &reference, ev)),
        ("half", developed(w, h, &scene.examples[0], ev)),
        (name.as_str(), developed(w, h, &scene.examples[1], ev)),
        ("share", Picture::mapped(w, h, SHARE, outcome.shares.iter().map(|&s| f64::from(s)))),
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
            pieces.push(crop_figure(&picture.around([x, y], CROP_RADIUS), &caption)?);
        }
        page.row(pieces);
    }
    Ok(())
}
