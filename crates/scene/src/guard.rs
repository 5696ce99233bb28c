//! Panics of third-party decoders. Broken files can trip their assertions, which is an error of the file, not a bug.

use std::cell::Cell;
use std::fmt::Display;
use std::panic::{AssertUnwindSafe, catch_unwind};

/// Runs a decoder and catches its panics.
///
/// # Errors
/// The error of the decoder as text, or `panicked` if it panics.
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

/// Whether this thread runs a third-party decoder. A panic hook should then print nothing.
pub fn is_decoding() -> bool {
    DECODING.get()
}
