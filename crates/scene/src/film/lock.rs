//! One writer for each output: a second process fails before it begins to work.

use std::collections::HashMap;
use std::fs::{self, File, TryLockError};
use std::os::unix::fs::{MetadataExt, OpenOptionsExt};
use std::path::{Path, PathBuf};
use std::sync::{LazyLock, Mutex, MutexGuard, PoisonError};

use super::destination::{folder_of, lock_name, open_guessable, target_of};
use crate::{Error, Result};

/// The files that the claimed paths of this process stood for when they were claimed, and the number of claims by each.
static TARGETS: LazyLock<Mutex<HashMap<PathBuf, (PathBuf, usize)>>> = LazyLock::new(Mutex::default);

/// The locks of this process, by output file.
static HELD: LazyLock<Mutex<HashMap<PathBuf, Held>>> = LazyLock::new(Mutex::default);

#[derive(Debug)]
struct Held {
    /// The locked file: the output itself or, until it exists, a lock file next to it.
    _file: File,
    /// The path of the lock file.
    lock_file: Option<PathBuf>,
}

impl Drop for Held {
    fn drop(&mut self) {
        // It is still locked, so no other process uses it.
        self.lock_file.iter().for_each(|path| drop(fs::remove_file(path)));
    }
}

/// Keeps other processes from writing an output until it is dropped, and this process from following symbolic links that
/// take its place in the meantime.
#[derive(Debug, Default)]
#[must_use]
pub struct Claim {
    /// The key of the lock.
    lock: Option<PathBuf>,
    /// The key of the target.
    path: Option<PathBuf>,
}

impl Drop for Claim {
    fn drop(&mut self) {
        if let Some(lock) = &self.lock {
            locked(&HELD).remove(lock);
        }
        let Some(path) = &self.path else { return };
        let mut targets = locked(&TARGETS);
        let Some((_, claims)) = targets.get_mut(path) else { return };
        *claims -= 1;
        if *claims == 0 {
            targets.remove(path);
        }
    }
}

fn locked<T>(map: &Mutex<T>) -> MutexGuard<'_, T> {
    map.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The file that this process has claimed by the name `path`, if it has.
pub(super) fn claimed(path: &Path) -> Option<PathBuf> {
    let path = std::path::absolute(path).ok()?;
    locked(&TARGETS).get(&path).map(|(target, _)| target.clone())
}

/// A unique name of an output, which may not exist yet.
fn key(target: &Path) -> PathBuf {
    let folder = folder_of(target);
    let folder = folder.canonicalize().unwrap_or_else(|_| folder.into());
    folder.join(target.file_name().unwrap_or_default())
}

/// Claims an output for this process. Devices cannot be claimed, nor files on a file system without locks: the claim is then
/// empty.
///
/// # Errors
/// [`Error::CannotCreate`] if another process has claimed it; the errors of [`atomic::check`](super::atomic::check).
pub fn claim(path: &Path) -> Result<Claim> {
    let Some(target) = target_of(path)? else { return Ok(Claim::default()) };
    let name = std::path::absolute(path).ok();
    if let Some(name) = &name {
        locked(&TARGETS).entry(name.clone()).or_insert((target.clone(), 0)).1 += 1;
    }
    // Without a lock, so far.
    let mut claim = Claim { lock: None, path: name };
    let lock_file = folder_of(&target).join(lock_name(&target));
    // The file may be replaced or created between open and lock.
    for _ in 0..100 {
        let output = File::options().read(true).write(true).open(&target).or_else(|_| File::open(&target)).ok();
        let lock_path = output.is_none().then(|| lock_file.clone());
        let mut beside = File::options();
        beside.create(true).truncate(false).write(true).mode(0o600);
        // `atomic::check` reports why it cannot be created.
        let Some(file) = output.or_else(|| open_guessable(&mut beside, &lock_file).ok()) else { return Ok(claim) };
        match file.try_lock() {
            // Somebody who may only read it: no bismar takes a shared lock.
            Err(TryLockError::WouldBlock) if file.try_lock_shared().is_ok() => return Ok(claim),
            Err(TryLockError::WouldBlock) => {
                return Err(Error::CannotCreate(format!(
                    "{}: another bismar is writing it: wait for that one, or choose another name",
                    path.display()
                )));
            }
            Err(TryLockError::Error(_)) => return Ok(claim),
            Ok(()) => {}
        }
        let same = |a: fs::Metadata, b: fs::Metadata| (a.dev(), a.ino()) == (b.dev(), b.ino());
        let place = lock_path.as_ref().unwrap_or(&target);
        let current = file.metadata().and_then(|a| Ok(same(a, fs::metadata(place)?))).unwrap_or(false);
        if current && (lock_path.is_none() || !target.exists()) {
            let key = key(&target);
            locked(&HELD).insert(key.clone(), Held { _file: file, lock_file: lock_path });
            claim.lock = Some(key);
            return Ok(claim);
        }
    }
    Ok(claim)
}

/// Releases all claims of this process before an immediate exit.
pub fn release_all() {
    locked(&HELD).clear();
}

/// Moves the claim of `target` to the locked file that has replaced it.
pub(super) fn replaced(target: &Path, by: File) {
    if let Some(claimed) = locked(&HELD).get_mut(&key(target)) {
        *claimed = Held { _file: by, lock_file: None };
    }
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use super::*;
    use crate::film::atomic;

    fn written(path: &Path) {
        atomic::write(path, |w| Ok(Ok(w.write_all(b"x")?))).unwrap();
    }

    fn names(folder: &Path) -> Vec<String> {
        fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect()
    }

    #[test]
    fn a_claimed_output_is_nobody_elses_before_and_after_it_is_written() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.exr");
        let refused = || {
            let error = claim(&path).unwrap_err();
            assert_eq!(error.exit_code(), 73);
            assert!(error.to_string().contains("another bismar"), "{error}");
        };
        let first = claim(&path).unwrap();
        atomic::sweep(&path);
        refused();
        for _ in 0..3 {
            written(&path);
            atomic::sweep(&path);
            refused();
            // The lock file is removed as soon as the output exists.
            assert_eq!(names(folder.path()), ["a.exr"]);
        }
        drop(first);
        let second = claim(&path).unwrap();
        refused();
        drop(second);
        assert_eq!(names(folder.path()), ["a.exr"]);
    }

    #[test]
    fn a_claimed_name_that_becomes_a_link_is_replaced_and_not_followed() {
        let folder = tempfile::tempdir().unwrap();
        let [path, other] = ["a.exr", "other"].map(|name| folder.path().join(name));
        for exists in [false, true] {
            fs::write(&other, "mine").unwrap();
            if exists {
                fs::write(&path, "old").unwrap();
            }
            let first = claim(&path).unwrap();
            let _ = fs::remove_file(&path);
            std::os::unix::fs::symlink(&other, &path).unwrap();
            written(&path);
            assert_eq!((fs::read(&other).unwrap(), fs::read(&path).unwrap()), (b"mine".to_vec(), b"x".to_vec()));
            assert!(fs::symlink_metadata(&path).unwrap().is_file());
            drop(first);
            fs::remove_file(&path).unwrap();
        }
        // A link that was there when it was claimed stays one.
        std::os::unix::fs::symlink(&other, &path).unwrap();
        let _first = claim(&path).unwrap();
        written(&path);
        assert_eq!(fs::read(&other).unwrap(), b"x");
        assert!(fs::symlink_metadata(&path).unwrap().is_symlink());
    }

    #[test]
    fn a_relative_name_is_the_same_output() {
        let folder = tempfile::tempdir_in(".").unwrap();
        let name = folder.path().file_name().unwrap();
        let path = Path::new(name).join("a.exr");
        let _first = claim(&path).unwrap();
        for _ in 0..3 {
            written(&path);
            assert!(claim(&path).is_err() && claim(&path.canonicalize().unwrap()).is_err());
        }
        assert_eq!(names(folder.path()), ["a.exr"]);
    }

    #[test]
    fn a_claim_that_came_to_nothing_leaves_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.exr");
        drop(claim(&path).unwrap());
        assert!(names(folder.path()).is_empty());
        // What a killed process left is taken over, and swept.
        fs::write(folder.path().join(".a.exr.lock.tmp"), "").unwrap();
        drop(claim(&path).unwrap());
        assert!(names(folder.path()).is_empty());
        drop(claim(Path::new("/dev/null")).unwrap());
        drop(claim(Path::new("/dev/null")).unwrap());
    }
}
