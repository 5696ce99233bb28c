//! A heuristic of one's own, for study: a callback sets the light share of each pixel between passes, from the moments of the
//! samples so far. It is slow: every pass is a render that continues the one before.

use std::sync::atomic::AtomicBool;
use std::time::Instant;

use super::{LoadedScene, RenderRequest, RenderedPicture};
use crate::balance::{Balance, Moments};
use crate::integrator::PreparedScene;
use crate::render::{Progress, RenderSettings, Rendered, RunOptions, Saved, StopReason, StudyOptions, run};
use crate::{Error, Result};

/// What the samples of each pixel of the window have shown so far, row by row.
#[derive(Debug, Clone)]
pub struct PixelMoments {
    /// Number of paths.
    pub paths: Vec<u32>,
    /// Light share of the last pass, in [0, 1].
    pub light_shares: Vec<f32>,
    /// Σ W r^k for k = 0, 1, 2, and Σ Z r^k for k = 1, 2 ([`Moments`]), five numbers a pixel.
    pub moments: Vec<[f64; 5]>,
}

/// Returns the light share of each pixel's next pass, in [0, 1], row by row.
pub type Heuristic<'a> = &'a (dyn Fn(PixelMoments) -> Result<Vec<f32>> + Sync);

impl LoadedScene {
    /// Renders like [`render`](Self::render), with light shares by `heuristic` instead of a balance method. Passes are
    /// those of `kl`, which the request names (8, 8, 16, 32, 64, 128, 128, … paths per pixel), each with points of its own, so that the picture is
    /// unbiased whatever the shares; the first has shares of ½.
    ///
    /// # Errors
    /// Those of [`render`](Self::render) and of `heuristic`; [`Error::Usage`] for another balance, without a number of paths, with `time`, `noise` or
    /// `part`, and for shares that are not one number in [0, 1] for each pixel.
    pub fn render_by(
        &self,
        heuristic: Heuristic,
        request: RenderRequest,
        stop: &AtomicBool,
        progress: &(dyn Fn(Progress) + Sync),
    ) -> Result<RenderedPicture> {
        let passes = |scene: &PreparedScene, settings: &RenderSettings, began: Instant| {
            let RenderSettings { spp, time, noise, part, .. } = settings;
            match (spp, time, noise, part) {
                (Some(spp), None, None, None) => {
                    render_passes(scene, settings, *spp, heuristic, (began, stop, progress))
                }
                _ => Err(Error::Usage("a heuristic of one's own needs spp, without time, noise and part".into())),
            }
        };
        if request.balance != Balance::Kl {
            return Err(Error::Usage("a heuristic of one's own needs balance kl, whose passes it has".into()));
        }
        Ok(RenderedPicture { has_own_heuristic: true, ..self.render_with(request, &passes)? })
    }
}

fn render_passes(
    scene: &PreparedScene,
    settings: &RenderSettings,
    spp: u32,
    heuristic: Heuristic,
    (began, stop, progress): (Instant, &AtomicBool, &(dyn Fn(Progress) + Sync)),
) -> Result<Rendered> {
    let (mut from, mut shares) = (None, Vec::new());
    let mut passes = 0;
    loop {
        passes += 1;
        let study = StudyOptions { max_passes: Some(passes), ..Default::default() };
        let mut rendered = run(scene, settings, RunOptions { began, from, study, ..RunOptions::new(stop, progress) })?;
        if rendered.stop == StopReason::Interrupted || rendered.paths_range().0 >= spp {
            return Ok(rendered);
        }
        let window @ [x0, y0, x1, y1] = settings.window();
        let (width, pixels) = ((x1 - x0) as usize, (x1 - x0) as usize * (y1 - y0) as usize);
        let place = |x: u32, y: u32| (y - y0) as usize * width + (x - x0) as usize;
        if shares.is_empty() {
            shares = vec![0.5; pixels];
        }
        let mut found = PixelMoments { paths: vec![0; pixels], light_shares: shares, moments: vec![[0.0; 5]; pixels] };
        for tile in &rendered.tiles {
            for (x, y, i) in tile.inside(window) {
                let Moments { s0, s1, s2, k1, k2, .. } = tile.moments[i];
                let at = place(x, y);
                found.paths[at] = tile.stats[i].samples;
                found.moments[at] = [s0, s1, s2, k1, k2];
            }
        }
        shares = heuristic(found)?;
        if shares.len() != pixels || shares.iter().any(|share| !(0.0..=1.0).contains(share)) {
            return Err(Error::Usage(
                "the heuristic's light shares are not a number from 0 to 1 for each pixel".into(),
            ));
        }
        for tile in &mut rendered.tiles {
            for (x, y, i) in tile.inside(window).collect::<Vec<_>>() {
                tile.shares[i].light_share = shares[place(x, y)];
            }
        }
        from = Some(Saved { tiles: rendered.tiles, stats: rendered.stats, goals: rendered.goals });
    }
}
