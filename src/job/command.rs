//! The command that a picture was rendered by, in the picture's header: `bismar check` renders it again.

use std::collections::BTreeMap;
use std::path::Path;

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::request::RenderRequest;
use crate::Result;
use crate::film::exr_file::Header;
use crate::render::Technique;
use crate::render::record::checkpoint::{json, text};

/// The header attribute.
pub const ATTRIBUTE: &str = "bismar.command";
/// What decides what is in a picture. Nothing else is written into a header, or read from one: it may be of somebody else.
#[rustfmt::skip]
const OF_THE_PICTURE: [&str; 51] = [
    "animation", "aov", "aperture", "back-faces", "balance", "camera", "clamp-direct", "clamp-indirect", "colorspace",
    "crop", "denoise", "energy-compensation", "env-rotate", "env-strength", "filter", "focus", "fps", "frame",
    "glass-shadows", "ground", "guiding-memory", "half", "integrator", "lens-blades", "light-groups", "light-radius",
    "light-unit", "max-depth", "min-spp", "motion-steps", "no-clip", "no-env", "noise", "orbit", "pilot", "placed",
    "pose", "preset", "rays", "scene-name", "seed", "seed-per-frame", "shutter", "size", "sky", "spp", "sun-angle",
    "sunsky", "time", "transparent", "variant",
];

fn is_of_the_picture(flag: &str) -> bool {
    OF_THE_PICTURE.contains(&flag) || Technique::of_flag(flag).is_some()
}

/// How a picture was made: a scene, an environment map, and the fields that decide what is in the picture.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PictureCommand {
    /// The scene's path as it was given, if that was relative; else its name without the folders, which are private.
    pub scene: String,
    /// The environment map's path, likewise.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub env: Option<String>,
    /// Names and values; `true` for switches. Names are those of flags of `bismar render`, without dashes.
    #[serde(default)]
    fields: BTreeMap<String, Value>,
}

impl PictureCommand {
    /// The command of these arguments; `None` if their flags are not known, or paths are not UTF-8.
    fn of(request: &RenderRequest) -> Option<Self> {
        let given = request.given.as_ref()?.iter().filter(|(name, _)| is_of_the_picture(name));
        let value = |text: &String| match text.parse::<serde_json::Number>() {
            Ok(number) if number.to_string() == *text => Value::Number(number),
            _ => Value::String(text.clone()),
        };
        let fields = given.map(|(name, text)| (name.clone(), text.as_ref().map_or(Value::Bool(true), value))).collect();
        let shared = |path: &Path| shared(path, request.relative_to.as_deref());
        let env = request.env.as_deref().map(shared);
        if env == Some(None) {
            return None;
        }
        Some(Self { scene: shared(&request.scene)?, env: env.flatten(), fields })
    }

    /// Adds the attribute to a header.
    ///
    /// # Errors
    /// Those of [`json`].
    pub fn write(request: &RenderRequest, header: &mut Header) -> Result<()> {
        if let Some(command) = Self::of(request) {
            header.push((ATTRIBUTE.into(), json(&command)?));
        }
        Ok(())
    }

    /// The command of a picture; `None` for pictures without.
    pub fn read(header: &Header) -> Option<Self> {
        text(header, ATTRIBUTE).and_then(|text| serde_json::from_str(text).ok())
    }

    /// The fields as flags of a job; a name that `is_known` denies is an error. What does not decide what is in the picture is
    /// left out.
    ///
    /// # Errors
    /// The name.
    pub fn flags(&self, is_known: impl Fn(&str) -> bool) -> std::result::Result<Vec<(String, Option<String>)>, String> {
        let text = |value: &Value| match value {
            Value::Bool(_) => None,
            Value::String(text) => Some(text.clone()),
            other => Some(other.to_string()),
        };
        if let Some(unknown) = self.fields.keys().find(|name| !is_known(name)) {
            return Err(unknown.clone());
        }
        let own = self.fields.iter().filter(|(name, _)| is_of_the_picture(name));
        Ok(own.map(|(name, value)| (name.clone(), text(value))).collect())
    }
}

/// A path for a file that others will see, without the folder `root` before it.
fn shared(path: &Path, root: Option<&Path>) -> Option<String> {
    let path = root.and_then(|root| path.strip_prefix(root).ok()).unwrap_or(path);
    let shown = if path.is_absolute() { Path::new(path.file_name()?) } else { path };
    shown.to_str().map(str::to_owned)
}
