//! Errors about a file's content.

use std::fmt::Display;

use crate::error::Error;

/// An error that says where (JSON path), what was expected, what was found, and what to do.
pub fn bad(at: &str, wanted: impl Display, found: impl Display) -> Error {
    let at = if at.is_empty() { "the document" } else { at };
    Error::Data(format!(
        "{at}: expected {wanted}, found {found}; this is not valid glTF 2.0: export the file again or check it with Khronos' \
         glTF Validator"
    ))
}
