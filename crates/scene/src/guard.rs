//! Decoders of others have assertions that broken files reach: a panic of theirs is the file's fault, not a bug of ours.

use std::cell::Cell;
use std::fmt::Display;
use std::panic::{AssertUnwindSafe, catch_unwind};

/// What a decoder makes, or why it makes nothing: in its words, or in these for a panic.
///
/// # Errors
/// Those of the decoder, as text; `panicked`.
pub fn guarded<T, E: Display>(panicked: &str, decode: impl FnOnce() -> Result<T, E>) -> Result<T, String> {
    DECODING.set(true);
    let result = catch_unwind(AssertUnwindSafe(decode));
    DECODING.set(false);
    match result {
        Ok(decoded) => decoded.map_err(|e| e.to_string()),
        Err(_) => Err(panicked.into()),
    }
}

thread_local! {
    static DECODING: Cell<bool> = const { Cell::new(false) };
}

/// Is this thread inside a decoder of others? A panic hook has then nothing to say.
pub fn is_decoding() -> bool {
    DECODING.get()
}
