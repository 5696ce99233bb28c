//! The identity of a render: the inputs and settings that its bits depend on, and the key of the command that asks for it.

use std::collections::BTreeSet;

use serde::{Deserialize, Serialize};

use crate::color::ColorSpace;
use crate::rays::Backend;
use crate::render::settings::{RenderSettings, Values, variant_name};

/// What a picture was made of. Stored in its header.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Identity {
    /// Version of bismar.
    pub version: String,
    /// Text that tells the scene's content from others: the hash of its files, and what was chosen when it was imported.
    pub scene: String,
    /// Text that tells the environment's content from others.
    pub environment: String,
    /// The ray library.
    pub rays: Backend,
    /// The requested settings, with their stop rules.
    pub settings: RenderSettings,
}

/// The outputs that a command requests and its view, which become settings once the scene is loaded.
#[derive(Debug, Clone, Default)]
pub struct RequestedOutputs {
    /// Camera by name or index.
    pub camera: Option<String>,
    /// Width and height in pixels.
    pub size: Option<[u32; 2]>,
    /// Names of AOVs, separated by commas.
    pub aovs: String,
    /// Are colours stored as 16-bit floats?
    pub half: bool,
    /// Primaries of colours.
    pub colorspace: ColorSpace,
    /// Is there a denoised layer?
    pub denoised: bool,
}

impl Identity {
    /// The identity of a render by this version, with the texts of a scene and an environment.
    pub fn new(scene: &str, environment: &str, rays: Backend, settings: &RenderSettings) -> Self {
        Self {
            version: env!("CARGO_PKG_VERSION").into(),
            scene: scene.into(),
            environment: environment.into(),
            rays,
            settings: settings.clone(),
        }
    }

    /// Named values. Renders whose values are equal have equal bits on one instruction set.
    pub fn bits(&self) -> Values {
        let Self { version, scene, environment, rays, settings } = self;
        let mut values = settings.bits();
        let own = [("version", version), ("scene", scene), ("environment", environment), ("rays", &variant_name(rays))];
        values.extend(own.map(|(name, value)| (name.into(), value.clone())));
        values
    }

    /// A key that differs between commands that make different files: a hash of contents and flags, known before a scene
    /// is loaded. It has the requested view instead of the camera, width and height of the settings. Parts of a picture
    /// have the same key.
    pub fn request(&self, requested: &RequestedOutputs) -> String {
        let RequestedOutputs { camera, size, aovs, half, colorspace, denoised } = requested;
        let mut values = self.bits();
        let mut insert = |name: &str, value: String| values.insert(name.into(), value);
        insert("camera", camera.clone().unwrap_or("the first".into()));
        insert("size", size.map_or("the camera's".into(), |[w, h]| format!("{w}x{h}")));
        insert("aovs", aovs.clone());
        insert("half", half.to_string());
        insert("denoised", denoised.to_string());
        insert("colorspace", colorspace.name().into());
        blake3::hash(serde_json::json!(values).to_string().as_bytes()).to_hex().to_string()
    }

    /// The names of the values that differ, with both values, for people; empty if none does.
    pub fn differences(&self, theirs: &Self) -> String {
        differences(&self.bits(), &theirs.bits())
    }

    /// The same for pictures that may differ in their seeds.
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
    let shown = |name: &String| {
        // Some are there only with some methods of balance.
        let [a, b] = [theirs, ours].map(|values| values.get(name).map_or("none", String::as_str));
        // Hashes are not for people.
        if a.len() < 60 && b.len() < 60 { format!("{name} ({a} there, {b} here)") } else { name.clone() }
    };
    differing.map(shown).collect::<Vec<_>>().join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::settings::GUIDING_MEMORY;
    use crate::render::{Balance, Choice, Technique};

    #[test]
    fn differences_are_named_and_stop_rules_are_none() {
        let settings = RenderSettings::even();
        let of = |settings: &RenderSettings| Identity::new("a", "none", Backend::Embree, settings);
        let ours = of(&settings);
        let longer = RenderSettings { spp: Some(1000), time: Some(3.0), noise: Some(0.1), ..settings.clone() };
        assert_eq!(ours.differences(&of(&longer)), "");
        let other = of(&RenderSettings { seed: 7, width: 10, ..settings.clone() });
        assert_eq!(ours.differences(&other), "seed (7 there, 0 here), size (10x540 there, 960x540 here)");
        assert_eq!(ours.differences_but_for_seeds(&other), "size (10x540 there, 960x540 here)");
        let paper = |spp| of(&RenderSettings { spp: Some(spp), balance: Balance::SecondOrder, ..settings.clone() });
        assert!(paper(64).differences(&paper(128)).contains("spp (second-order's pilot is a share of it)"));
        let piloted = |pilot| of(&RenderSettings { pilot, balance: Balance::SecondOrder, ..settings.clone() });
        let guided = |guiding, guiding_memory| {
            of(&RenderSettings { guiding_memory, ..settings.clone().with(Technique::Guiding, guiding) })
        };
        assert_eq!(guided(Choice::Off, Some(1 << 20)).differences(&ours), "");
        assert!(guided(Choice::On, None).differences(&ours).contains("guiding"));
        assert_eq!(guided(Choice::On, None).differences(&guided(Choice::On, Some(GUIDING_MEMORY))), "");
        assert!(guided(Choice::On, None).differences(&guided(Choice::On, Some(1))).contains("guiding-memory"));
        let adaptive = of(&settings.clone().with(Technique::Adaptive, Choice::On));
        assert!(adaptive.differences(&ours).contains("adaptive"));
        assert_eq!(piloted(None).differences(&piloted(Some(0.5))), "");
        assert_eq!(piloted(None).differences(&piloted(Some(0.25))), "pilot (0.25 there, 0.5 here)");
    }

    #[test]
    fn a_request_is_what_was_asked_and_not_what_it_came_to() {
        let settings = RenderSettings { part: "1/2".parse().ok(), ..Default::default() };
        let whole = RenderSettings { camera: 3, width: 7, part: None, time: Some(1.0), ..settings.clone() };
        let of = |settings: &RenderSettings| Identity::new("a", "none", Backend::Embree, settings);
        let requested = RequestedOutputs { camera: Some("top".into()), aovs: "depth".into(), ..Default::default() };
        assert_eq!(of(&settings).request(&requested), of(&whole).request(&requested));
        for other in [
            RequestedOutputs { camera: None, ..requested.clone() },
            RequestedOutputs { size: Some([9, 9]), ..requested.clone() },
            RequestedOutputs { aovs: String::new(), ..requested.clone() },
            RequestedOutputs { half: true, ..requested.clone() },
            RequestedOutputs { colorspace: ColorSpace::Acescg, ..requested.clone() },
        ] {
            assert_ne!(of(&settings).request(&requested), of(&settings).request(&other));
        }
        assert_ne!(
            of(&settings).request(&requested),
            of(&RenderSettings { seed: 1, ..settings.clone() }).request(&requested)
        );
    }
}
