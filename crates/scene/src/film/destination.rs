//! Destinations of outputs, and the names of temporary files next to them.

use std::cell::RefCell;
use std::collections::HashSet;
use std::ffi::OsString;
use std::fs::{self, File, OpenOptions};
use std::io::{self, ErrorKind};
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};

use rustix::fs::OFlags;
use rustix::io::Errno;

use crate::{Error, Result};

/// Which outputs this process may write. Files may be of others, so that only what a user has typed is written anywhere.
static RULE: Mutex<Option<Rule>> = Mutex::new(None);
static IS_COMMAND: AtomicBool = AtomicBool::new(false);

thread_local! {
    /// The rule of the command that this thread does for a library's caller.
    static OWN_RULE: RefCell<Option<Rule>> = const { RefCell::new(None) };
}

/// Set for the command that a plan holds: nobody has typed its outputs.
pub const OF_A_PLAN: &str = "BISMAR_OF_A_PLAN";

/// This process runs one command, for which [`confine`] and [`named`] hold. In a library, every path that a caller gives counts as
/// named; [`command`] is for a whole command.
pub fn begin_command() {
    IS_COMMAND.store(true, Ordering::Relaxed);
    if is_of_a_plan() {
        confine(&[]);
    }
}

/// Does a command's work on this thread, for which [`confine`] and [`named`] hold until it ends.
pub fn command<T>(work: impl FnOnce() -> T) -> T {
    struct End(Option<Rule>);
    impl Drop for End {
        fn drop(&mut self) {
            OWN_RULE.set(self.0.take());
        }
    }
    let _end = End(OWN_RULE.replace(Some(Rule::default())));
    work()
}

fn is_of_a_plan() -> bool {
    std::env::var_os(OF_A_PLAN).is_some()
}

#[derive(Debug, Default)]
struct Rule {
    /// Absolute paths of outputs that the command line names.
    named: HashSet<PathBuf>,
    /// Folders below which all other outputs lie; anywhere if empty.
    folders: Vec<PathBuf>,
}

fn rule<T>(with: impl FnOnce(&mut Option<Rule>) -> T) -> T {
    OWN_RULE.with_borrow_mut(|own| match own {
        Some(_) => with(own),
        None => with(&mut RULE.lock().unwrap_or_else(PoisonError::into_inner)),
    })
}

/// From now on, an output of this process that its command line does not [name](named()) is written only below one of `folders`
/// (anywhere if there are none), not through a symbolic link, and not over a file that is not of this program.
pub fn confine(folders: &[PathBuf]) {
    rule(|rule| rule.get_or_insert_default().folders.extend_from_slice(folders));
}

/// The command line names this output: it is written wherever it is, through links and over any file.
pub fn named(path: &Path) {
    if !is_of_a_plan() {
        rule(|rule| rule.get_or_insert_default().named.insert(absolute(path)));
    }
}

/// The absolute path, or, in a folder that was removed, the path as it is.
fn absolute(path: &Path) -> PathBuf {
    std::path::absolute(path).unwrap_or_else(|_| path.into())
}

/// Is this output one that the command line does not name?
pub(super) fn is_confined(path: &Path) -> bool {
    let path = absolute(path);
    let is_command = IS_COMMAND.load(Ordering::Relaxed) || OWN_RULE.with_borrow(Option::is_some);
    is_command && rule(|rule| rule.as_ref().is_some_and(|rule| !rule.named.contains(&path)))
}

/// Opens a file of ours whose name others can guess: never through a link, and no pipe that would wait for a reader.
///
/// # Errors
/// Those of the system, and [`ErrorKind::InvalidInput`] for what is no regular file.
pub fn open_guessable(options: &mut OpenOptions, path: &Path) -> io::Result<File> {
    let flags = OFlags::NOFOLLOW | OFlags::NONBLOCK;
    let file = options.custom_flags(flags.bits().cast_signed()).open(path)?;
    match file.metadata()?.is_file() {
        true => Ok(file),
        false => Err(io::Error::new(ErrorKind::InvalidInput, "not a regular file")),
    }
}

/// Creates the folder of an output, if it may be there.
///
/// # Errors
/// [`Error::CannotCreate`].
pub fn create_folder(output: &Path) -> Result<()> {
    check_place(output)?;
    let folder = folder_of(output);
    fs::create_dir_all(folder).map_err(|e| cannot_create(folder, &e))
}

fn check_place(path: &Path) -> Result<()> {
    let folders = || rule(|rule| rule.as_ref().map(|rule| rule.folders.clone()).unwrap_or_default());
    if is_confined(path) { check_below(path, &folders()) } else { Ok(()) }
}

/// Checks that a folder of outputs that the command line does not name is no link; `flag` names another one.
///
/// # Errors
/// [`Error::CannotCreate`].
pub fn check_folder(folder: &Path, flag: &str) -> Result<()> {
    let why = || format!("{}: not written: it is a link; {flag} DIR names another folder", folder.display());
    if folder.is_symlink() { Err(Error::CannotCreate(why())) } else { Ok(()) }
}

/// Checks that an output that the command line does not name lies below one of the folders, if there are any, and is no link.
///
/// # Errors
/// [`Error::CannotCreate`].
pub fn check_below(path: &Path, folders: &[PathBuf]) -> Result<()> {
    let refused = |why: String| Err(Error::CannotCreate(format!("{}: not written: {why}", path.display())));
    if fs::symlink_metadata(path).is_ok_and(|meta| !meta.is_file() && !meta.is_dir()) {
        return refused(
            "it is a link or a device; an output that the command line does not name must be a file".into(),
        );
    }
    let place = place_of(path);
    if !folders.is_empty() && !folders.iter().any(|folder| place.starts_with(place_of(folder))) {
        return refused(format!(
            "it lies outside of {}, where outputs may be; name another root folder",
            folders[0].display()
        ));
    }
    Ok(())
}

pub fn folder_of(file: &Path) -> &Path {
    file.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// Most symbolic links from one to the next: the limit of Linux.
const MAX_LINKS: u32 = 40;

/// The path of a file that may not exist yet, without links and `..`, as far as its folders exist. The current folder may not: it
/// may have been removed.
pub fn place_of(path: &Path) -> PathBuf {
    /// Linux opens no longer path.
    const PATH_MAX: usize = 4096;
    let (mut path, mut links) = (path.to_owned(), 0);
    // The names after the last folder that exists, from the last on.
    let mut rest = Vec::new();
    let mut place = loop {
        let folder = folder_of(&path);
        let is_last = path.parent().is_none() || folder == path || path.as_os_str().len() >= PATH_MAX;
        match path.canonicalize() {
            Ok(place) => break place,
            Err(e) if is_last || Errno::from_io_error(&e) == Some(Errno::LOOP) => break path,
            Err(_) => {}
        }
        path = match fs::read_link(&path).ok().filter(|_| links < MAX_LINKS) {
            Some(to) => {
                links += 1;
                folder.join(to)
            }
            None => {
                rest.push(path.file_name().map(OsString::from));
                folder.to_owned()
            }
        };
    };
    for name in rest.iter().rev() {
        match name {
            Some(name) => place.push(name),
            // It ends in `..`.
            None => drop(place.pop()),
        }
    }
    place
}

/// The regular file that an output path stands for, which may not exist yet. Symbolic links are followed, so that they
/// stay links. `None` for a device, which must not be replaced by a file.
pub(super) fn target_of(path: &Path) -> Result<Option<PathBuf>> {
    check_place(path)?;
    let target = match fs::metadata(path) {
        Ok(meta) if meta.is_dir() => {
            return Err(Error::CannotCreate(format!("{}: cannot write: it is a folder", path.display())));
        }
        Ok(meta) if !meta.is_file() => return Ok(None),
        Ok(_) => path.canonicalize().map_err(|e| cannot_create(path, &e))?,
        Err(e) if e.kind() == ErrorKind::InvalidFilename => return Err(cannot_create(path, &e)),
        Err(_) => followed(path)?,
    };
    if target.file_name().is_none() {
        return Err(Error::CannotCreate(format!("'{}': cannot write: not a file name", path.display())));
    }
    Ok(Some(target))
}

/// The target of a symbolic link whose target may not exist yet.
fn followed(path: &Path) -> Result<PathBuf> {
    let mut target = path.to_owned();
    for _ in 0..MAX_LINKS {
        let Ok(next) = fs::read_link(&target) else { return Ok(target) };
        target = target.parent().unwrap_or(Path::new("")).join(next);
    }
    Err(Error::CannotCreate(format!("{}: cannot write: links lead in a circle", path.display())))
}

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
    /// What the rest of a temporary name takes of the 255 bytes of a name.
    const MOST: usize = 255 - 16;
    let name = target.file_name().unwrap_or_default();
    let mut prefix = OsString::from(".");
    match name.len() <= MOST {
        true => prefix.push(name),
        false => prefix.push(&*blake3::hash(name.as_encoded_bytes()).to_hex()),
    }
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
