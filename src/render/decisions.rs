//! What was decided about techniques that need not pay, and why: a line of the log, and a field of the statistics.

use std::fmt::{self, Display};

use serde::Serialize;

use super::settings::MIN_AUTO_PATHS;
use super::stats::LearnedLightsStats;
use super::{Choice, RenderSettings, RenderStats};

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
    /// Learned sampling of the environment.
    pub learned_environment: Decision,
    /// Path guiding.
    pub guiding: Decision,
    /// Numbers of paths by tile.
    pub adaptive: Decision,
}

impl Decisions {
    /// The decisions of a render with these settings, whose pre-passes found `stats`.
    pub fn new(settings: &RenderSettings, stats: &RenderStats) -> Self {
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
        let learned = |found: Option<LearnedLightsStats>, nothing: &str| match found {
            None => without(settings.learned_lights, is_auto_here, nothing),
            Some(found) => {
                let what = format!("leaves {:.2} of the variance", found.remaining_variance);
                by(found.on, settings.learned_lights, what)
            }
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
            learned_lights: learned(stats.learned_lights, "no emissive triangles to choose among"),
            learned_environment: learned(stats.learned_environment, "no environment"),
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
        let Self { compensation, learned_lights, learned_environment, guiding, adaptive } = self;
        let named = [
            ("compensation", compensation),
            ("learned lights", learned_lights),
            ("learned environment", learned_environment),
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
    use crate::render::stats::{GuidingEfficiency, GuidingStats};

    #[test]
    fn each_decision_has_its_reason() {
        let auto = RenderSettings { guiding: Choice::Auto, adaptive: Choice::Auto, ..Default::default() };
        let of = |settings: &RenderSettings, stats: &RenderStats| Decisions::new(settings, stats);
        let none = RenderStats::default();
        let found = of(&auto, &none);
        assert!(
            found.compensation.why.contains("no environment") && found.guiding.why.contains("no indirect"),
            "{found}"
        );
        let found = of(&RenderSettings { spp: Some(4), ..auto.clone() }, &none);
        assert!(found.guiding.why.contains("fewer than 16") && found.adaptive.why.contains("fewer than 16"), "{found}");
        let found = of(&RenderSettings { noise: Some(0.1), ..auto.clone() }, &none);
        assert!(found.adaptive.why.contains("noise goal"), "{found}");
        let found = of(&RenderSettings { balance: Balance::Half, ..Default::default() }, &none);
        assert!(found.compensation.why.contains("--balance half") && found.guiding.why == "not asked for", "{found}");
        let efficiency = GuidingEfficiency { variance: 0.25, cost: 0.9, share: 0.5 };
        let guided = GuidingStats { on: true, cells: 1, bytes: 1, efficiency, seconds: 0.0 };
        let found = of(&auto, &RenderStats { guiding: Some(guided), ..none });
        assert!(found.to_string().contains("guiding on (leaves 0.25 of the variance at 0.90 of the cost)"), "{found}");
        let asked = RenderSettings { guiding: Choice::On, ..auto };
        let found = of(&asked, &RenderStats { guiding: Some(guided), ..none });
        assert!(found.guiding.why.starts_with("asked for"), "{found}");
    }
}
