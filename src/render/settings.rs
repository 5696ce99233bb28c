//! What to render, checked.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::Part;
use super::adaptive::{NOISE_PATHS, NoiseGoal};
use super::lens::LensSettings;
use super::tile::Columns;
pub use crate::balance::Balance;
use crate::guiding::Guiding;
pub use crate::sampling::PixelFilter;

/// Which light transport.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Integrator {
    /// Emission, direct and indirect light.
    Path,
    /// Emission and direct light.
    Direct,
}

impl Integrator {
    /// All of them, in the order of the command line's help.
    pub const ALL: [Self; 2] = [Self::Path, Self::Direct];

    /// Name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Path => "path",
            Self::Direct => "direct",
        }
    }
}

/// Everything that the picture's bits depend on besides the scene and the backend, and when to stop.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct RenderSettings {
    /// Index into [`Scene::cameras`](crate::scene::Scene::cameras).
    pub camera: usize,
    /// Whole picture's pixels a row, ≥ 1.
    pub width: u32,
    /// Whole picture's rows, ≥ 1.
    pub height: u32,
    /// Window that is kept: x0, y0, x1, y1, the last two exclusive, inside the picture, not empty.
    pub crop: Option<[u32; 4]>,
    /// Which light transport.
    pub integrator: Integrator,
    /// Most segments of a path, ≥ 1: 1 is emission alone, 2 is direct light.
    pub max_depth: u32,
    /// Paths a pixel at which to stop, ≥ 1.
    pub spp: Option<u32>,
    /// Wall seconds of all sessions at which to stop, loading included, > 0.
    pub time: Option<f64>,
    /// Estimated relative error at which pixels of a tile take no more paths ([`adaptive`](super::adaptive)), > 0.
    pub noise: Option<f64>,
    /// Paths a pixel before `noise` is asked for; `None`: [`NOISE_PATHS`].
    #[serde(default)]
    pub min_spp: Option<u32>,
    /// Do tiles have paths by what theirs vary and cost ([`allocation`](super::allocation)), `spp` in the mean? Not with
    /// `noise`, which goes by the same and by its goal.
    #[serde(default, skip_serializing_if = "is_default")]
    pub adaptive: bool,
    /// How light and BSDF sampling share the work.
    pub balance: Balance,
    /// `second-order`'s pilot as a share of all paths, in (0, 1); `None`:
    /// [`HALF_PILOT`](crate::balance::HALF_PILOT).
    #[serde(default)]
    pub pilot: Option<f64>,
    /// Are paths led to where a pilot found light?
    #[serde(default, skip_serializing_if = "is_default")]
    pub guiding: Guiding,
    /// Bytes that guiding may take; `None`: [`MEMORY`](super::prepass::guiding::MEMORY).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub guiding_memory: Option<u64>,
    /// Seed of every random choice.
    pub seed: u32,
    /// Pixel filter.
    pub filter: PixelFilter,
    /// Keep the sums that AOVs need?
    pub aovs: bool,
    /// Keep the extra sums that some AOVs need?
    #[serde(default)]
    pub extras: bool,
    /// Most of a channel in a light's contribution, found from first surfaces, > 0; `None`: no limit. A limit takes fireflies
    /// away, and light with them.
    #[serde(default)]
    pub clamp_direct: Option<f64>,
    /// As `clamp_direct`, found from later surfaces.
    #[serde(default)]
    pub clamp_indirect: Option<f64>,
    /// Leave the environment out of the picture, where the camera sees it directly; it gives light all the same.
    #[serde(default)]
    pub transparent: bool,
    /// The camera's lens; `None`: a pinhole, all is sharp.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lens: Option<LensSettings>,
    /// Render this part of the tiles only.
    pub part: Option<Part>,
    /// For studies: the share of light samples that each pixel of the whole picture (row by row) begins with instead of
    /// ½; with a balance that does not learn, the share of all its passes.
    #[serde(skip)]
    pub shares: Option<Arc<[f32]>>,
    /// For studies: stop after this many passes.
    #[serde(skip)]
    pub passes: Option<u32>,
    /// For studies: render these tiles of the whole picture's grid alone ([`Tile::grid_position`](super::tile::Tile)), in
    /// this order.
    #[serde(skip)]
    pub tiles: Option<Arc<[[u32; 2]]>>,
}

/// Paths a pixel that a render is expected to have whose end is not known.
const UNKNOWN_SPP: u32 = 128;

fn is_default<T: Default + PartialEq>(value: &T) -> bool {
    *value == T::default()
}

impl RenderSettings {
    /// What tiles keep besides the statistics.
    pub fn columns(&self) -> Columns {
        Columns { moments: self.balance.method().sums_moments(), aovs: self.aovs, extras: self.extras }
    }

    /// When tiles' pixels end, besides the samples.
    pub fn noise_goal(&self) -> Option<NoiseGoal> {
        self.noise.map(|error| NoiseGoal { error, least: self.min_spp.unwrap_or(NOISE_PATHS).max(2) })
    }

    /// How many paths a pixel there will be, about, as far as that can be known before the first.
    pub fn expected_spp(&self) -> u32 {
        let until = self.noise.is_some() || self.time.is_some();
        match self.spp {
            Some(spp) if !until => spp,
            spp => spp.unwrap_or(UNKNOWN_SPP).min(UNKNOWN_SPP),
        }
    }

    /// The window that is kept: x0, y0, x1, y1, the last two exclusive.
    pub fn window(&self) -> [u32; 4] {
        self.crop.unwrap_or([0, 0, self.width, self.height])
    }
}

impl Default for RenderSettings {
    fn default() -> Self {
        Self {
            camera: 0,
            width: 960,
            height: 540,
            crop: None,
            integrator: Integrator::Path,
            max_depth: 8,
            spp: Some(64),
            time: None,
            noise: None,
            min_spp: None,
            adaptive: false,
            balance: Balance::Progressive,
            pilot: None,
            guiding: Guiding::Off,
            guiding_memory: None,
            seed: 0,
            filter: PixelFilter::Gaussian,
            aovs: false,
            extras: false,
            clamp_direct: None,
            clamp_indirect: None,
            transparent: false,
            lens: None,
            part: None,
            shares: None,
            passes: None,
            tiles: None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn how_many_paths_are_expected_is_what_is_known_before_the_first() {
        let of = |spp, time, noise| RenderSettings { spp, time, noise, ..Default::default() }.expected_spp();
        assert_eq!(of(Some(1000), None, None), 1000);
        assert_eq!(of(None, Some(9.0), None), UNKNOWN_SPP);
        assert_eq!(of(Some(1000), None, Some(0.1)), UNKNOWN_SPP);
        assert_eq!(of(Some(20), Some(9.0), Some(0.1)), 20);
    }
}
