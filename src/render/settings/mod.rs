//! The settings of a render.

pub mod camera;
pub mod clipped;
pub mod lens;
pub mod light_groups;
pub mod noise;
pub mod part;
pub mod techniques;
pub mod transport;
pub mod validate;

use std::collections::BTreeMap;
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use self::lens::LensSettings;
use self::light_groups::LightGroups;
use self::noise::{NOISE_PATHS, NoiseGoal};
use self::part::Part;
use self::techniques::{Choice, Choices, Technique};
use crate::balance::DEFAULT_PILOT_FRACTION;
pub use crate::balance::{Balance, CustomMethod};
use crate::integrator::Reuse;
pub use crate::sampling::PixelFilter;

/// Named values, for comparison.
pub type Values = BTreeMap<String, String>;

/// The serialised name of a variant: that of files and of the command line.
pub(in crate::render) fn variant_name(variant: &impl Serialize) -> String {
    let name = serde_json::to_value(variant).ok();
    name.and_then(|n| n.as_str().map(str::to_owned)).unwrap_or_default()
}

/// Default maximum bytes of a guiding field and its training samples.
pub const GUIDING_MEMORY: u64 = 256 << 20;

bismar_scene::named_variants! {
    /// The light transport.
    pub enum Integrator {
        /// Path tracing: emission, direct and indirect light.
        Path = "path",
        /// Emission and direct light.
        Direct = "direct",
    }
}

bismar_scene::named_variants! {
    /// What rays from the camera and their mirror images do at back faces of single-sided materials without transmission
    /// ([`back_faces`](crate::integrator::through::back_faces)).
    pub enum BackFaces {
        /// Rays from the camera and their mirror images pass them.
        Cull = "cull",
        /// They are drawn.
        Show = "show",
    }
}

bismar_scene::named_variants! {
    /// What shadow rays do at bodies of smooth glass ([`glass_shadows`](crate::integrator::through::glass_shadows)).
    pub enum GlassShadows {
        /// Shadow rays end at them; light behind is found by refracted paths.
        Off = "off",
        /// Shadow rays pass them straight, dimmed by Fresnel and absorption: approximate.
        Straight = "straight",
    }
}

bismar_scene::named_variants! {
    /// What lies below the scene.
    pub enum Ground {
        /// Nothing.
        None = "none",
        /// A plane that shows shadows alone.
        Shadow = "shadow",
    }
}

/// All that the picture's bits depend on besides the scene and the ray library, and when to stop.
/// [`validate`](Self::validate) checks the ranges.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct RenderSettings {
    /// Index into [`Scene::cameras`](crate::scene::Scene::cameras).
    pub camera: usize,
    /// Width of the whole picture in pixels, 1 to [`MAX_SIDE`].
    pub width: u32,
    /// Height of the whole picture in pixels, 1 to [`MAX_SIDE`].
    pub height: u32,
    /// Crop window in pixels: x0, y0, x1, y1, the last two exclusive; inside the picture and not empty.
    pub crop: Option<[u32; 4]>,
    /// The light transport.
    pub integrator: Integrator,
    /// Maximum segments of a path, 1 to [`MAX_SEGMENTS`](crate::integrator::data::dimensions::MAX_SEGMENTS): 1 is emission alone, 2 adds direct light. Mirror-like bounces at smooth glass are not
    /// counted ([`RayHistory`](crate::integrator::data::history::RayHistory)).
    pub max_depth: u32,
    /// Stop at this number of paths per pixel, ≥ 1.
    pub spp: Option<u32>,
    /// Stop after these wall seconds of all sessions, including loading, > 0.
    pub time: Option<f64>,
    /// Stop at this estimated relative error, tile by tile, > 0.
    pub noise: Option<f64>,
    /// Minimum paths per pixel before `noise` is estimated, ≥ 2; `None`: [`NOISE_PATHS`].
    pub min_spp: Option<u32>,
    /// The method that divides samples between light sampling and BSDF sampling.
    pub balance: Balance,
    /// Fraction of all paths in the pilot of `second-order`, in (0, 1); `None`:
    /// [`DEFAULT_PILOT_FRACTION`].
    pub pilot: Option<f64>,
    /// Which techniques are used.
    #[serde(flatten)]
    pub techniques: Choices,
    /// Maximum bytes of guiding; `None`: [`GUIDING_MEMORY`].
    pub guiding_memory: Option<u64>,
    /// Seed of every random choice.
    pub seed: u32,
    /// Pixel filter.
    pub filter: PixelFilter,
    /// Accumulate the sums that AOVs need?
    pub aovs: bool,
    /// Accumulate the extra sums that some AOVs need?
    pub extras: bool,
    /// Maximum of a channel in the contribution of light at first surfaces, > 0; `None`: no limit. A limit removes fireflies
    /// but loses energy.
    pub clamp_direct: Option<f64>,
    /// Maximum of a channel in the contribution of light at later surfaces, > 0; `None`: no limit.
    pub clamp_indirect: Option<f64>,
    /// Hide the environment where the camera sees it directly. It still lights the scene.
    pub transparent: bool,
    /// The camera's lens; `None`: a pinhole.
    pub lens: Option<LensSettings>,
    /// Back faces of single-sided materials.
    pub back_faces: BackFaces,
    /// What shadow rays do at bodies of smooth glass.
    pub glass_shadows: GlassShadows,
    /// Sizes of groups where path re-use is on; `None`: the usual ones.
    pub reuse_sizes: Option<Reuse>,
    /// Does the camera see only what lies between its clipping planes?
    pub clip: bool,
    /// What lies below the scene.
    pub ground: Ground,
    /// Groups of lights, by name or kind, by which the AOV `lights` divides the beauty.
    pub light_groups: Option<LightGroups>,
    /// Render only this part of the tiles.
    pub part: Option<Part>,
}

/// Options of a render that only studies use. They are not stored in files.
#[derive(Debug, Clone, Default)]
pub struct StudyOptions {
    /// Stop after this many passes.
    pub max_passes: Option<u32>,
    /// Render only these tiles of the whole picture's grid (column and row), in this order.
    pub tiles: Option<Arc<[[u32; 2]]>>,
}

/// Maximum width and height of a picture in pixels.
pub const MAX_SIDE: u32 = 1 << 16;
/// Expected paths per pixel of a render whose end is not known.
const UNKNOWN_SPP: u32 = 128;

/// Which columns tiles have besides the statistics.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Columns {
    /// Moments of the balance.
    pub moments: bool,
    /// AOV sums.
    pub aovs: bool,
    /// Extra sums.
    pub extras: bool,
    /// Sums of the ground.
    pub ground: bool,
    /// Number of light layers.
    pub layers: usize,
}

impl RenderSettings {
    /// The defaults, but all pixels get the same number of paths, and none is guided.
    pub fn even() -> Self {
        Self { techniques: Choices::even(), ..Self::default() }
    }

    /// The same with this choice.
    pub fn with(mut self, technique: Technique, choice: Choice) -> Self {
        self.techniques[technique] = choice;
        self
    }

    /// Named values that the bits of a picture depend on.
    pub fn bits(&self) -> Values {
        // Exhaustive: a new setting must say here whether bits depend on it.
        let RenderSettings {
            camera,
            width,
            height,
            crop,
            integrator,
            max_depth,
            spp,
            // Stop rules: a render can be resumed with others.
            time: _,
            noise: _,
            min_spp: _,
            balance,
            pilot,
            techniques,
            guiding_memory,
            seed,
            filter,
            aovs,
            extras,
            clamp_direct,
            clamp_indirect,
            transparent,
            lens,
            back_faces,
            clip,
            glass_shadows,
            reuse_sizes,
            ground,
            light_groups,
            // Parts have the bits of the whole.
            part: _,
        } = self;
        let mut values = Values::new();
        let mut insert = |name: &str, value: String| values.insert(name.into(), value);
        let limit = |limit: &Option<f64>| limit.map_or("none".into(), |limit| limit.to_string());
        insert("camera", camera.to_string());
        insert("size", format!("{width}x{height}"));
        insert("crop", crop.map_or("none".into(), |c| c.map(|x| x.to_string()).join(",")));
        insert("integrator", variant_name(integrator));
        insert("max-depth", max_depth.to_string());
        insert("balance", variant_name(balance));
        insert("filter", variant_name(filter));
        insert("seed", seed.to_string());
        insert("sums for AOVs", aovs.to_string());
        insert("more sums for AOVs", extras.to_string());
        insert("clamp-direct", limit(clamp_direct));
        insert("clamp-indirect", limit(clamp_indirect));
        insert("transparent", transparent.to_string());
        insert("lens", lens.map_or("pinhole".into(), |lens| lens.to_string()));
        insert("clip", clip.to_string());
        insert("back-faces", variant_name(back_faces));
        insert("glass-shadows", variant_name(glass_shadows));
        insert("path-reuse sizes", reuse_sizes.map_or("usual".into(), |sizes| sizes.to_string()));
        insert("ground", variant_name(ground));
        insert("light-groups", light_groups.clone().map_or("none".into(), String::from));
        // The rules, not what they led to: that follows from them.
        for (technique, choice) in techniques.iter() {
            insert(technique.row().flag, choice.name().into());
        }
        if techniques[Technique::Guiding] != Choice::Off {
            insert("guiding-memory", guiding_memory.unwrap_or(GUIDING_MEMORY).to_string());
        }
        // The passes of such a balance depend on the number of samples.
        if balance.method().needs_goal() {
            insert("pilot", pilot.unwrap_or(DEFAULT_PILOT_FRACTION).to_string());
            let spp = spp.map_or("none".into(), |n| n.to_string());
            insert(&format!("spp ({}'s pilot is a share of it)", balance.name()), spp);
        }
        values
    }

    /// The columns of tiles besides the statistics.
    pub fn columns(&self) -> Columns {
        Columns {
            moments: self.balance.method().sums_moments(),
            aovs: self.aovs,
            extras: self.extras,
            ground: self.catches_shadows(),
            layers: self.light_groups.as_ref().map_or(0, |groups| groups.names().len()),
        }
    }

    /// Is there a ground that catches shadows?
    pub fn catches_shadows(&self) -> bool {
        self.ground == Ground::Shadow
    }

    /// The noise goal, if there is one.
    pub fn noise_goal(&self) -> Option<NoiseGoal> {
        let (min_paths, max_paths) = (self.min_spp.unwrap_or(NOISE_PATHS).max(2), self.spp.unwrap_or(u32::MAX));
        self.noise.map(|error| NoiseGoal { error, min_paths, max_paths })
    }

    /// Expected paths per pixel, as far as they are known before the first.
    pub fn expected_spp(&self) -> u32 {
        let until = self.noise.is_some() || self.time.is_some();
        match self.spp {
            Some(spp) if !until => spp,
            spp => spp.unwrap_or(UNKNOWN_SPP).min(UNKNOWN_SPP),
        }
    }

    /// Why these settings rule a technique out; `None` where its pre-pass runs.
    pub fn rules_out(&self, technique: Technique) -> Option<String> {
        let row = technique.row();
        let [auto, on] = row.min_paths;
        let few = |least| (self.expected_spp() < least).then(|| format!("fewer than {least} paths per pixel"));
        match self.techniques[technique] {
            Choice::Off => Some("not asked for".into()),
            _ if self.noise.is_some() && !row.suits_noise_goal => {
                Some("a noise goal gives each tile what it needs".into())
            }
            Choice::Auto if row.even == Choice::Auto && !self.balance.method().uses_prepasses() => {
                Some(format!("--balance {} uses it where it is on", self.balance.name()))
            }
            Choice::Auto => few(auto),
            Choice::On => few(on),
        }
    }

    /// Does the pre-pass of a technique run, as far as the settings tell?
    pub fn asks_for(&self, technique: Technique) -> bool {
        self.rules_out(technique).is_none()
    }

    /// Pixels of the whole picture.
    pub(in crate::render) fn pixels(&self) -> f64 {
        f64::from(self.width) * f64::from(self.height)
    }

    /// The crop window or the whole picture, in pixels: x0, y0, x1, y1, the last two exclusive.
    pub fn window(&self) -> [u32; 4] {
        self.crop.unwrap_or([0, 0, self.width, self.height])
    }
}

/// The settings of `bismar render` without a flag.
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
            balance: Balance::Progressive,
            pilot: None,
            techniques: Choices::new(|_| Choice::Auto),
            guiding_memory: None,
            seed: 0,
            filter: PixelFilter::Gaussian,
            aovs: false,
            extras: false,
            clamp_direct: None,
            clamp_indirect: None,
            transparent: false,
            lens: None,
            back_faces: BackFaces::Cull,
            clip: true,
            glass_shadows: GlassShadows::Off,
            reuse_sizes: None,
            ground: Ground::None,
            light_groups: None,
            part: None,
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
