//! A run's files: what is read, what is written, and that no output is an input or another output.

use std::collections::HashMap;
use std::fs;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

use crate::{Error, Result};

/// All files that a command names. Compared as files, not as text: other spellings, links and hard links are found.
#[derive(Debug, Default)]
pub struct Paths {
    known: HashMap<Identity, Known>,
}

/// What a file is known by; names of one file share one of them.
#[derive(Debug, PartialEq, Eq, Hash)]
enum Identity {
    /// Device and inode of a file that is there.
    File(u64, u64),
    /// Where it is, or would be made.
    Place(PathBuf),
}

#[derive(Debug, Clone)]
struct Known {
    /// `what` and the path, for people.
    name: String,
    written: bool,
}

impl Paths {
    /// Adds a file that is read; `what` says what for, as in `--env`.
    ///
    /// # Errors
    /// [`Error::Usage`] if it is an output too.
    pub fn reads(&mut self, what: &str, path: &Path) -> Result<()> {
        self.add(Known { name: format!("{what} {}", path.display()), written: false }, path)
    }

    /// Adds a file that is written; `what` as in [`Self::reads`]. Devices may be written twice.
    ///
    /// # Errors
    /// [`Error::Usage`] if it is an input or another output.
    pub fn writes(&mut self, what: &str, path: &Path) -> Result<()> {
        self.add(Known { name: format!("{what} {}", path.display()), written: true }, path)
    }

    fn add(&mut self, new: Known, path: &Path) -> Result<()> {
        let identities = identities(path);
        let known = identities.iter().find_map(|identity| self.known.get(identity));
        match known {
            Some(Known { name, written }) if *written && new.written => Err(Error::Usage(format!(
                "{}: named for two outputs, {name} and {}: give each a file of its own",
                path.display(),
                new.name
            ))),
            Some(Known { name, written: true }) => Err(overwritten(name, &new.name)),
            Some(Known { name, .. }) if new.written => Err(overwritten(&new.name, name)),
            _ => {
                for identity in identities {
                    self.known.entry(identity).or_insert_with(|| new.clone());
                }
                Ok(())
            }
        }
    }
}

fn overwritten(output: &str, input: &str) -> Error {
    Error::Usage(format!("{output} would overwrite {input}: choose another name"))
}

/// None for what is no file: a device or a folder.
fn identities(path: &Path) -> Vec<Identity> {
    let place = || Identity::Place(path.canonicalize().unwrap_or_else(|_| place(path, 0)));
    match fs::metadata(path) {
        Ok(meta) if meta.is_file() => vec![Identity::File(meta.dev(), meta.ino()), place()],
        Ok(_) => Vec::new(),
        Err(_) => vec![place()],
    }
}

/// The path of a file that is not there yet, without links, as far as its folders are there.
fn place(path: &Path, links: u32) -> PathBuf {
    /// As many as Linux follows.
    const MOST_LINKS: u32 = 40;
    let folder = match path.parent() {
        Some(folder) if folder.as_os_str().is_empty() => Path::new("."),
        Some(folder) => folder,
        None => return path.to_owned(),
    };
    if links < MOST_LINKS
        && let Ok(to) = fs::read_link(path)
    {
        return place(&folder.join(to), links + 1);
    }
    let mut place = folder.canonicalize().unwrap_or_else(|_| place(folder, links));
    match path.file_name() {
        Some(name) => place.push(name),
        // It ends in `..`.
        None => {
            place.pop();
        }
    }
    place
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
