//! What the pre-passes of techniques have found, and what was decided about them and why, for a line of the log and the
//! statistics.

use std::collections::BTreeMap;

use serde::{Deserialize, Deserializer, Serialize, Serializer};
use serde_json::Value;

use crate::integrator::Reuse;
use crate::render::settings::RenderSettings;
use crate::render::settings::techniques::{Choice, PerTechnique};

bismar_scene::named_variants! {
    /// Why a technique is not used in a scene.
    pub enum RuledOut {
        /// There is no environment with bright and dark parts.
        EvenEnvironment = "no environment with bright and dark parts",
        /// There are no emissive triangles, or one.
        FewLights = "no emissive triangles to choose among",
        /// Paths end at first surfaces.
        Direct = "no indirect light",
        /// What a surface sees depends on the time of the path.
        Moves = "nothing is shared where something moves while the shutter is open",
        /// Clamped light is not lent.
        Clamp = "nothing is shared with a clamp of indirect light",
        /// Lent light is of all lights.
        LightGroups = "nothing is shared with groups of lights",
    }
}

/// What the pre-pass of a technique has found; `None` for what it does not have.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct TechniqueStats {
    /// Is it used?
    pub on: bool,
    /// Cells in space of what it has learned.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cells: Option<usize>,
    /// Bytes of what it has learned.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub bytes: Option<usize>,
    /// Estimated fraction of error times cost that remains, over the techniques that were taken before.
    #[serde(rename = "left", skip_serializing_if = "Option::is_none")]
    pub remaining: Option<f64>,
    /// Its standard error, where some of the picture's tiles were rendered both ways.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub standard_error: Option<f64>,
    /// Why there is nothing to decide.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub why: Option<RuledOut>,
    /// Sizes of groups of path re-use.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sizes: Option<Reuse>,
    /// Minimum and maximum paths of a tile, over the mean; both 1 where the allocation is uniform.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub range: Option<[f64; 2]>,
    /// Mean number per path of camera rays for emission alone
    /// ([`emission_rays`](crate::integrator::through::emission_rays)).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub emission_rays: Option<f64>,
    /// Wall seconds.
    pub seconds: f64,
}

/// What the pre-passes of a render have found; `None` for those that did not run.
pub type Found = PerTechnique<Option<TechniqueStats>>;

impl Found {
    /// These, and those of an earlier session where a pre-pass did not run.
    pub fn or(&self, earlier: &Self) -> Self {
        Self::new(|technique| self[technique].or(earlier[technique]))
    }
}

impl Serialize for Found {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let found = self.iter().filter_map(|(technique, stats)| Some((technique.name(), (*stats)?)));
        serializer.collect_map(found)
    }
}

impl<'de> Deserialize<'de> for Found {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let found = BTreeMap::<String, Value>::deserialize(deserializer)?;
        Ok(Self::new(|technique| TechniqueStats::deserialize(found.get(&technique.name())?).ok()))
    }
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
pub type Decisions = PerTechnique<Decision>;

impl Decisions {
    /// The decisions of a render with these settings, whose pre-passes found this.
    pub fn of(settings: &RenderSettings, found: &Found) -> Self {
        Self::new(|technique| {
            let Some(stats) = found[technique] else {
                let why = settings.rules_out(technique).unwrap_or("there is nothing to sample better".into());
                return Decision { on: false, why };
            };
            let asked = settings.techniques[technique] == Choice::On;
            let mut why: Vec<String> = stats.why.map(|why| why.name().into()).into_iter().collect();
            why.extend(asked.then(|| "asked for".into()));
            why.extend(stats.remaining.map(|left| {
                let sizes = stats.sizes.map_or(String::new(), |sizes| format!("{sizes} "));
                let error = stats.standard_error.map_or(String::new(), |error| format!(" ± {error:.2}"));
                format!("{sizes}leaves {left:.2}{error} of error × time")
            }));
            Decision { on: stats.on, why: why.join("; ") }
        })
    }

    /// A line for each technique.
    pub fn lines(&self) -> impl Iterator<Item = String> {
        self.iter().map(|(technique, Decision { on, why })| {
            format!("{}: {why}, {}", technique.title(), if *on { "used" } else { "not used" })
        })
    }
}

impl Serialize for Decisions {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_map(self.iter().map(|(technique, decision)| (technique.name(), decision)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::{Balance, Technique};

    #[test]
    fn each_decision_has_its_reason() {
        use Technique::{Adaptive, Compensation, Guiding};
        let auto = RenderSettings::default();
        let why = |settings: &RenderSettings, found: &Found, of: Technique, text: &str| {
            let decisions = Decisions::of(settings, found);
            assert!(decisions[of].why.contains(text), "{text}: {decisions:?}");
            decisions.lines().collect::<Vec<_>>().join("\n")
        };
        let none = Found::default();
        why(&auto, &none, Compensation, "nothing to sample better");
        let few = RenderSettings { spp: Some(4), ..auto.clone() };
        why(&few, &none, Guiding, "fewer than 16");
        why(&few, &none, Adaptive, "fewer than 16");
        let mut dark = none;
        dark[Guiding] = Some(TechniqueStats { why: Some(RuledOut::Direct), ..TechniqueStats::default() });
        let text = why(&few.with(Guiding, Choice::On), &dark, Guiding, "no indirect");
        assert!(text.contains("guiding: no indirect light; asked for, not used"), "{text}");
        why(&RenderSettings { noise: Some(0.1), ..auto.clone() }, &none, Adaptive, "noise goal");
        let half = RenderSettings { balance: Balance::Half, ..RenderSettings::even() };
        why(&half, &none, Compensation, "--balance half");
        why(&half, &none, Guiding, "not asked for");
        let mut guided = none;
        guided[Guiding] = Some(TechniqueStats {
            on: true,
            remaining: Some(0.25),
            standard_error: Some(0.031),
            ..TechniqueStats::default()
        });
        let text = why(&auto, &guided, Guiding, "leaves 0.25 ± 0.03 of error × time");
        assert!(text.contains("guiding: leaves 0.25 ± 0.03 of error × time, used"), "{text}");
        why(&auto.with(Guiding, Choice::On), &guided, Guiding, "asked for; ");
    }
}
