//! Techniques that need not pay: what their pre-passes found, and what was decided about them and why, for a line of the log and
//! the statistics.

use std::fmt::{self, Display};

use serde::{Deserialize, Serialize};

use super::settings::MIN_AUTO_PATHS;
use super::{Choice, RenderSettings};

/// What the pre-passes of a render found; `None` for those that did not run.
#[derive(Debug, Clone, Copy, Default, Serialize, Deserialize)]
pub struct TechniqueStats {
    /// The density of the environment.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub compensation: Option<CompensationStats>,
    /// Learned selection of area lights.
    #[serde(rename = "lamps", skip_serializing_if = "Option::is_none")]
    pub learned_lights: Option<LearnedLightsStats>,
    /// Path guiding.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub guiding: Option<GuidingStats>,
    /// Allocation of paths to tiles.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub adaptive: Option<AdaptiveStats>,
}

impl TechniqueStats {
    /// These, and those of an earlier session where a pre-pass did not run.
    pub fn or(self, earlier: Self) -> Self {
        Self {
            compensation: self.compensation.or(earlier.compensation),
            learned_lights: self.learned_lights.or(earlier.learned_lights),
            guiding: self.guiding.or(earlier.guiding),
            adaptive: self.adaptive.or(earlier.adaptive),
        }
    }
}

/// The estimated efficiency of a field.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct GuidingEfficiency {
    /// Variance of guided paths over that of unguided ones.
    pub variance: f32,
    /// Rays of a guided path over those of an unguided one.
    pub cost: f32,
    /// Mean fraction of directions that are sampled from the field.
    pub share: f32,
}

impl GuidingEfficiency {
    /// The fraction of variance times rays that remains.
    pub fn remaining(&self) -> f32 {
        self.variance * self.cost
    }
}

/// The result of the guiding pre-pass.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
pub struct GuidingStats {
    /// Are paths guided?
    pub on: bool,
    /// Cells of the field.
    pub cells: usize,
    /// Its bytes.
    pub bytes: usize,
    /// Its estimated efficiency.
    #[serde(flatten)]
    pub efficiency: GuidingEfficiency,
    /// Wall seconds.
    pub seconds: f64,
}

/// The result of the pre-pass of the environment.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct CompensationStats {
    /// Is the environment sampled by the compensated density?
    pub on: bool,
    /// Estimated variance over that without it; `None` where it was not estimated.
    #[serde(rename = "left", skip_serializing_if = "Option::is_none")]
    pub remaining_variance: Option<f64>,
    /// Wall seconds.
    pub seconds: f64,
}

/// The result of the pre-pass of emissive triangles.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
pub struct LearnedLightsStats {
    /// Are light samples chosen by it?
    pub on: bool,
    /// Cells in space.
    pub cells: usize,
    /// Bytes of the cells.
    pub bytes: usize,
    /// Estimated variance over that without it.
    #[serde(rename = "left")]
    pub remaining_variance: f64,
    /// Wall seconds.
    pub seconds: f64,
}

/// The estimated efficiency of an allocation.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct AllocationEfficiency {
    /// Variance times cost, over that of a uniform allocation.
    #[serde(rename = "left")]
    pub remaining: f64,
    /// Minimum and maximum paths of a tile, over the mean; both 1 where the allocation is uniform.
    pub range: [f64; 2],
    /// Mean number per path of camera rays for emission alone
    /// ([`emission_rays`](crate::integrator::through::emission_rays)).
    #[serde(default)]
    pub emission_rays: f64,
}

impl AllocationEfficiency {
    /// Has any tile another number of paths, or any pixel camera rays for emission?
    pub fn is_used(&self) -> bool {
        self.range != [1.0; 2] || self.emission_rays > 0.0
    }
}

/// The result of the allocation pre-pass.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
pub struct AdaptiveStats {
    /// The estimated efficiency of the allocation.
    #[serde(flatten)]
    pub efficiency: AllocationEfficiency,
    /// Wall seconds.
    pub seconds: f64,
}

/// Whether a technique is used, and why.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Decision {
    /// Is it used?
    pub on: bool,
    /// A few words.
    pub why: String,
}

/// The decisions about all techniques of a render.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Decisions {
    /// The compensated density of the environment.
    pub compensation: Decision,
    /// Learned selection of area lights.
    pub learned_lights: Decision,
    /// Path guiding.
    pub guiding: Decision,
    /// Numbers of paths by tile.
    pub adaptive: Decision,
}

impl Decisions {
    /// The decisions of a render with these settings, whose pre-passes found `stats`.
    pub fn new(settings: &RenderSettings, stats: &TechniqueStats) -> Self {
        let is_auto_here = settings.balance.method().uses_prepasses();
        // Without a pre-pass.
        let without = |choice: Choice, auto: bool, nothing: &str| match choice {
            Choice::Off => no("not asked for"),
            Choice::Auto if !auto => no(format!("--balance {} uses it where it is on", settings.balance.name())),
            _ => no(nothing),
        };
        let by = |on: bool, choice: Choice, what: String| match choice {
            Choice::On => Decision { on, why: format!("asked for; {what}") },
            _ => Decision { on, why: what },
        };
        let few = settings.expected_spp() < MIN_AUTO_PATHS;
        Self {
            compensation: match stats.compensation {
                None => without(settings.compensation, is_auto_here, "no environment with bright and dark parts"),
                Some(found) => match found.remaining_variance {
                    None => Decision { on: found.on, why: "asked for".into() },
                    Some(left) => by(found.on, settings.compensation, format!("leaves {left:.2} of the variance")),
                },
            },
            learned_lights: match stats.learned_lights {
                None => without(settings.learned_lights, is_auto_here, "no emissive triangles to choose among"),
                Some(found) => {
                    let what = format!("leaves {:.2} of the variance", found.remaining_variance);
                    by(found.on, settings.learned_lights, what)
                }
            },
            guiding: match stats.guiding {
                None if settings.guiding == Choice::Auto && few => no(too_few()),
                None => without(settings.guiding, true, "no indirect light"),
                Some(found) => by(
                    found.on,
                    settings.guiding,
                    format!(
                        "leaves {:.2} of the variance at {:.2} of the cost",
                        found.efficiency.variance, found.efficiency.cost
                    ),
                ),
            },
            adaptive: match stats.adaptive {
                None if settings.adaptive != Choice::Off && settings.noise.is_some() => {
                    no("a noise goal gives each tile what it needs")
                }
                None if settings.adaptive != Choice::Off && few => no(too_few()),
                None => without(settings.adaptive, true, "the time limit is too short for a pre-pass"),
                Some(found) => by(
                    found.efficiency.is_used(),
                    settings.adaptive,
                    format!("leaves {:.2} of the error times cost", found.efficiency.remaining),
                ),
            },
        }
    }
}

fn no(why: impl Into<String>) -> Decision {
    Decision { on: false, why: why.into() }
}

fn too_few() -> String {
    format!("fewer than {MIN_AUTO_PATHS} paths per pixel")
}

impl Display for Decisions {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let Self { compensation, learned_lights, guiding, adaptive } = self;
        let named = [
            ("compensation", compensation),
            ("learned lights", learned_lights),
            ("guiding", guiding),
            ("adaptive sampling", adaptive),
        ];
        for (i, (name, Decision { on, why })) in named.into_iter().enumerate() {
            let between = if i > 0 { ", " } else { "" };
            write!(f, "{between}{name} {} ({why})", if *on { "on" } else { "off" })?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::Balance;

    #[test]
    fn each_decision_has_its_reason() {
        let auto = RenderSettings::default();
        let of = |settings: &RenderSettings, stats: &TechniqueStats| Decisions::new(settings, stats);
        let none = TechniqueStats::default();
        let found = of(&auto, &none);
        assert!(
            found.compensation.why.contains("no environment") && found.guiding.why.contains("no indirect"),
            "{found}"
        );
        let found = of(&RenderSettings { spp: Some(4), ..auto.clone() }, &none);
        assert!(found.guiding.why.contains("fewer than 16") && found.adaptive.why.contains("fewer than 16"), "{found}");
        let found = of(&RenderSettings { noise: Some(0.1), ..auto.clone() }, &none);
        assert!(found.adaptive.why.contains("noise goal"), "{found}");
        let found = of(&RenderSettings { balance: Balance::Half, ..RenderSettings::even() }, &none);
        assert!(found.compensation.why.contains("--balance half") && found.guiding.why == "not asked for", "{found}");
        let efficiency = GuidingEfficiency { variance: 0.25, cost: 0.9, share: 0.5 };
        let guided = GuidingStats { on: true, cells: 1, bytes: 1, efficiency, seconds: 0.0 };
        let found = of(&auto, &TechniqueStats { guiding: Some(guided), ..none });
        assert!(found.to_string().contains("guiding on (leaves 0.25 of the variance at 0.90 of the cost)"), "{found}");
        let asked = RenderSettings { guiding: Choice::On, ..auto };
        let found = of(&asked, &TechniqueStats { guiding: Some(guided), ..none });
        assert!(found.guiding.why.starts_with("asked for"), "{found}");
    }
}
