//! What is said about a file's content.

use std::fmt::Display;

use crate::error::Error;

/// A complaint: where (JSON path), what was wanted, what came, what to do.
pub fn bad(at: &str, wanted: impl Display, found: impl Display) -> Error {
    let at = if at.is_empty() { "the document" } else { at };
    Error::Data(format!(
        "{at}: wanted {wanted}, found {found}; this is not valid glTF 2.0: export the file again or ask Khronos' glTF \
         Validator about it"
    ))
}
