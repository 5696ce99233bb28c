//! Names of our header attributes.

/// The attribute with the length of the statistics in bytes: the last bytes of the file.
pub(super) const LENGTH: &str = "bismar.bytes";
/// The attribute with their BLAKE3 hash, hexadecimal.
pub(super) const HASH: &str = "bismar.hash";

/// An OpenEXR string: bytes, UTF-8 by convention.
pub(super) fn text(s: &str) -> exr::meta::attribute::Text {
    exr::meta::attribute::Text::from_slice_unchecked(s.as_bytes())
}
