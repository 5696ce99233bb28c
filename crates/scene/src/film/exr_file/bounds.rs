//! What an OpenEXR file may ask for before anything of it is decoded: memory and time in proportion to its bytes.

use exr::block::chunk::{Chunk, CompressedBlock};
use exr::compression::Compression;
use exr::math::Vec2;
use exr::meta::header::Header;

/// Why a file is refused, as a part of a sentence.
type Checked = Result<(), String>;

/// Bytes of a decoded picture that any file may have, and how many more for each byte of its own: flat colours are
/// packed a thousandfold, but large pictures are seldom flat.
const FREE: u64 = 1 << 30;
const A_BYTE: u64 = 64;
/// Of a pixel, once it is decoded: three floats and their variances.
const A_PIXEL: u64 = 24;
/// Most channels of a part: the decoder of DWA compares the name of each with all others.
const MOST_CHANNELS: usize = 1024;

/// Checks sizes and counts of a part of a file of so many bytes.
pub fn check(header: &Header, file_bytes: u64) -> Checked {
    let Vec2(width, height) = header.layer_size;
    let size = |bytes: u64| format!("it says {width} x {height} pixels but has only {bytes} bytes");
    let area = |Vec2(w, h): Vec2<usize>| (w as u64).checked_mul(h as u64);
    let a_pixel = header.channels.bytes_per_pixel as u64;
    if header.channels.list.len() > MOST_CHANNELS {
        return Err(format!("it has {} channels: at most {MOST_CHANNELS} are read", header.channels.list.len()));
    }
    if (header.chunk_count as u64).checked_mul(8).is_none_or(|table| table > file_bytes) {
        return Err(format!("it says {} blocks but has only {file_bytes} bytes", header.chunk_count));
    }
    let more = file_bytes.saturating_mul(A_BYTE);
    let Vec2(block_width, block_height) = header.max_block_pixel_size();
    let block = area(Vec2(block_width.min(width), block_height.min(height)));
    let fits = |pixels: Option<u64>, a_pixel: u64, most: u64| {
        pixels.and_then(|pixels| pixels.checked_mul(a_pixel)).is_some_and(|bytes| bytes <= most.saturating_add(more))
    };
    let all = area(header.layer_size);
    // The picture, what is unpacked in all, which costs time, and a block, which is there at once; and as many bytes as a
    // whole block has may be wanted of the file, for which the decoder takes memory before it looks whether they are there.
    let fits = fits(all, A_PIXEL, FREE)
        && fits(all, a_pixel, 2 * FREE)
        && fits(block, a_pixel, FREE / 4)
        && fits(area(header.max_block_pixel_size()), a_pixel, FREE / 8);
    if fits { Ok(()) } else { Err(size(file_bytes)) }
}

/// Bytes that one packed byte stands for at most: deflate's 1032, of which PXR24 makes four of three.
const MOST_PACKED: usize = 1400;

/// Checks that a block can hold its pixels, and what it says of itself: one packed by DWA begins with counts of bytes, and
/// the decoder takes memory for as many.
pub fn check_block(chunk: &Chunk, header: &Header) -> Checked {
    let packed = match &chunk.compressed_block {
        CompressedBlock::ScanLine(block) => &block.compressed_pixels_le,
        CompressedBlock::Tile(block) => &block.compressed_pixels_le,
        _ => return Ok(()),
    };
    let place = header.get_block_data_indices(&chunk.compressed_block);
    let place = place.and_then(|tile| header.get_absolute_block_pixel_coordinates(tile)).map_err(|e| e.to_string())?;
    let Vec2(width, height) = place.size;
    let unpacked = width.saturating_mul(height).saturating_mul(header.channels.bytes_per_pixel);
    // What packing would not have made smaller is there as it is.
    if packed.len() == unpacked {
        return Ok(());
    }
    let too_little = || Err("a block of it holds too little for its pixels".into());
    if !matches!(header.compression, Compression::DWAA(_) | Compression::DWAB(_)) {
        return if unpacked / MOST_PACKED <= packed.len() { Ok(()) } else { too_little() };
    }
    // Whole blocks of 8 x 8, twice four bytes a sample: no section of an honest block is larger.
    let samples = (width.next_multiple_of(8) * height.next_multiple_of(8)) as u64;
    let most = samples.saturating_mul(8 * header.channels.list.len() as u64);
    let counter = |i: usize| packed.get(8 * i..8 * i + 8).map(|b| u64::from_le_bytes(b.try_into().unwrap_or_default()));
    // Of what is in no known channel, of run lengths, of their bytes, and of 16-bit coefficients.
    let counts = [(1, 1), (6, 1), (7, 1), (8, 2), (9, 2)];
    let fits = |(i, bytes): (usize, u64)| counter(i).is_none_or(|n| n.checked_mul(bytes).is_some_and(|n| n <= most));
    if !counts.into_iter().all(fits) {
        return Err("a block of it claims more than it can hold".into());
    }
    // What is not in these sections is in blocks of 8 x 8 samples, each of which has a coefficient in the last one.
    let [unknown, runs, blocks] = [1, 7, 9].map(|i| counter(i).unwrap_or_default());
    if unknown + runs + blocks * 64 * 4 < unpacked as u64 { too_little() } else { Ok(()) }
}
