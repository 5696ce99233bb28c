//! What a picture's bits depend on: pictures of equal fingerprints may go on from one another and be merged.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::{Balance, RenderSettings};
use crate::balance::HALF_PILOT;

/// Named values; equal in all means equal bits (on one instruction set).
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Fingerprint(BTreeMap<String, String>);

/// The name of the seed's value.
const SEED: &str = "seed";

impl Fingerprint {
    /// Of a scene's and an environment's content (any text that tells contents apart), a backend's name and settings.
    /// Stop rules do not count, as a render may go on to a higher goal, except where the passes depend on it.
    pub fn new(scene: &str, environment: &str, backend: &str, settings: &RenderSettings) -> Self {
        let mut values: BTreeMap<String, String> = [
            ("version", env!("CARGO_PKG_VERSION").to_owned()),
            ("scene", scene.into()),
            ("environment", environment.into()),
            ("rays", backend.into()),
            ("camera", settings.camera.to_string()),
            ("size", format!("{}x{}", settings.width, settings.height)),
            ("crop", settings.crop.map_or("none".into(), |c| c.map(|x| x.to_string()).join(","))),
            ("integrator", format!("{:?}", settings.integrator).to_lowercase()),
            ("max-depth", settings.max_depth.to_string()),
            ("balance", settings.balance.name().replace('-', "")),
            ("filter", format!("{:?}", settings.filter).to_lowercase()),
            (SEED, settings.seed.to_string()),
            ("sums for AOVs", settings.aovs.to_string()),
        ]
        .map(|(name, value)| (name.to_owned(), value))
        .into();
        if settings.balance == Balance::SecondOrder {
            values.insert("pilot".into(), settings.pilot.unwrap_or(HALF_PILOT).to_string());
            values.insert("spp (second-order's pilot is a share of it)".into(), format!("{:?}", settings.spp));
        }
        Self(values)
    }

    /// The same but for the seed.
    pub fn without_seed(&self) -> Self {
        let mut other = self.clone();
        other.0.remove(SEED);
        other
    }

    /// What differs, for people; empty when nothing does.
    pub fn differences(&self, theirs: &Self) -> String {
        let names: std::collections::BTreeSet<_> = self.0.keys().chain(theirs.0.keys()).collect();
        let differing = names.into_iter().filter(|name| self.0.get(*name) != theirs.0.get(*name));
        let shown = |name: &String| match (theirs.0.get(name), self.0.get(name)) {
            // Hashes tell people nothing.
            (Some(a), Some(b)) if a.len() < 60 && b.len() < 60 => format!("{name} ({a} there, {b} here)"),
            _ => name.clone(),
        };
        differing.map(shown).collect::<Vec<_>>().join(", ")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn differences_are_named_and_stop_rules_are_none() {
        let settings = RenderSettings::default();
        let of = |settings: &RenderSettings| Fingerprint::new("a", "none", "embree", settings);
        let ours = of(&settings);
        let longer = RenderSettings { spp: Some(1000), time: Some(3.0), noise: Some(0.1), ..settings.clone() };
        assert_eq!(ours.differences(&of(&longer)), "");
        let other = of(&RenderSettings { seed: 7, width: 10, ..settings.clone() });
        assert_eq!(ours.differences(&other), "seed (7 there, 0 here), size (10x540 there, 960x540 here)");
        assert_eq!(ours.without_seed().differences(&other.without_seed()), "size (10x540 there, 960x540 here)");
        let paper = |spp| of(&RenderSettings { spp: Some(spp), balance: Balance::SecondOrder, ..settings.clone() });
        assert!(paper(64).differences(&paper(128)).contains("pilot"));
        let piloted = |pilot| of(&RenderSettings { pilot, balance: Balance::SecondOrder, ..settings.clone() });
        assert_eq!(piloted(None).differences(&piloted(Some(0.5))), "");
        assert_eq!(piloted(None).differences(&piloted(Some(0.25))), "pilot (0.25 there, 0.5 here)");
    }
}
