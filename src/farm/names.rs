//! Names and paths that go to other machines.

use std::path::Path;

use crate::{Error, Result};

/// The path as UTF-8, which plans and templates need as they are JSON.
/// Errors: [`Error::Usage`] for a path that is not UTF-8.
pub fn utf8(path: &Path) -> Result<&str> {
    path.to_str().ok_or_else(|| {
        Error::Usage(format!("{path:?}: not UTF-8, so it cannot be passed to other machines; rename it"))
    })
}

/// Checks a name for control characters.
/// Errors: [`Error::Usage`] if it holds one.
pub fn printable(name: &str) -> Result<()> {
    match name.contains(char::is_control) {
        true => {
            Err(Error::Usage(format!("{name:?}: holds a control character, which is not allowed on a farm; rename it")))
        }
        false => Ok(()),
    }
}
