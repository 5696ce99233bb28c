//! What a picture was made of: what its bits depend on, and what tells commands apart.

use std::collections::{BTreeMap, BTreeSet};

use serde::{Deserialize, Serialize};

use super::prepass::guiding::MEMORY;
use super::{Guiding, RenderSettings};
use crate::balance::DEFAULT_PILOT_FRACTION;
use crate::rays::Backend;

/// What a picture was made of. Kept in its header.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Identity {
    /// Of bismar.
    pub version: String,
    /// Any text that tells the scene's content from others.
    pub scene: String,
    /// As `scene`, of the environment.
    pub environment: String,
    /// What traces rays.
    pub rays: Backend,
    /// What was asked for, with its stop rules.
    pub settings: RenderSettings,
}

/// What a command says of its view and outputs, which only a loaded scene turns into settings.
#[derive(Debug, Clone, Default)]
pub struct Asked {
    /// Camera by name or index.
    pub camera: Option<String>,
    /// Width and height.
    pub size: Option<[u32; 2]>,
    /// Names of AOVs, with commas between.
    pub aovs: String,
    /// Colours in 16 bits?
    pub half: bool,
    /// With a layer without noise?
    pub denoised: bool,
}

/// Named values, for comparison.
type Values = BTreeMap<&'static str, String>;

impl Identity {
    /// Of a scene's and an environment's content, to be made by this version.
    pub fn new(scene: &str, environment: &str, rays: Backend, settings: &RenderSettings) -> Self {
        Self {
            version: env!("CARGO_PKG_VERSION").into(),
            scene: scene.into(),
            environment: environment.into(),
            rays,
            settings: settings.clone(),
        }
    }

    /// Named values; equal in all means equal bits (on one instruction set). Stop rules do not count, as a render may go
    /// on to a higher goal, except where the passes depend on it; nor do parts.
    pub fn bits(&self) -> Values {
        let s = &self.settings;
        let mut values = Values::from([
            ("version", self.version.clone()),
            ("scene", self.scene.clone()),
            ("environment", self.environment.clone()),
            ("rays", name(&self.rays)),
            ("camera", s.camera.to_string()),
            ("size", format!("{}x{}", s.width, s.height)),
            ("crop", s.crop.map_or("none".into(), |c| c.map(|x| x.to_string()).join(","))),
            ("integrator", name(&s.integrator)),
            ("max-depth", s.max_depth.to_string()),
            ("balance", name(&s.balance)),
            ("filter", name(&s.filter)),
            ("seed", s.seed.to_string()),
            ("sums for AOVs", s.aovs.to_string()),
        ]);
        for (name, most) in [("clamp-direct", s.clamp_direct), ("clamp-indirect", s.clamp_indirect)] {
            values.extend(most.map(|most| (name, most.to_string())));
        }
        if s.extras {
            values.insert("more sums for AOVs", "true".into());
        }
        values.extend(s.lens.map(|lens| ("lens", lens.to_string())));
        if s.guiding != Guiding::Off {
            values.insert("guiding", name(&s.guiding));
            values.insert("guiding-memory", s.guiding_memory.unwrap_or(MEMORY).to_string());
        }
        if s.adaptive {
            values.insert("adaptive", "true".into());
        }
        if s.transparent {
            values.insert("transparent", "true".into());
        }
        if s.balance.method().needs_goal() {
            values.insert("pilot", s.pilot.unwrap_or(DEFAULT_PILOT_FRACTION).to_string());
            let spp = s.spp.map_or("none".into(), |n| n.to_string());
            values.insert("spp (second-order's pilot is a share of it)", spp);
        }
        values
    }

    /// Tells apart commands that make different files, before a scene is loaded: a hash of contents and flags. Camera,
    /// width and height of the settings do not count, only what was asked. Parts of a picture are alike.
    pub fn request(&self, asked: &Asked) -> String {
        let mut values = self.bits();
        values.insert("camera", asked.camera.clone().unwrap_or("the first".into()));
        values.insert("size", asked.size.map_or("the camera's".into(), |[w, h]| format!("{w}x{h}")));
        values.insert("aovs", asked.aovs.clone());
        // What is not said leaves requests as they were before it could be.
        if asked.half {
            values.insert("half", "true".into());
        }
        if asked.denoised {
            values.insert("denoised", "true".into());
        }
        blake3::hash(serde_json::json!(values).to_string().as_bytes()).to_hex().to_string()
    }

    /// In what the other's bits differ, for people; empty when in nothing.
    pub fn differences(&self, theirs: &Self) -> String {
        differences(&self.bits(), &theirs.bits())
    }

    /// As [`differences`](Self::differences), of pictures that may differ in their seeds.
    pub fn differences_but_for_seeds(&self, theirs: &Self) -> String {
        let [mut ours, mut theirs] = [self.bits(), theirs.bits()];
        ours.remove("seed");
        theirs.remove("seed");
        differences(&ours, &theirs)
    }
}

fn differences(ours: &Values, theirs: &Values) -> String {
    let names: BTreeSet<_> = ours.keys().chain(theirs.keys()).collect();
    let differing = names.into_iter().filter(|name| ours.get(*name) != theirs.get(*name));
    let shown = |name: &&str| match (theirs.get(name), ours.get(name)) {
        // Hashes tell people nothing.
        (Some(a), Some(b)) if a.len() < 60 && b.len() < 60 => format!("{name} ({a} there, {b} here)"),
        _ => (*name).to_owned(),
    };
    differing.map(shown).collect::<Vec<_>>().join(", ")
}

/// A variant's own name: that of files and of the command line.
pub(super) fn name(variant: &impl Serialize) -> String {
    let name = serde_json::to_value(variant).ok();
    name.and_then(|n| n.as_str().map(str::to_owned)).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::Balance;

    #[test]
    fn differences_are_named_and_stop_rules_are_none() {
        let settings = RenderSettings::default();
        let of = |settings: &RenderSettings| Identity::new("a", "none", Backend::Embree, settings);
        let ours = of(&settings);
        let longer = RenderSettings { spp: Some(1000), time: Some(3.0), noise: Some(0.1), ..settings.clone() };
        assert_eq!(ours.differences(&of(&longer)), "");
        let other = of(&RenderSettings { seed: 7, width: 10, ..settings.clone() });
        assert_eq!(ours.differences(&other), "seed (7 there, 0 here), size (10x540 there, 960x540 here)");
        assert_eq!(ours.differences_but_for_seeds(&other), "size (10x540 there, 960x540 here)");
        let paper = |spp| of(&RenderSettings { spp: Some(spp), balance: Balance::SecondOrder, ..settings.clone() });
        assert!(paper(64).differences(&paper(128)).contains("pilot"));
        let piloted = |pilot| of(&RenderSettings { pilot, balance: Balance::SecondOrder, ..settings.clone() });
        let guided = |guiding, guiding_memory| of(&RenderSettings { guiding, guiding_memory, ..settings.clone() });
        assert_eq!(guided(Guiding::Off, Some(1 << 20)).differences(&ours), "");
        assert!(guided(Guiding::On, None).differences(&ours).contains("guiding"));
        assert_eq!(guided(Guiding::On, None).differences(&guided(Guiding::On, Some(MEMORY))), "");
        assert!(guided(Guiding::On, None).differences(&guided(Guiding::On, Some(1))).contains("guiding-memory"));
        assert!(of(&RenderSettings { adaptive: true, ..settings.clone() }).differences(&ours).contains("adaptive"));
        assert_eq!(piloted(None).differences(&piloted(Some(0.5))), "");
        assert_eq!(piloted(None).differences(&piloted(Some(0.25))), "pilot (0.25 there, 0.5 here)");
    }

    #[test]
    fn a_request_is_what_was_asked_and_not_what_it_came_to() {
        let settings = RenderSettings { part: "1/2".parse().ok(), ..Default::default() };
        let whole = RenderSettings { camera: 3, width: 7, part: None, time: Some(1.0), ..settings.clone() };
        let of = |settings: &RenderSettings| Identity::new("a", "none", Backend::Embree, settings);
        let asked = Asked { camera: Some("top".into()), aovs: "depth".into(), ..Default::default() };
        assert_eq!(of(&settings).request(&asked), of(&whole).request(&asked));
        for other in [
            Asked { camera: None, ..asked.clone() },
            Asked { size: Some([9, 9]), ..asked.clone() },
            Asked { aovs: String::new(), ..asked.clone() },
            Asked { half: true, ..asked.clone() },
        ] {
            assert_ne!(of(&settings).request(&asked), of(&settings).request(&other));
        }
        assert_ne!(of(&settings).request(&asked), of(&RenderSettings { seed: 1, ..settings.clone() }).request(&asked));
    }
}
