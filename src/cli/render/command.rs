//! The command that a picture was rendered by, in the picture's header: `bismar check` renders it again.

use std::path::Path;

use serde::{Deserialize, Serialize};

use super::args::RenderArgs;
use crate::Result;
use crate::film::exr_file::Header;
use crate::render::checkpoint::{json, text};

/// The header attribute.
pub const ATTRIBUTE: &str = "bismar.command";
/// Flags that do not say what is in the picture.
const NOT_OF_THE_PICTURE: [&str; 20] = [
    "output",
    "preview",
    "view",
    "exposure",
    "stats",
    "tev",
    "progress",
    "threads",
    "memory-limit",
    "resume",
    "checkpoint",
    "keep",
    "on-checkpoint",
    "part",
    "path-mapping",
    "replay-pixel",
    "strict",
    "led",
    "env",
    "relative-to",
];

/// A scene, and flags of `bismar render`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct PictureCommand {
    /// The scene's path as it was given, if that was relative; else its name without the folders, which are private.
    pub scene: String,
    /// The environment map's path, likewise.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub env: Option<String>,
    /// Flags without dashes that decide what is in the picture; `None` for switches.
    pub flags: Vec<(String, Option<String>)>,
}

impl PictureCommand {
    /// The command of these arguments; `None` if their flags are not known, or paths are not UTF-8.
    fn of(args: &RenderArgs) -> Option<Self> {
        let mut flags = args.given.clone()?;
        flags.retain(|(name, _)| !NOT_OF_THE_PICTURE.contains(&name.as_str()));
        let shared = |path: &Path| shared(path, args.relative_to.as_deref());
        let env = args.env.as_deref().map(shared);
        if env == Some(None) {
            return None;
        }
        Some(Self { scene: shared(&args.scene)?, env: env.flatten(), flags })
    }

    /// Adds the attribute to a header.
    ///
    /// # Errors
    /// Those of [`json`].
    pub fn write(args: &RenderArgs, header: &mut Header) -> Result<()> {
        if let Some(command) = Self::of(args) {
            header.push((ATTRIBUTE.into(), json(&command)?));
        }
        Ok(())
    }

    /// The command of a picture; `None` for pictures without.
    pub fn read(header: &Header) -> Option<Self> {
        text(header, ATTRIBUTE).and_then(|text| serde_json::from_str(text).ok())
    }
}

/// A path for a file that others will see, without the folder `root` before it.
fn shared(path: &Path, root: Option<&Path>) -> Option<String> {
    let path = root.and_then(|root| path.strip_prefix(root).ok()).unwrap_or(path);
    let shown = if path.is_absolute() { Path::new(path.file_name()?) } else { path };
    shown.to_str().map(str::to_owned)
}
