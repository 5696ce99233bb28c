//! Names of our attributes and parts.

/// Name of the part with the statistics of a render, in files before format 4.
pub(super) const STATISTICS: &str = "statistics";
/// Width of this part in 32-bit words.
pub(super) const WORDS: usize = 4096;
/// The attribute with the length of the statistics in bytes: the last bytes of the file, or the first ones of the part.
pub(super) const LENGTH: &str = "bismar.bytes";
/// The attribute with their BLAKE3 hash, hexadecimal.
pub(super) const HASH: &str = "bismar.hash";

/// An OpenEXR string: bytes, UTF-8 by convention.
pub(super) fn text(s: &str) -> exr::meta::attribute::Text {
    exr::meta::attribute::Text::from_slice_unchecked(s.as_bytes())
}
