//! The files of a run. Checks that no output is an input or another output.

use std::collections::HashMap;
use std::fs;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

use crate::film::atomic;
use crate::{Error, Result};

/// All files that a command names. Files are compared, not paths: other spellings, symbolic links and hard links are
/// detected.
#[derive(Debug, Clone, Default)]
pub struct Paths {
    known: HashMap<FileKey, NamedFile>,
}

/// A key of a file. All names of a file share a key.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
enum FileKey {
    /// Device and inode of an existing file.
    Inode(u64, u64),
    /// Path of an existing file or of one that can be created.
    Path(PathBuf),
}

#[derive(Debug, Clone)]
struct NamedFile {
    /// `what` and the path, for people.
    name: String,
    written: bool,
}

impl Paths {
    /// Adds a file that is read; `what` says what for, as in `--env`.
    /// Errors: [`Error::Usage`] if it is an output too.
    pub fn reads(&mut self, what: &str, path: &Path) -> Result<()> {
        self.add(what, path, false)
    }

    /// Adds a file that is written and that the command line names; `what` as in [`Self::reads`]. Devices may be written twice.
    /// Errors: [`Error::Usage`] if it is an input or another output.
    pub fn names(&mut self, what: &str, path: &Path) -> Result<()> {
        atomic::named(path);
        self.writes(what, path)
    }

    /// Adds a file that is written, but is not named on the command line.
    pub fn writes(&mut self, what: &str, path: &Path) -> Result<()> {
        self.add(what, path, true)
    }

    fn add(&mut self, what: &str, path: &Path, written: bool) -> Result<()> {
        let new = NamedFile { name: format!("{what} {}", path.display()), written };
        let keys = file_keys(path);
        let known = keys.iter().find_map(|key| self.known.get(key));
        match known {
            Some(NamedFile { name, written }) if *written && new.written => Err(Error::Usage(format!(
                "{}: named for two outputs, {name} and {}: give each a file of its own",
                path.display(),
                new.name
            ))),
            Some(NamedFile { name, written: true }) => Err(overwritten(name, &new.name)),
            Some(NamedFile { name, .. }) if new.written => Err(overwritten(&new.name, name)),
            _ => {
                for key in keys {
                    self.known.entry(key).or_insert_with(|| new.clone());
                }
                Ok(())
            }
        }
    }
}

fn overwritten(output: &str, input: &str) -> Error {
    Error::Usage(format!("{output} would overwrite {input}: choose another name"))
}

/// The keys of a file; none for devices and folders.
fn file_keys(path: &Path) -> Vec<FileKey> {
    let key = || FileKey::Path(atomic::place_of(path));
    match fs::metadata(path) {
        Ok(meta) if meta.is_file() => vec![FileKey::Inode(meta.dev(), meta.ino()), key()],
        Ok(_) => Vec::new(),
        Err(_) => vec![key()],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_known_by_any_of_its_names() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::create_dir(at("sub")).unwrap();
        for name in ["there", "other"] {
            fs::write(at(name), "x").unwrap();
        }
        fs::hard_link(at("there"), at("hard")).unwrap();
        for (to, name) in [("there", "soft"), ("new", "dangling"), (".", "here"), ("../there", "sub/up")] {
            std::os::unix::fs::symlink(to, at(name)).unwrap();
        }
        let there = ["there", "./there", "sub/../there", "hard", "soft", "here/there", "sub/up", "here/sub/up"];
        let new = ["new", "sub/../new", "dangling", "here/new", "absent/../new", "here/here/dangling"];
        for names in [&there[..], &new[..]] {
            for (a, b) in names.iter().flat_map(|a| names.iter().map(move |b| (a, b))) {
                let [a, b] = [a, b].map(|name| at(name));
                let mut paths = Paths::default();
                paths.reads("scene", &a).unwrap();
                paths.reads("--env", &b).unwrap();
                let error = paths.writes("-o", &b).unwrap_err();
                assert_eq!(error.exit_code(), 64);
                assert!(error.to_string().contains("would overwrite scene"), "{error}");
                let mut paths = Paths::default();
                paths.writes("-o", &a).unwrap();
                assert!(paths.writes("--stats", &b).unwrap_err().to_string().contains("two outputs"));
                assert!(paths.reads("--env", &b).unwrap_err().to_string().contains("would overwrite --env"));
                paths.writes("--stats", &at("other")).unwrap();
                paths.writes("--preview", &at("absent/new")).unwrap();
            }
        }
    }

    #[test]
    fn devices_and_folders_are_no_files() {
        let mut paths = Paths::default();
        for _ in 0..2 {
            paths.writes("-o", Path::new("/dev/null")).unwrap();
            paths.reads("scene", Path::new("/dev/null")).unwrap();
            paths.reads("scene", Path::new("/")).unwrap();
        }
    }

    #[test]
    fn links_in_a_ring_end() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        for (to, name) in [("b", "a"), ("a", "b")] {
            std::os::unix::fs::symlink(to, at(name)).unwrap();
        }
        Paths::default().writes("-o", &at("a")).unwrap();
    }
}
