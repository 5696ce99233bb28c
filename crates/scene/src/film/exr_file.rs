//! OpenEXR files: films out ([`write()`]), any RGB picture in ([`read()`]).

mod bounds;
mod checksum;
mod head;
mod read;
mod write;

use std::borrow::Cow;

pub use checksum::{CHECKSUM, Checksum, check, checksum};
pub use read::{bytes_of, layer, picture, read, read_header, read_statistics};
pub use write::{Layers, write, write_rgb};

/// What a header attribute holds.
#[derive(Debug, Clone, PartialEq)]
pub enum HeaderValue {
    /// UTF-8.
    Text(String),
    /// An OpenEXR `double`.
    Number(f64),
    /// A matrix for row vectors, row by row: of [`WORLD_TO_CAMERA`] and [`WORLD_TO_NDC`] alone.
    Matrix([f32; 16]),
}

/// The attribute that takes points of the world to the camera's space: x to the right, y up, z along the view.
pub const WORLD_TO_CAMERA: &str = "worldToCamera";
/// The attribute that takes points of the world to the display window: (0, 0) is its upper left corner, (1, 1) its lower
/// right one, after division by w; z has no meaning.
pub const WORLD_TO_NDC: &str = "worldToNDC";

/// Named header attributes; names are ASCII, under 32 characters.
pub type Header = Vec<(Cow<'static, str>, HeaderValue)>;

/// In files before format 4, the name of the part that holds what a render goes on from.
const STATISTICS: &str = "statistics";
/// 32-bit words a row of that part.
const WORDS: usize = 4096;
/// How many bytes of statistics there are: the last ones of the file, or those of the part that count.
const LENGTH: &str = "bismar.bytes";
/// What they hash to (BLAKE3, hexadecimal).
const HASH: &str = "bismar.hash";

/// OpenEXR strings are bytes, UTF-8 by custom.
fn text(s: &str) -> exr::meta::attribute::Text {
    exr::meta::attribute::Text::from_slice_unchecked(s.as_bytes())
}

#[cfg(test)]
mod hostile;
#[cfg(test)]
mod tests;
