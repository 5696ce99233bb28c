//! OpenEXR files: films out ([`write()`]), any RGB picture in ([`read()`]).

mod read;
mod write;

use std::borrow::Cow;

pub use read::{Picture, is_decoding, picture, read, read_header, read_statistics};
pub use write::{write, write_rgb};

/// What a header attribute holds.
#[derive(Debug, Clone, PartialEq)]
pub enum HeaderValue {
    /// UTF-8.
    Text(String),
    /// An OpenEXR `double`.
    Number(f64),
}

/// Named header attributes; names are ASCII, under 32 characters.
pub type Header = Vec<(Cow<'static, str>, HeaderValue)>;

/// Name of the part that holds what a render goes on from.
const STATISTICS: &str = "statistics";
/// 32-bit words a row of that part.
const WORDS: usize = 4096;
/// How many bytes of the part count.
const LENGTH: &str = "bismar.bytes";
/// What they hash to (BLAKE3, hexadecimal).
const HASH: &str = "bismar.hash";

/// OpenEXR strings are bytes, UTF-8 by custom.
fn text(s: &str) -> exr::meta::attribute::Text {
    exr::meta::attribute::Text::from_slice_unchecked(s.as_bytes())
}

#[cfg(test)]
mod tests;
