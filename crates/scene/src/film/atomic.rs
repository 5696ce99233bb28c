//! Atomic outputs: written to a temporary file in the same folder, flushed to the disk, renamed.

use std::ffi::OsStr;
use std::fs::{self, File};
use std::io::{self, BufWriter, Read, Seek, SeekFrom};
use std::os::unix::ffi::OsStrExt;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;

use tempfile::NamedTempFile;

pub use super::destination::{
    OF_A_PLAN, begin_command, check_below, check_folder, command, confine, create_folder, folder_of, named,
    open_guessable, place_of,
};
use super::destination::{SUFFIX, cannot_create, is_confined, target_of, temporary_prefix};
use super::{lock, mark};
use crate::{Error, Result};

/// The result of writing content: the outer error is the system's, the inner one our own.
type Writing = io::Result<Result<()>>;

/// Checks before a long render whether [`write()`] can create `path`.
///
/// # Errors
/// [`Error::CannotCreate`] or [`Error::Permission`], with the path.
pub fn check(path: &Path) -> Result<()> {
    let Some(target) = target_of(path)? else { return Ok(()) };
    if is_confined(path) {
        check_ours(&target, None)?;
    }
    temporary_file(&target).map(drop)
}

/// Checks that nothing is at `path`, or a file that this program has written and nobody has changed. Tables (.csv) have no place for a
/// mark: they count as ours if they begin with the line of `new`, which takes their place.
///
/// # Errors
/// [`Error::CannotCreate`].
pub fn check_ours(path: &Path, new: Option<&File>) -> Result<()> {
    let line = |mut file: &File| {
        let mut bytes = Vec::new();
        let _ = file.seek(SeekFrom::Start(0)).and_then(|_| file.take(1 << 16).read_to_end(&mut bytes));
        bytes.split(|b| *b == b'\n').next().map(<[u8]>::to_vec)
    };
    let is_table = path.extension().is_some_and(|end| end == "csv");
    let same_table = || new.is_none_or(|new| File::open(path).is_ok_and(|old| line(&old) == line(new)));
    if fs::symlink_metadata(path).is_err() || mark::is_ours(path) || is_table && same_table() {
        return Ok(());
    }
    let why = "there is a file that bismar has not written, or that was changed since; remove it, or name the output on the \
               command line";
    Err(Error::CannotCreate(format!("{}: not written: {why}", path.display())))
}

/// Removes the temporary files of `path` that killed processes have left in its folder. Files that are being written are
/// locked and stay.
pub fn sweep(path: &Path) {
    let Ok(Some(target)) = target_of(path) else { return };
    let prefix = temporary_prefix(&target);
    let left = |name: &OsStr| {
        let own = name.as_bytes().strip_prefix(prefix.as_bytes()).and_then(|rest| rest.strip_suffix(SUFFIX.as_bytes()));
        own.is_some_and(|own| own == b"lock" || own.len() == 6 && own.iter().all(u8::is_ascii_alphanumeric))
    };
    let files = fs::read_dir(folder_of(&target)).into_iter().flatten().flatten().filter(|f| left(&f.file_name()));
    for file in files {
        if open_guessable(File::options().read(true), &file.path()).is_ok_and(|f| f.try_lock().is_ok()) {
            // Another process may have removed it.
            let _ = fs::remove_file(file.path());
        }
    }
}

/// Writes a file by `content`. An existing file is replaced only if everything succeeds. A device such as `/dev/null` is written
/// in place. Symbolic links are followed, except those that have taken the place of a claimed output
/// ([`claim`](super::lock::claim)): these are replaced.
///
/// # Errors
/// [`Error::CannotCreate`], [`Error::Permission`]; [`Error::Io`] if the disk is full or a write fails; the error that `content`
/// returns.
pub fn write(path: &Path, content: impl FnOnce(&mut BufWriter<&File>) -> Writing) -> Result<()> {
    let failed = |e: io::Error| Error::Io(format!("{}: cannot write: {e}", path.display()));
    let Some(target) = lock::claimed(path).map_or_else(|| target_of(path), |target| Ok(Some(target)))? else {
        let file = File::options().write(true).open(path).map_err(|e| cannot_create(path, &e))?;
        return fill(&file, content).map_err(failed)?;
    };
    let temporary = temporary_file(&target)?;
    // The lock keeps `sweep` away. A file system without locks is not swept either.
    let _ = temporary.as_file().try_lock();
    fill(temporary.as_file(), content).map_err(failed)??;
    mark::add(temporary.as_file()).map_err(failed)?;
    if let Some(old) = fs::symlink_metadata(&target).ok().filter(fs::Metadata::is_file) {
        // If that fails, the file keeps the permissions of the umask.
        let _ = temporary.as_file().set_permissions(old.permissions());
    }
    if is_confined(path) {
        check_ours(&target, Some(temporary.as_file()))?;
    }
    temporary.as_file().sync_all().map_err(failed)?;
    let file = temporary.persist(&target).map_err(|e| failed(e.error))?;
    lock::replaced(&target, file);
    // The rename survives a power failure only after a flush of the folder, which not every file system supports.
    let _ = File::open(folder_of(&target)).and_then(|f| f.sync_all());
    Ok(())
}

fn fill(file: &File, content: impl FnOnce(&mut BufWriter<&File>) -> Writing) -> Writing {
    let mut writer = BufWriter::with_capacity(1 << 20, file);
    let result = content(&mut writer)?;
    writer.into_inner().map_err(|e| e.into_error())?;
    Ok(result)
}

/// A temporary file in the folder of `target`.
fn temporary_file(target: &Path) -> Result<NamedTempFile> {
    let prefix = temporary_prefix(target);
    let mut builder = tempfile::Builder::new();
    builder.prefix(&prefix).suffix(SUFFIX);
    // The permissions of a plain create, to which the umask applies.
    builder.permissions(fs::Permissions::from_mode(0o666));
    builder.tempfile_in(folder_of(target)).map_err(|e| cannot_create(target, &e))
}

#[cfg(test)]
mod tests {
    use std::io::{ErrorKind, Write};

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
