//! Whether a technique is used: never, always, or where it pays.

use serde::{Deserialize, Serialize};

/// Whether a technique is used.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Choice {
    /// Never.
    #[default]
    Off,
    /// Always.
    On,
    /// Where a pre-pass estimates that it pays for its cost.
    Auto,
}

bismar_scene::named_variants! { Choice { Off = "off", On = "on", Auto = "auto" } }

impl Choice {
    /// The default of settings that older files lack: those techniques were always chosen by a pre-pass.
    pub(super) fn auto() -> Self {
        Self::Auto
    }

    pub(super) fn is_auto(&self) -> bool {
        *self == Self::Auto
    }
}

impl From<bool> for Choice {
    fn from(on: bool) -> Self {
        if on { Self::On } else { Self::Off }
    }
}

/// A choice in files: `true` and `false` are on and off, which is what files of earlier builds have.
pub(super) mod as_switch {
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    use super::Choice;

    #[derive(Deserialize)]
    #[serde(untagged)]
    enum Stored {
        Switch(bool),
        Named(Choice),
    }

    pub fn serialize<S: Serializer>(choice: &Choice, serializer: S) -> Result<S::Ok, S::Error> {
        match choice {
            Choice::Off => false.serialize(serializer),
            Choice::On => true.serialize(serializer),
            Choice::Auto => choice.serialize(serializer),
        }
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Choice, D::Error> {
        Ok(match Stored::deserialize(deserializer)? {
            Stored::Switch(on) => on.into(),
            Stored::Named(choice) => choice,
        })
    }
}

#[cfg(test)]
mod tests {
    use serde_json::{from_str, to_string};

    use super::*;
    use crate::render::RenderSettings;

    #[test]
    fn settings_of_earlier_files_keep_their_meaning() {
        let plain = RenderSettings { adaptive: Choice::Off, guiding: Choice::Off, ..Default::default() };
        let text = to_string(&plain).unwrap();
        for absent in ["adaptive", "guiding", "learned_lights", "compensation"] {
            assert!(!text.contains(absent), "{text}");
        }
        let read: RenderSettings = from_str(&text).unwrap();
        assert_eq!((read.adaptive, read.guiding), (Choice::Off, Choice::Off));
        assert_eq!([read.learned_lights, read.compensation], [Choice::Auto; 2]);
        let on = to_string(&RenderSettings { adaptive: Choice::On, ..plain.clone() }).unwrap();
        assert!(on.contains(r#""adaptive":true"#), "{on}");
        for choice in Choice::ALL {
            let settings = RenderSettings {
                adaptive: choice,
                guiding: choice,
                learned_lights: choice,
                compensation: choice,
                ..plain.clone()
            };
            let read: RenderSettings = from_str(&to_string(&settings).unwrap()).unwrap();
            let RenderSettings { adaptive, guiding, learned_lights, compensation, .. } = read;
            assert_eq!([adaptive, guiding, learned_lights, compensation], [choice; 4]);
        }
    }
}
