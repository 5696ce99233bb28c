//! A job of a batch.

use std::collections::HashMap;
use std::path::Path;

use serde::{Deserialize, Serialize};

use super::frames::Sequence;
use super::numbering::{numbered, numbered_name, with_placeholder};
use crate::job::RenderRequest;

/// One picture, or a sequence of pictures.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Job {
    /// Name, unique in its batch.
    pub name: String,
    /// What is asked for; of a sequence, what its pictures have in common. Paths are resolved.
    #[serde(serialize_with = "RenderRequest::serialize_entries")]
    pub request: RenderRequest,
    /// What makes it many pictures.
    #[serde(skip)]
    pub sequence: Option<Sequence>,
    #[serde(skip)]
    pub location: SourceLocation,
    /// Is it one of many views, whose cameras are written beside the pictures ([`views`](super::views))?
    #[serde(skip)]
    pub is_view: bool,
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

impl Job {
    /// The job with a number in its name and in those of its files. `all` says what is numbered; names of files need no
    /// place for the number if there is a `single` one.
    pub(super) fn numbered(&self, number: u32, all: &str, single: bool) -> Result<Self, (String, String)> {
        let of = |key: &str, file: &Path| {
            let why = "write their number as #### or {frame:04}";
            let path = numbered(file, number).or(single.then(|| file.to_owned()));
            path.ok_or_else(|| {
                (key.to_owned(), format!("`{key}`: {} names one file for all {all}; {why}", file.display()))
            })
        };
        let mut one = Self { sequence: None, ..self.clone() };
        one.name = numbered_name(&with_placeholder(self.name.clone()), number).unwrap_or_default();
        let RenderRequest { output, preview, stats, .. } = &mut one.request;
        *output = of("output", output)?;
        for (key, file) in [("preview", preview), ("stats", stats)] {
            *file = file.as_deref().map(|file| of(key, file)).transpose()?;
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
