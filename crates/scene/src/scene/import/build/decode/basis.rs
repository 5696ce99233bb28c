//! Pictures under KHR_texture_basisu: KTX2 with a Basis Universal payload.

use basisu::{DecodeFlags, TargetFormat, Transcoder};

use super::guarded;

/// Largest number of texels per encoded byte, checked for pictures above [`UNCHECKED_TEXELS`]; no encoder exceeds it.
const MAX_TEXELS_PER_BYTE: u64 = 4096;
const UNCHECKED_TEXELS: u64 = 1 << 20;

/// Width and height in texels, or why the picture cannot be decoded.
pub(crate) fn probe(bytes: &[u8]) -> std::result::Result<(u32, u32), String> {
    let header = |at: usize| bytes.get(at..at + 4)?.try_into().ok().map(u32::from_le_bytes);
    // KTX2, 3.1: vkFormat, which is 0 for Basis Universal; pixelWidth, pixelHeight, pixelDepth, layerCount, faceCount.
    let sizes = [12, 20, 24, 28, 32, 36].map(header);
    let [Some(format), Some(width), Some(height), Some(depth), Some(layers), Some(faces)] = sizes else {
        return Err("a KTX2 picture without a whole header".into());
    };
    if format != 0 {
        return Err(format!("a KTX2 picture in Vulkan's format {format}, not Basis Universal"));
    }
    if depth > 1 || layers > 1 || faces != 1 {
        return Err("a KTX2 picture with layers, faces or depth".into());
    }
    if u64::from(width) * u64::from(height) > UNCHECKED_TEXELS + MAX_TEXELS_PER_BYTE * bytes.len() as u64 {
        return Err(format!("a KTX2 picture of {width}x{height} texels in {} bytes", bytes.len()));
    }
    check_level(bytes, width, height)?;
    Ok((width, height))
}

/// Checks what the first level claims, before a decoder believes it: its unpacked size, and the window of its Zstandard frame,
/// which the decoder keeps in memory (KTX2, 3.9.7; RFC 8878, 3.1.1.1).
fn check_level(bytes: &[u8], width: u32, height: u32) -> std::result::Result<(), String> {
    /// A window that every decoder shall support (RFC 8878, 3.1.1.1.2).
    const USUAL_WINDOW: u64 = 8 << 20;
    const NONE: u64 = 0;
    const BASIS_LZ: u64 = 1;
    const ZSTANDARD: u64 = 2;
    let number = |at: u64, length: usize| {
        let at = usize::try_from(at).ok()?;
        let bytes = bytes.get(at..at.checked_add(length)?)?;
        Some(bytes.iter().rev().fold(0, |all, byte| all << 8 | u64::from(*byte)))
    };
    let [Some(scheme), Some(offset), Some(unpacked)] = [number(44, 4), number(80, 8), number(96, 8)] else {
        return Err("a KTX2 picture without a whole level index".into());
    };
    // Blocks of 4 x 4 texels have 16 bytes.
    let most = 16 * u64::from(width.div_ceil(4)) * u64::from(height.div_ceil(4));
    match scheme {
        NONE | BASIS_LZ => return Ok(()),
        ZSTANDARD => {}
        other => return Err(format!("a KTX2 picture with supercompression scheme {other}, which is not read")),
    }
    if unpacked > most {
        return Err(format!("a KTX2 level of {width}x{height} texels that unpacks to {unpacked} bytes, not {most}"));
    }
    match window_bytes(|at, length| number(offset.checked_add(at)?, length)) {
        Some(window) if window <= most.max(USUAL_WINDOW) => Ok(()),
        Some(window) => Err(format!("a KTX2 level of {most} bytes whose Zstandard window is {window} bytes")),
        None => Err("a KTX2 level without a whole Zstandard header".into()),
    }
}

/// The window of a Zstandard frame in bytes. `number` reads a little-endian number of some bytes at an offset in the frame.
fn window_bytes(number: impl Fn(u64, usize) -> Option<u64>) -> Option<u64> {
    const MAGIC: u64 = 0xFD2F_B528;
    if number(0, 4)? != MAGIC {
        return None;
    }
    let descriptor = number(4, 1)?;
    let is_single_segment = descriptor & 0x20 != 0;
    if !is_single_segment {
        let window = number(5, 1)?;
        let base = 1 << (10 + (window >> 3));
        return Some(base + base / 8 * (window & 7));
    }
    // The window is the content, whose size follows the ID of a dictionary.
    let content = 5 + [0, 1, 2, 4][(descriptor & 3) as usize];
    match descriptor >> 6 {
        0 => number(content, 1),
        1 => Some(number(content, 2)? + 256),
        2 => number(content, 4),
        _ => number(content, 8),
    }
}

/// RGBA texels, row by row from the top; or the reason why the file cannot be decoded, such as a high dynamic range.
pub fn decode(bytes: &[u8]) -> std::result::Result<Vec<u8>, String> {
    guarded(|| {
        let picture = Transcoder::new(bytes).map_err(|e| format!("{e:?}"))?;
        if !picture.supports(TargetFormat::Rgba32) {
            return Err(format!("{:?} is not read", picture.source_format()));
        }
        picture.transcode(0, TargetFormat::Rgba32, DecodeFlags::NONE).map_err(|e| format!("{e:?}"))
    })
    .map_err(|why| format!("the picture is damaged: {why}; export or save it again"))
}
