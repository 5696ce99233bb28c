//! Path mapping rules of Open Job Description (`pathmapping-1.0`), from paths of a job to paths on this machine.

use std::path::{Path, PathBuf};

use serde::Deserialize;

use crate::scene::import::read_text;
use crate::{Error, Result};

/// Path mapping rules, longest source first.
#[derive(Debug, Clone, Default)]
pub struct PathMapping {
    rules: Vec<Rule>,
}

#[derive(Debug, Deserialize)]
struct File {
    // A session without rules writes an empty object.
    version: Option<String>,
    #[serde(default)]
    path_mapping_rules: Vec<Rule>,
}

#[derive(Debug, Clone, Deserialize)]
struct Rule {
    source_path_format: Format,
    source_path: String,
    destination_path: PathBuf,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "UPPERCASE")]
enum Format {
    Posix,
    Windows,
}

impl PathMapping {
    /// Reads a file of rules.
    /// Errors: [`Error::reading`]; [`Error::Config`] for anything that is not `pathmapping-1.0`.
    pub fn read(path: &Path) -> Result<Self> {
        let bytes = read_text(path)?;
        let bad = |why: &str| Error::Config(format!("{}: not a file of path mapping rules: {why}", path.display()));
        let file: File = serde_json::from_slice(&bytes).map_err(|e| bad(&e.to_string()))?;
        if file.version.as_deref().is_some_and(|version| version != "pathmapping-1.0") {
            return Err(bad("the version is not pathmapping-1.0"));
        }
        let mut rules = file.path_mapping_rules;
        rules.sort_by_key(|rule| std::cmp::Reverse(rule.source_path.len()));
        Ok(Self { rules })
    }

    /// Replaces the path by that on this machine: by the first rule whose source contains it.
    pub fn apply(&self, path: &mut PathBuf) {
        let found = self.rules.iter().find_map(|rule| rule.apply(path));
        if let Some(mapped) = found {
            *path = mapped;
        }
    }
}

impl Rule {
    fn apply(&self, path: &Path) -> Option<PathBuf> {
        match self.source_path_format {
            Format::Posix => path.strip_prefix(&self.source_path).ok().map(|rest| self.destination_path.join(rest)),
            Format::Windows => {
                let parts = |text: &str| -> Vec<String> {
                    text.split(['\\', '/']).filter(|part| !part.is_empty()).map(str::to_owned).collect()
                };
                let (path, source) = (parts(path.to_str()?), parts(&self.source_path));
                let (start, rest) = path.split_at_checked(source.len())?;
                let inside = start.iter().zip(&source).all(|(a, b)| a.to_lowercase() == b.to_lowercase());
                inside.then(|| rest.iter().fold(self.destination_path.clone(), |path, part| path.join(part)))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rules(text: &str) -> Result<PathMapping> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("rules.json");
        std::fs::write(&path, text).unwrap();
        PathMapping::read(&path)
    }

    #[test]
    fn the_longest_source_that_holds_a_path_moves_it() {
        let rules = rules(
            r#"{"version": "pathmapping-1.0", "path_mapping_rules": [
                {"source_path_format": "POSIX", "source_path": "/shots", "destination_path": "/mnt/shots"},
                {"source_path_format": "POSIX", "source_path": "/shots/env", "destination_path": "/cache"},
                {"source_path_format": "WINDOWS", "source_path": "C:\\Shots\\", "destination_path": "/mnt/c"}]}"#,
        )
        .unwrap();
        for (path, mapped) in [
            ("/shots/a/hall.glb", "/mnt/shots/a/hall.glb"),
            ("/shots", "/mnt/shots"),
            ("/shots/env/noon.hdr", "/cache/noon.hdr"),
            ("/shotsmith/a.glb", "/shotsmith/a.glb"),
            (r"c:\shots\a\hall.glb", "/mnt/c/a/hall.glb"),
            ("a.glb", "a.glb"),
        ] {
            let mut moved = PathBuf::from(path);
            rules.apply(&mut moved);
            assert_eq!(moved, Path::new(mapped));
        }
    }

    #[test]
    fn an_empty_object_has_no_rules_and_other_things_are_refused() {
        assert!(rules("{}").unwrap().rules.is_empty());
        for bad in ["", "[]", r#"{"version": "pathmapping-2.0"}"#, r#"{"path_mapping_rules": [{}]}"#] {
            assert_eq!(rules(bad).unwrap_err().exit_code(), 78, "{bad}");
        }
    }
}
