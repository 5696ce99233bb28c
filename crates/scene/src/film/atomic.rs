//! Outputs appear whole or not at all: written beside their place, flushed to the disk, renamed.

use std::ffi::{OsStr, OsString};
use std::fs::{self, File};
use std::io::{self, BufWriter, ErrorKind};
use std::os::unix::ffi::OsStrExt;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};

use tempfile::NamedTempFile;

use super::lock;
use crate::{Error, Result};

/// Why the content did not get written: our own error, or the system's.
type Writing = io::Result<Result<()>>;

/// Fails now if [`write()`] to `path` would fail for its folder or its name: before an hour of work, not after it.
///
/// # Errors
/// [`Error::CannotCreate`] or [`Error::Permission`], with the path.
pub fn check(path: &Path) -> Result<()> {
    match Place::of(path)? {
        Place::File { target, folder } => beside(&target, &folder).map(drop),
        Place::Device => Ok(()),
    }
}

/// Removes what processes that were killed while they wrote `path` have left beside it. Files that are being written
/// are locked, and stay.
pub fn sweep(path: &Path) {
    let Ok(Place::File { target, folder }) = Place::of(path) else { return };
    let prefix = prefix_of(&target);
    let left =
        |name: &OsStr| name.as_bytes().starts_with(prefix.as_bytes()) && name.as_bytes().ends_with(SUFFIX.as_bytes());
    let files = fs::read_dir(folder).into_iter().flatten().flatten().filter(|f| left(&f.file_name()));
    for file in files {
        if File::open(file.path()).is_ok_and(|f| f.try_lock().is_ok()) {
            // Somebody else may have been faster.
            let _ = fs::remove_file(file.path());
        }
    }
}

/// Writes a file through `content`. The old file stays as it was unless everything succeeded; a device such as
/// `/dev/null` is written in place.
///
/// # Errors
/// [`Error::CannotCreate`], [`Error::Permission`]; [`Error::Io`] when the disk is full or a write fails; what
/// `content` returns.
pub fn write(path: &Path, content: impl FnOnce(&mut BufWriter<&File>) -> Writing) -> Result<()> {
    let failed = |e: io::Error| Error::Io(format!("{}: cannot write: {e}", path.display()));
    match Place::of(path)? {
        Place::Device => {
            let file = File::options().write(true).open(path).map_err(|e| creating(path, &e))?;
            fill(&file, content).map_err(failed)?
        }
        Place::File { target, folder } => {
            let temporary = beside(&target, &folder)?;
            // For `sweep`. Where the file system knows no locks, nothing is swept either.
            let _ = temporary.as_file().try_lock();
            fill(temporary.as_file(), content).map_err(failed)??;
            if let Ok(old) = fs::metadata(&target) {
                // Where the system does not let it, the file is the umask's.
                let _ = temporary.as_file().set_permissions(old.permissions());
            }
            temporary.as_file().sync_all().map_err(failed)?;
            let file = temporary.persist(&target).map_err(|e| failed(e.error))?;
            lock::replaced(&target, file);
            // The rename itself survives a power cut only once the folder is flushed; not every file system can.
            let _ = File::open(&folder).and_then(|f| f.sync_all());
            Ok(())
        }
    }
}

fn fill(file: &File, content: impl FnOnce(&mut BufWriter<&File>) -> Writing) -> Writing {
    let mut writer = BufWriter::with_capacity(1 << 20, file);
    let result = content(&mut writer)?;
    writer.into_inner().map_err(|e| e.into_error())?;
    Ok(result)
}

pub(super) enum Place {
    /// A regular file, there already or not, and its folder. Links are followed, so that a link stays one.
    File { target: PathBuf, folder: PathBuf },
    /// Something that must not be replaced by a file.
    Device,
}

impl Place {
    pub(super) fn of(path: &Path) -> Result<Self> {
        let target = match fs::metadata(path) {
            Ok(meta) if meta.is_dir() => {
                return Err(Error::CannotCreate(format!("{}: cannot write: it is a folder", path.display())));
            }
            Ok(meta) if !meta.is_file() => return Ok(Place::Device),
            Ok(_) => path.canonicalize().map_err(|e| creating(path, &e))?,
            Err(_) => followed(path)?,
        };
        if target.file_name().is_none() {
            return Err(Error::CannotCreate(format!("'{}': cannot write: not a file name", path.display())));
        }
        let folder = match target.parent() {
            Some(p) if !p.as_os_str().is_empty() => p.to_owned(),
            _ => PathBuf::from("."),
        };
        Ok(Place::File { target, folder })
    }
}

/// Where a link to nothing yet leads.
fn followed(path: &Path) -> Result<PathBuf> {
    // As many as systems follow.
    const MOST: u32 = 40;
    let mut target = path.to_owned();
    for _ in 0..MOST {
        let Ok(next) = fs::read_link(&target) else { return Ok(target) };
        target = target.parent().unwrap_or(Path::new("")).join(next);
    }
    Err(Error::CannotCreate(format!("{}: cannot write: links lead in a circle", path.display())))
}

const SUFFIX: &str = ".tmp";

/// The name of the file that is locked while `target` is not there yet: [`sweep`] removes it when its process is gone.
pub(super) fn lock_name(target: &Path) -> OsString {
    let mut name = prefix_of(target);
    name.push("lock");
    name.push(SUFFIX);
    name
}

fn prefix_of(target: &Path) -> OsString {
    let mut prefix = OsString::from(".");
    prefix.push(target.file_name().unwrap_or_default());
    prefix.push(".");
    prefix
}

fn beside(target: &Path, folder: &Path) -> Result<NamedTempFile> {
    let prefix = prefix_of(target);
    let mut builder = tempfile::Builder::new();
    builder.prefix(&prefix).suffix(SUFFIX);
    // What a plain create gives: the umask still applies.
    builder.permissions(fs::Permissions::from_mode(0o666));
    builder.tempfile_in(folder).map_err(|e| creating(target, &e))
}

fn creating(path: &Path, error: &io::Error) -> Error {
    // tempfile's errors name its own random path: keep the system's words alone.
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

#[cfg(test)]
mod tests {
    use std::io::Write;

    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect()
    }

    #[test]
    fn a_failed_write_leaves_the_old_file_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        write(&path, |w| Ok(Ok(w.write_all(b"old")?))).unwrap();
        let full = write(&path, |w| {
            w.write_all(b"new, half-way")?;
            Err(io::Error::from(ErrorKind::StorageFull))
        });
        assert_eq!(full.unwrap_err().exit_code(), 74);
        let ours = write(&path, |_| Ok(Err(Error::Bug("x".into()))));
        assert_eq!(ours.unwrap_err().exit_code(), 70);
        assert_eq!(fs::read(&path).unwrap(), b"old");
        assert_eq!(names(folder.path()), ["a.txt"]);
    }

    #[test]
    fn checking_leaves_no_trace_and_finds_what_cannot_be_created() {
        let folder = tempfile::tempdir().unwrap();
        check(&folder.path().join("a.exr")).unwrap();
        assert!(names(folder.path()).is_empty());
        fs::write(folder.path().join("file"), "").unwrap();
        for bad in ["absent/a.exr", "file/a.exr", ""] {
            let error = check(&folder.path().join(bad)).unwrap_err();
            assert_eq!(error.exit_code(), 73, "{bad}: {error}");
        }
    }

    #[test]
    fn what_a_killed_process_left_is_swept_and_what_is_being_written_is_not() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.exr");
        for name in [".a.exr.AbCdEf.tmp", ".b.exr.AbCdEf.tmp", "a.exr", ".a.exr.keep"] {
            fs::write(folder.path().join(name), "x").unwrap();
        }
        write(&path, |w| {
            sweep(&path);
            assert_eq!(names(folder.path()).len(), 4);
            Ok(Ok(w.write_all(b"new")?))
        })
        .unwrap();
        let mut left = names(folder.path());
        left.sort();
        assert_eq!(left, [".a.exr.keep", ".b.exr.AbCdEf.tmp", "a.exr"]);
    }

    #[test]
    fn a_device_stays_a_device_and_a_full_one_is_a_failed_write() {
        write(Path::new("/dev/null"), |w| Ok(Ok(w.write_all(b"x")?))).unwrap();
        assert!(!fs::metadata("/dev/null").unwrap().is_file());
        let error = write(Path::new("/dev/full"), |w| Ok(Ok(w.write_all(b"x")?))).unwrap_err();
        assert_eq!(error.exit_code(), 74);
    }

    #[cfg(unix)]
    #[test]
    fn a_link_stays_a_link_and_permissions_follow_the_umask() {
        let folder = tempfile::tempdir().unwrap();
        let (real, link, plain) = (folder.path().join("real"), folder.path().join("link"), folder.path().join("plain"));
        fs::write(&plain, "").unwrap();
        fs::write(&real, "old").unwrap();
        std::os::unix::fs::symlink(&real, &link).unwrap();
        write(&link, |w| Ok(Ok(w.write_all(b"new")?))).unwrap();
        assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
        assert_eq!(fs::read(&real).unwrap(), b"new");
        let mode = |p: &Path| fs::metadata(p).unwrap().permissions().mode();
        assert_eq!(mode(&real), mode(&plain));
        // A file keeps its own.
        fs::set_permissions(&real, fs::Permissions::from_mode(0o640)).unwrap();
        write(&link, |w| Ok(Ok(w.write_all(b"newer")?))).unwrap();
        assert_eq!((mode(&real) & 0o777, fs::read(&real).unwrap()), (0o640, b"newer".to_vec()));
        // A link to nothing yet leads there; links in a circle nowhere.
        let (later, first, second) = (folder.path().join("later"), folder.path().join("1"), folder.path().join("2"));
        std::os::unix::fs::symlink("later", &second).unwrap();
        std::os::unix::fs::symlink(&second, &first).unwrap();
        check(&first).unwrap();
        write(&first, |w| Ok(Ok(w.write_all(b"x")?))).unwrap();
        assert!(
            fs::symlink_metadata(&first).unwrap().is_symlink() && fs::symlink_metadata(&second).unwrap().is_symlink()
        );
        assert_eq!(fs::read(&later).unwrap(), b"x");
        let circle = folder.path().join("circle");
        std::os::unix::fs::symlink("circle", &circle).unwrap();
        assert_eq!(check(&circle).unwrap_err().exit_code(), 73);
    }
}
