//! A job of a batch.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::numbering::{OTHER_OUTPUTS, numbered, numbered_name, with_placeholder};

/// One render, or a sequence of one render per frame (flag `frames`).
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Job {
    /// Name, unique in its file.
    pub name: String,
    /// Path of the scene, resolved against the file's folder.
    #[serde(with = "any_path")]
    pub scene: PathBuf,
    /// Flags of `bismar render`, without dashes, with their values; `None` for switches. Paths are resolved.
    pub flags: Vec<(String, Option<String>)>,
    /// Path of the picture.
    #[serde(with = "any_path")]
    pub output: PathBuf,
    /// Location in the batch file.
    #[serde(skip)]
    pub location: SourceLocation,
    /// Is it one of many views, whose cameras are written beside the pictures ([`views`](super::views))?
    #[serde(skip)]
    pub is_view: bool,
}

/// Serialization of paths that need not be UTF-8.
mod any_path {
    use std::ffi::OsString;
    use std::path::{Path, PathBuf};

    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    pub fn serialize<S: Serializer>(path: &Path, to: S) -> Result<S::Ok, S::Error> {
        path.as_os_str().serialize(to)
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<PathBuf, D::Error> {
        Ok(OsString::deserialize(from)?.into())
    }
}

/// Line and column of a text, from 1; columns are characters.
pub type Location = (usize, usize);

/// Location of a job in its batch file.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct SourceLocation {
    /// That of the job.
    pub at: Location,
    /// Those of its keys.
    pub keys: HashMap<String, Location>,
}

/// A flag as an argument of `bismar render`: `--name=value`, `--name`.
pub fn argument((name, value): &(String, Option<String>)) -> String {
    match value {
        Some(value) => format!("--{name}={value}"),
        None => format!("--{name}"),
    }
}

impl Job {
    /// The flags as arguments of `bismar render`.
    pub fn arguments(&self) -> Vec<String> {
        self.flags.iter().map(argument).collect()
    }

    /// Takes a flag out of the job; returns its value.
    pub fn take(&mut self, flag: &str) -> Option<String> {
        let at = self.flags.iter().position(|(name, _)| name == flag)?;
        self.flags.remove(at).1
    }

    /// The job with a number in its name and in those of its files. `all` says what is numbered; names of files need no
    /// place for the number if there is a `single` one.
    ///
    /// # Errors
    /// A flag and what is wrong with it.
    pub(super) fn numbered(&self, number: u32, all: &str, single: bool) -> Result<Self, (String, String)> {
        let of = |flag: &str, file: &Path| {
            let why = "write their number as #### or {frame:04}";
            let path = numbered(file, number).or(single.then(|| file.to_owned()));
            path.ok_or_else(|| {
                (flag.to_owned(), format!("`{flag}`: {} names one file for all {all}; {why}", file.display()))
            })
        };
        let mut one = self.clone();
        one.name = numbered_name(&with_placeholder(self.name.clone()), number).unwrap_or_default();
        one.output = of("output", &self.output)?;
        for (flag, value) in one.flags.iter_mut().filter(|(flag, _)| OTHER_OUTPUTS.contains(&flag.as_str())) {
            let Some(file) = value else { continue };
            *file = of(flag, Path::new(&file))?.to_string_lossy().into_owned();
        }
        Ok(one)
    }
}

impl SourceLocation {
    /// Line and column of a key, or of the job if it has no such key.
    pub fn of_key(&self, key: &str) -> Location {
        self.keys.get(key).copied().unwrap_or(self.at)
    }

    /// `file:line:column` of a key, or of the job if it has no such key.
    pub fn text(&self, file: &Path, key: Option<&str>) -> String {
        let (line, column) = key.map_or(self.at, |key| self.of_key(key));
        format!("{}:{line}:{column}", file.display())
    }
}
