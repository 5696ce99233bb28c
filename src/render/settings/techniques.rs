//! The list of techniques that need not pay, a row each, and the choice whether each is used: never, always, or where it pays.
//! Settings, flags, statistics, decisions and the identity of a picture go through this list.

use std::collections::BTreeMap;
use std::ops::{Index, IndexMut};

use serde::de::Error;
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use serde_json::Value;

bismar_scene::named_variants! {
    /// Whether a technique is used.
    pub enum Choice {
        /// Never.
        Off = "off",
        /// Always.
        On = "on",
        /// Where a pre-pass estimates that it pays for its cost.
        Auto = "auto",
    }
}

impl From<bool> for Choice {
    fn from(on: bool) -> Self {
        if on { Self::On } else { Self::Off }
    }
}

/// Paths per pixel from which on paths are allocated, and path guiding is decided about: below, the decision costs more than
/// most pictures could gain.
pub const MIN_AUTO_PATHS: u32 = 16;

/// What tells a technique from others, besides what it does.
#[derive(Debug)]
pub struct Row {
    /// Its flag, without dashes, and its name in the log.
    pub flag: &'static str,
    /// What it does, for help texts: a sentence that ends without a full stop.
    pub about: &'static str,
    /// The choice of renders whose paths are not shared out, guided or re-used ([`RenderSettings::even`](super::RenderSettings::even)).
    /// Off: the plain command has `auto` with balance methods that use pre-passes. Auto: `auto` itself concerns those methods alone.
    pub even: Choice,
    /// May its flag stand alone?
    pub is_switch: bool,
    /// Minimum expected paths per pixel with `auto` and with `on`.
    pub min_paths: [u32; 2],
    /// Is it used beside a goal of noise?
    pub suits_noise_goal: bool,
    /// Does it learn from rounds whose number depends on the goal of the render, where guiding takes part in them?
    pub learns: bool,
}

/// Makes the list.
macro_rules! techniques {
    ($($(#[$doc:meta])* $name:ident $row:tt)+) => {
        /// A technique.
        #[derive(Debug, Clone, Copy, PartialEq, Eq)]
        pub enum Technique { $($(#[$doc])* $name,)+ }

        impl Technique {
            /// All of them, in the order in which they are decided about.
            pub const ALL: [Self; [$(stringify!($name)),+].len()] = [$(Self::$name),+];
        }

        static ROWS: [Row; Technique::ALL.len()] = [$(Row $row),+];
    };
}

techniques! {
    /// The compensated density of the environment.
    Compensation {
        flag: "compensation",
        about: "Compensated environment density: draw light samples of the environment by its radiance above the mean \
                (docs/balance.md)",
        even: Choice::Auto,
        is_switch: false,
        min_paths: [0; 2],
        suits_noise_goal: true,
        learns: false,
    }
    /// Learned selection of area lights.
    LearnedLights {
        flag: "learned-lights",
        about: "Learned light selection: choose among emissive triangles by what a pre-pass has learned (docs/balance.md)",
        even: Choice::Auto,
        is_switch: false,
        min_paths: [0; 2],
        suits_noise_goal: true,
        learns: true,
    }
    /// Path guiding.
    Guiding {
        flag: "guiding",
        about: "Path guiding: sample directions from the light field that a pre-pass has learned (docs/guiding.md). It helps \
                where light reaches the visible surfaces through few paths",
        even: Choice::Off,
        is_switch: false,
        min_paths: [MIN_AUTO_PATHS, 0],
        suits_noise_goal: true,
        learns: true,
    }
    /// Path re-use.
    PathReuse {
        flag: "path-reuse",
        about: "Path re-use: pixels of a tile share what their paths find at second surfaces (docs/path-reuse.md). It helps \
                where most light arrives by other surfaces; the errors of neighbouring pixels are then related. \
                Before a denoiser it gains little, and is off unless it is given. N: groups of N \
                paths; N:M: M of these go on from there, for all",
        even: Choice::Off,
        is_switch: false,
        min_paths: [MIN_AUTO_PATHS, 0],
        suits_noise_goal: true,
        learns: false,
    }
    /// Numbers of paths by tile.
    Adaptive {
        flag: "adaptive",
        about: "Adaptive sampling: a pre-pass estimates the noise of each tile of 16 x 16 pixels, and noisy tiles get more \
                paths; the number of paths is their mean (docs/adaptive.md). Without effect with a goal of noise",
        even: Choice::Off,
        is_switch: true,
        min_paths: [MIN_AUTO_PATHS; 2],
        suits_noise_goal: false,
        learns: false,
    }
}

impl Technique {
    /// Its row of the list.
    pub fn row(self) -> &'static Row {
        &ROWS[self as usize]
    }

    /// Its name in settings, statistics and decisions.
    pub fn name(self) -> String {
        self.row().flag.replace('-', "_")
    }

    /// Its name for people.
    pub fn title(self) -> String {
        self.row().flag.replace('-', " ").replace("reuse", "re-use")
    }

    /// What the plain command chooses, with a balance method that uses pre-passes or not.
    pub fn usual(self, uses_prepasses: bool) -> Choice {
        if uses_prepasses { Choice::Auto } else { self.row().even }
    }
}

/// A value for each technique.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct PerTechnique<T>([T; Technique::ALL.len()]);

impl<T> PerTechnique<T> {
    /// The value of each.
    pub fn new(of: impl FnMut(Technique) -> T) -> Self {
        Self(Technique::ALL.map(of))
    }

    /// All of them, in the order of the list.
    pub fn iter(&self) -> impl Iterator<Item = (Technique, &T)> {
        Technique::ALL.into_iter().zip(&self.0)
    }
}

impl<T> Index<Technique> for PerTechnique<T> {
    type Output = T;

    fn index(&self, technique: Technique) -> &T {
        &self.0[technique as usize]
    }
}

impl<T> IndexMut<Technique> for PerTechnique<T> {
    fn index_mut(&mut self, technique: Technique) -> &mut T {
        &mut self.0[technique as usize]
    }
}

/// The choices of a render.
pub type Choices = PerTechnique<Choice>;

impl Choices {
    /// Those of [`RenderSettings::even`](super::RenderSettings::even).
    pub fn even() -> Self {
        Self::new(|technique| technique.row().even)
    }
}

impl Serialize for Choices {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_map(self.iter().map(|(technique, choice)| (technique.name(), choice)))
    }
}

impl<'de> Deserialize<'de> for Choices {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let named = BTreeMap::<String, Value>::deserialize(deserializer)?;
        let mut choices = Self::default();
        for technique in Technique::ALL {
            let choice = named.get(&technique.name()).ok_or_else(|| D::Error::missing_field(technique.row().flag))?;
            choices[technique] = Choice::deserialize(choice).map_err(D::Error::custom)?;
        }
        Ok(choices)
    }
}

#[cfg(test)]
mod tests {
    use serde_json::{from_str, to_string};

    use super::*;
    use crate::render::RenderSettings;

    #[test]
    fn settings_name_all_choices() {
        for choice in Choice::ALL {
            let settings = RenderSettings { techniques: Choices::new(|_| choice), ..RenderSettings::default() };
            let text = to_string(&settings).unwrap();
            let read: RenderSettings = from_str(&text).unwrap();
            assert_eq!(read.techniques, settings.techniques);
            assert!(text.contains(&format!("\"learned_lights\":\"{}\"", choice.name())), "{text}");
        }
        assert!(from_str::<RenderSettings>("{}").is_err());
    }
}
