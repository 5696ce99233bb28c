//! Requests as JSON, as flags, and in the header of their picture, from which `bismar check` renders it again.

use std::path::Path;
use std::sync::OnceLock;

use serde::ser::Error as _;
use serde::{Serialize, Serializer};
use serde_json::{Map, Value};

use super::{RenderRequest, of_flags};
use crate::film::exr_file::Header;
use crate::render::record::checkpoint::{json, text};
use crate::scene::import::STANDARD_INPUT;
use crate::{Error, Result};

impl RenderRequest {
    /// As JSON: names and values of flags.
    ///
    /// # Errors
    /// [`Error::Bug`].
    pub fn json(&self) -> Result<Map<String, Value>> {
        match serde_json::to_value(self) {
            Ok(Value::Object(entries)) => Ok(entries),
            other => Err(Error::Bug(format!("a request as JSON: {other:?}"))),
        }
    }

    /// The same without what the command without a flag has.
    ///
    /// # Errors
    /// [`Error::Bug`].
    pub fn entries(&self) -> Result<Map<String, Value>> {
        static PLAIN: OnceLock<Map<String, Value>> = OnceLock::new();
        let plain = PLAIN.get_or_init(|| Self::default().json().unwrap_or_default());
        Ok(self.json()?.into_iter().filter(|(name, value)| plain.get(name) != Some(value)).collect())
    }

    /// Serializes [`Self::entries`].
    pub(crate) fn serialize_entries<S: Serializer>(&self, to: S) -> std::result::Result<S::Ok, S::Error> {
        self.entries().map_err(S::Error::custom)?.serialize(to)
    }

    /// The flags of `bismar render` that ask for the same, but for scene and output: names without dashes, and values; `None` for
    /// switches.
    ///
    /// # Errors
    /// [`Error::Usage`] for a path that is not UTF-8.
    pub fn flags(&self) -> Result<Vec<(String, Option<String>)>> {
        let preset = self.preset.map(|preset| format!("--preset={}", preset.name()));
        let plain = of_flags(preset).map_err(|e| Error::Bug(e.to_string()))?.json()?;
        let mut flags = Vec::new();
        for (name, value) in self.json()? {
            let usual = &plain[&name];
            if value == *usual && name != "preset" || ["scene", "output"].contains(&name.as_str()) {
                continue;
            }
            let text = |value: &Value| match value {
                Value::String(text) => Ok(text.clone()),
                Value::Number(number) if number.is_f64() => Ok(number.as_f64().unwrap_or_default().to_string()),
                Value::Object(_) => Err(Error::Usage(format!("{name}: a name is not UTF-8: rename the file"))),
                other => Ok(other.to_string()),
            };
            let value = match &value {
                Value::Null => continue,
                Value::Bool(true) => None,
                Value::Array(items) => Some(items.iter().map(text).collect::<Result<Vec<_>>>()?.join(",")),
                other => Some(text(other)?),
            };
            flags.push((name, value));
        }
        Ok(flags)
    }

    /// The same as arguments: `--name=value`, `--name`.
    ///
    /// # Errors
    /// Those of [`Self::flags`].
    pub fn arguments(&self) -> Result<Vec<String>> {
        Ok(self.flags()?.iter().map(argument).collect())
    }
}

/// A flag as an argument: `--name=value`, `--name`.
pub fn argument((name, value): &(String, Option<String>)) -> String {
    value.as_ref().map_or(format!("--{name}"), |value| format!("--{name}={value}"))
}

/// The header attribute: options that decide what is in the picture, by names of flags, as JSON.
const ATTRIBUTE: &str = "bismar.command";

impl RenderRequest {
    /// What decides what is in the picture. Nothing else is written into a header, or read from one: it may be of somebody else.
    fn of_picture(&self) -> Self {
        let Self { output, preview, view, exposure, stats, tev, checkpoint, keep, on_checkpoint, resume, .. } =
            Self::default();
        let Self { strict, threads, memory_limit, relative_to, part, .. } = Self::default();
        Self {
            output,
            preview,
            view,
            exposure,
            stats,
            tev,
            checkpoint,
            keep,
            on_checkpoint,
            resume,
            strict,
            threads,
            memory_limit,
            relative_to,
            part,
            ..self.clone()
        }
    }

    /// Adds the attribute to a header. Scene and environment are as they were given, if that was relative; else their names without
    /// the folders, which are private. A scene from standard input, and names that are not UTF-8, leave it out.
    ///
    /// # Errors
    /// Those of [`json()`].
    pub fn write(&self, header: &mut Header) -> Result<()> {
        let shared = |path: &Path| shared(path, self.relative_to.as_deref());
        let env = self.env.as_deref().map(shared);
        let Some(scene) = shared(&self.scene).filter(|scene| scene != STANDARD_INPUT && env != Some(None)) else {
            return Ok(());
        };
        let request = Self { scene: scene.into(), env: env.flatten().map(Into::into), ..self.of_picture() };
        header.push((ATTRIBUTE.into(), json(&request.entries()?)?));
        Ok(())
    }

    /// The request in a picture's header, with the paths that it names; `None` for pictures without.
    ///
    /// # Errors
    /// What is wrong with it: an option that this version does not have.
    pub fn read(header: &Header) -> std::result::Result<Option<Self>, String> {
        let Some(entries) = text(header, ATTRIBUTE).and_then(|text| serde_json::from_str::<Map<_, _>>(text).ok())
        else {
            return Ok(None);
        };
        let known = Self::default().json().map_err(|e| e.to_string())?;
        if let Some(unknown) = entries.keys().find(|name| !known.contains_key(*name)) {
            return Err(format!("this version has no '{unknown}', which its header names"));
        }
        let request: Self = serde_json::from_value(Value::Object(entries)).map_err(|e| format!("its header: {e}"))?;
        // Its values must be those that the command line takes.
        let flags = request.of_picture().arguments().map_err(|e| e.to_string())?;
        let checked = of_flags(flags).map_err(|e| format!("its command cannot be run: {e}"))?;
        Ok(Some(Self { scene: request.scene, ..checked.of_picture() }))
    }
}

/// A path for a file that others will see, without the folder `root` before it.
fn shared(path: &Path, root: Option<&Path>) -> Option<String> {
    let path = root.and_then(|root| path.strip_prefix(root).ok()).unwrap_or(path);
    let shown = if path.is_absolute() { Path::new(path.file_name()?) } else { path };
    shown.to_str().map(str::to_owned)
}
