//! Destinations of outputs, and the names of temporary files next to them.

use std::ffi::OsString;
use std::fs;
use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};

use crate::{Error, Result};

/// The destination of an output path.
pub(super) enum Destination {
    /// A regular file, which may not exist yet, and its folder. Symbolic links are followed, so that they stay links.
    File { target: PathBuf, folder: PathBuf },
    /// A device, which must not be replaced by a file.
    Device,
}

impl Destination {
    pub(super) fn resolve(path: &Path) -> Result<Self> {
        let target = match fs::metadata(path) {
            Ok(meta) if meta.is_dir() => {
                return Err(Error::CannotCreate(format!("{}: cannot write: it is a folder", path.display())));
            }
            Ok(meta) if !meta.is_file() => return Ok(Destination::Device),
            Ok(_) => path.canonicalize().map_err(|e| cannot_create(path, &e))?,
            Err(_) => followed(path)?,
        };
        if target.file_name().is_none() {
            return Err(Error::CannotCreate(format!("'{}': cannot write: not a file name", path.display())));
        }
        let folder = match target.parent() {
            Some(p) if !p.as_os_str().is_empty() => p.to_owned(),
            _ => PathBuf::from("."),
        };
        Ok(Destination::File { target, folder })
    }
}

/// The target of a symbolic link whose target may not exist yet.
fn followed(path: &Path) -> Result<PathBuf> {
    // The limit of Linux.
    const MAX_LINKS: u32 = 40;
    let mut target = path.to_owned();
    for _ in 0..MAX_LINKS {
        let Ok(next) = fs::read_link(&target) else { return Ok(target) };
        target = target.parent().unwrap_or(Path::new("")).join(next);
    }
    Err(Error::CannotCreate(format!("{}: cannot write: links lead in a circle", path.display())))
}

/// Suffix of temporary files.
pub(super) const SUFFIX: &str = ".tmp";

/// The name of the file that is locked while `target` does not exist yet. [`sweep`](super::atomic::sweep) removes it after the
/// end of its process.
pub(super) fn lock_name(target: &Path) -> OsString {
    let mut name = temporary_prefix(target);
    name.push("lock");
    name.push(SUFFIX);
    name
}

/// Prefix of temporary files for `target`.
pub(super) fn temporary_prefix(target: &Path) -> OsString {
    let mut prefix = OsString::from(".");
    prefix.push(target.file_name().unwrap_or_default());
    prefix.push(".");
    prefix
}

/// The error of a file that cannot be created.
pub(super) fn cannot_create(path: &Path, error: &io::Error) -> Error {
    // The errors of tempfile name its own random path.
    let reason = match error.kind() {
        ErrorKind::NotFound => "the folder does not exist".to_owned(),
        ErrorKind::NotADirectory => "a part of the path is not a folder".to_owned(),
        ErrorKind::PermissionDenied => "permission denied".to_owned(),
        ErrorKind::ReadOnlyFilesystem => "the file system is read-only".to_owned(),
        ErrorKind::StorageFull => "the disk is full".to_owned(),
        _ => error.to_string(),
    };
    let text = format!("{}: cannot create: {reason}", path.display());
    match error.kind() {
        ErrorKind::PermissionDenied => Error::Permission(text),
        _ => Error::CannotCreate(text),
    }
}
