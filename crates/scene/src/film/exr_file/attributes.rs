//! Names of our header attributes.

/// The attribute with the length of the statistics in bytes: the last bytes of the file.
pub(super) const LENGTH: &str = "bismar.bytes";
/// The attribute with their BLAKE3 hash, hexadecimal.
pub(super) const HASH: &str = "bismar.hash";

/// The attribute with the primaries of the variance, where they are not the picture's.
pub(super) const VARIANCE: &str = "bismar.variance";

/// An OpenEXR string: bytes, UTF-8 by convention.
pub(super) fn text(s: &str) -> exr::meta::attribute::Text {
    exr::meta::attribute::Text::from_slice_unchecked(s.as_bytes())
}

/// The text of an attribute or name. OpenEXR's texts are bytes, and UTF-8 by its documentation; others are read as Latin-1.
pub(super) fn string(text: &exr::meta::attribute::Text) -> String {
    String::from_utf8(text.as_slice().to_vec()).unwrap_or_else(|_| text.to_string())
}
