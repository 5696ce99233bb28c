//! Limits for OpenEXR files, checked before decoding: memory and time in proportion to the file's size.

use exr::block::chunk::{Chunk, CompressedBlock};
use exr::compression::Compression;
use exr::math::Vec2;
use exr::meta::header::Header;

/// An error says why a file is refused, as a part of a sentence.
type Checked = Result<(), String>;

/// Size in bytes that the decoded picture of any file may have.
const BASE_BYTES: u64 = 1 << 30;
/// Additional bytes of the decoded picture per byte of the file. Flat colours compress a thousandfold, but large pictures are
/// rarely flat.
const DECODED_PER_BYTE: u64 = 64;
/// Bytes of a decoded pixel: three floats and their variances.
const BYTES_PER_PIXEL: u64 = 24;
/// Largest number of channels of a part: the decoder of DWA compares the name of each with all others.
const MAX_CHANNELS: usize = 1024;

/// Checks the sizes and counts of a part of a file with `file_bytes` bytes.
pub fn check(header: &Header, file_bytes: u64) -> Checked {
    let Vec2(width, height) = header.layer_size;
    let size = |bytes: u64| format!("it says {width} x {height} pixels but has only {bytes} bytes");
    let area = |Vec2(w, h): Vec2<usize>| (w as u64).checked_mul(h as u64);
    let stored = header.channels.bytes_per_pixel as u64;
    if header.channels.list.len() > MAX_CHANNELS {
        return Err(format!("it has {} channels: at most {MAX_CHANNELS} are read", header.channels.list.len()));
    }
    if (header.chunk_count as u64).checked_mul(8).is_none_or(|table| table > file_bytes) {
        return Err(format!("it says {} blocks but has only {file_bytes} bytes", header.chunk_count));
    }
    let more = file_bytes.saturating_mul(DECODED_PER_BYTE);
    let Vec2(block_width, block_height) = header.max_block_pixel_size();
    let block = area(Vec2(block_width.min(width), block_height.min(height)));
    let fits = |pixels: Option<u64>, pixel_bytes: u64, max: u64| {
        pixels.and_then(|pixels| pixels.checked_mul(pixel_bytes)).is_some_and(|bytes| bytes <= max.saturating_add(more))
    };
    let all = area(header.layer_size);
    // The decoded picture; all unpacked data, which costs time; a block, which is in memory at once; and a whole block's bytes,
    // for which the decoder allocates memory before it checks that the file has them.
    let fits = fits(all, BYTES_PER_PIXEL, BASE_BYTES)
        && fits(all, stored, 2 * BASE_BYTES)
        && fits(block, stored, BASE_BYTES / 4)
        && fits(area(header.max_block_pixel_size()), stored, BASE_BYTES / 8);
    if fits { Ok(()) } else { Err(size(file_bytes)) }
}

/// Largest compression ratio: deflate's 1032, times 4/3 by PXR24.
const MAX_COMPRESSION: usize = 1400;

/// Checks that a block can hold its pixels, and the byte counts at the start of a DWA block, for which the decoder allocates
/// memory.
pub(crate) fn check_block(chunk: &Chunk, header: &Header) -> Checked {
    let packed = match &chunk.compressed_block {
        CompressedBlock::ScanLine(block) => &block.compressed_pixels_le,
        CompressedBlock::Tile(block) => &block.compressed_pixels_le,
        _ => return Ok(()),
    };
    let tile = header.get_block_data_indices(&chunk.compressed_block);
    let pixels = tile.and_then(|tile| header.get_absolute_block_pixel_coordinates(tile)).map_err(|e| e.to_string())?;
    let Vec2(width, height) = pixels.size;
    let unpacked = width.saturating_mul(height).saturating_mul(header.channels.bytes_per_pixel);
    // Data that compression does not make smaller is stored uncompressed.
    if packed.len() == unpacked {
        return Ok(());
    }
    let too_little = || Err("a block of it holds too little for its pixels".into());
    if !matches!(header.compression, Compression::DWAA(_) | Compression::DWAB(_)) {
        return if unpacked / MAX_COMPRESSION <= packed.len() { Ok(()) } else { too_little() };
    }
    // Whole blocks of 8 x 8 with twice four bytes per sample: no section of a valid block is larger.
    let samples = (width.next_multiple_of(8) * height.next_multiple_of(8)) as u64;
    let max = samples.saturating_mul(8 * header.channels.list.len() as u64);
    let counter = |i: usize| packed.get(8 * i..8 * i + 8).map(|b| u64::from_le_bytes(b.try_into().unwrap_or_default()));
    // Counts of unknown channels, of run lengths, of their bytes, and of 16-bit coefficients.
    let counts = [(1, 1), (6, 1), (7, 1), (8, 2), (9, 2)];
    let fits = |(i, bytes): (usize, u64)| counter(i).is_none_or(|n| n.checked_mul(bytes).is_some_and(|n| n <= max));
    if !counts.into_iter().all(fits) {
        return Err("a block of it claims more than it can hold".into());
    }
    // The rest is in blocks of 8 x 8 samples, each with a coefficient in the last section.
    let [unknown, runs, blocks] = [1, 7, 9].map(|i| counter(i).unwrap_or_default());
    if unknown + runs + blocks * 64 * 4 < unpacked as u64 { too_little() } else { Ok(()) }
}
