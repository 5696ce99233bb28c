//! Pictures under KHR_texture_basisu: KTX2 with a Basis Universal payload.

use basisu::{DecodeFlags, TargetFormat, Transcoder};

use super::guarded;

/// Largest number of texels per encoded byte, checked for pictures above [`UNCHECKED_TEXELS`]; no encoder exceeds it.
const MAX_TEXELS_PER_BYTE: u64 = 4096;
const UNCHECKED_TEXELS: u64 = 1 << 20;

/// Width and height in texels, or why the picture cannot be decoded.
pub fn probe(bytes: &[u8]) -> std::result::Result<(u32, u32), String> {
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
    Ok((width, height))
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
