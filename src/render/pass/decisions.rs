//! What the pre-passes of techniques have found, and what was decided about them and why, for a line of the log and the
//! statistics.

use std::collections::BTreeMap;
use std::fmt::{self, Display};

use serde::{Deserialize, Deserializer, Serialize, Serializer};
use serde_json::Value;

use crate::integrator::Reuse;
use crate::render::settings::RenderSettings;
use crate::render::settings::techniques::{Choice, PerTechnique, Technique};

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
    /// Estimated fraction that remains, of [`Row::fraction_of`](crate::render::settings::techniques::Row::fraction_of); of guiding, of variance times rays.
    #[serde(rename = "left", skip_serializing_if = "Option::is_none")]
    pub remaining: Option<f64>,
    /// Variance of guided paths over that of unguided ones.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub variance: Option<f32>,
    /// Rays of a guided path over those of an unguided one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cost: Option<f32>,
    /// Mean fraction of directions that are sampled from the field.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub share: Option<f32>,
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
            let row = technique.row();
            let Some(stats) = found[technique] else {
                return Decision { on: false, why: settings.rules_out(technique).unwrap_or(row.nothing.into()) };
            };
            let what = match stats {
                TechniqueStats { variance: Some(variance), cost: Some(cost), .. } => {
                    format!("leaves {variance:.2} of the variance at {cost:.2} of the cost")
                }
                TechniqueStats { remaining: Some(left), sizes: Some(sizes), .. } => {
                    format!("{sizes} leaves {left:.2} of the {}", row.fraction_of)
                }
                TechniqueStats { remaining: Some(left), .. } => format!("leaves {left:.2} of the {}", row.fraction_of),
                _ => return Decision { on: stats.on, why: "asked for".into() },
            };
            let asked = if settings.techniques[technique] == Choice::On { "asked for; " } else { "" };
            Decision { on: stats.on, why: format!("{asked}{what}") }
        })
    }
}

impl Serialize for Decisions {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_map(self.iter().map(|(technique, decision)| (technique.name(), decision)))
    }
}

impl Display for Decisions {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let text = |(technique, Decision { on, why }): (Technique, &Decision)| {
            format!("{} {} ({why})", technique.row().flag.replace('-', " "), if *on { "on" } else { "off" })
        };
        f.write_str(&self.iter().map(text).collect::<Vec<_>>().join(", "))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::Balance;

    #[test]
    fn each_decision_has_its_reason() {
        use Technique::{Adaptive, Compensation, Guiding};
        let auto = RenderSettings::default();
        let why = |settings: &RenderSettings, found: &Found, of: Technique, text: &str| {
            let decisions = Decisions::of(settings, found);
            assert!(decisions[of].why.contains(text), "{text}: {decisions}");
            decisions
        };
        let none = Found::default();
        why(&auto, &none, Compensation, "no environment");
        why(&auto, &none, Guiding, "no indirect");
        let few = RenderSettings { spp: Some(4), ..auto.clone() };
        why(&few, &none, Guiding, "fewer than 16");
        why(&few, &none, Adaptive, "fewer than 16");
        why(&few.clone().with(Guiding, Choice::On), &none, Guiding, "no indirect");
        why(&RenderSettings { noise: Some(0.1), ..auto.clone() }, &none, Adaptive, "noise goal");
        let half = RenderSettings { balance: Balance::Half, ..RenderSettings::even() };
        why(&half, &none, Compensation, "--balance half");
        why(&half, &none, Guiding, "not asked for");
        let mut guided = none;
        guided[Guiding] =
            Some(TechniqueStats { on: true, variance: Some(0.25), cost: Some(0.9), ..TechniqueStats::default() });
        let text = why(&auto, &guided, Guiding, "leaves 0.25 of the variance at 0.90 of the cost").to_string();
        assert!(text.contains("guiding on (leaves 0.25 of the variance at 0.90 of the cost)"), "{text}");
        why(&auto.with(Guiding, Choice::On), &guided, Guiding, "asked for; ");
    }
}
