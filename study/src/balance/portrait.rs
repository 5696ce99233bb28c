//! Pictures of a scene's whole view.

use std::sync::atomic::AtomicBool;

use bismar::Result;
use bismar::balance::Balance;
use bismar::render::Progress;

use super::campaign::Campaign;
use super::cell::Cell;
use super::key::{Key, What};
use super::measure::missing;
use super::{Design, Estimator, HALF, Mosaic, StudyScene};

/// Pictures of a scene that are shown, not measured.
pub struct Portrait {
    pub width: u32,
    pub height: u32,
    /// A balance that `half` is compared with by eye.
    pub shown: Balance,
    /// Paths a pixel of the two noisy pictures.
    pub spp: u32,
    /// Rendered by `shown` with [`PORTRAIT_SPP`] paths a pixel.
    pub clean: Cell,
    /// Rendered by `half` and by `shown`.
    pub noisy: [Cell; 2],
}

/// Pixels of its longer side, about.
const SIDE: u32 = 256;
/// Paths a pixel of a portrait.
pub const PORTRAIT_SPP: u32 = 64;

/// Renders a scene's portrait, larger than the measured pictures, unless it is on disk.
pub fn portrait(
    scene: &StudyScene,
    design: &Design,
    shown: Balance,
    stop: &AtomicBool,
    progress: &(dyn Fn(Progress) + Sync),
) -> Result<Portrait> {
    // The aspect of the measured picture.
    let [width, height] = design.footprint.unwrap_or([design.width, design.height]);
    let side = |n: u32| (SIDE * n / width.max(height)).max(1);
    let [width, height] = if width.max(height) < SIDE {
        let times = SIDE / width.max(height);
        [times * width, times * height]
    } else {
        [side(width), side(height)]
    };
    let mosaic = Mosaic::new([width, height], None)?;
    let mut campaign = Campaign::new(scene, design, mosaic, "portrait-", (stop, progress))?;
    let spp = design.spp.first().map_or(16, |&s| s.min(16));
    let key = |estimator, spp| Key { what: What::Picture(estimator), spp };
    let own = Estimator::Method(shown);
    let mut cells = Vec::new();
    for key in [key(own, PORTRAIT_SPP), key(HALF, spp), key(own, spp)] {
        cells.push((key, campaign.stored(key)?));
    }
    campaign.all = missing(&cells, 1);
    campaign.rounds(&mut cells, 1)?;
    let mut cells = cells.into_iter().map(|(_, cell)| cell);
    let mut next = || cells.next().unwrap_or_default();
    Ok(Portrait { width, height, shown, spp, clean: next(), noisy: [next(), next()] })
}
