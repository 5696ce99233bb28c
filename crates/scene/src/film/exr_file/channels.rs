//! Every channel of a picture to the bit, for comparisons.

use exr::meta::attribute::SampleType;
use exr::prelude::*;

use super::attributes::string;
use super::read::{cannot_use, checked, each_block, each_sample, guarded, invalid};
use crate::Result as Outcome;

/// A channel's name and its samples row by row, as bits; those of 16-bit floats are in the lower half.
pub type ChannelBits = (String, Vec<u32>);

/// All channels of a file's first part, in the order of the file. The content of the file is not trusted.
///
/// # Errors
/// Those of [`read()`](super::read()).
pub fn read_bits(path: &std::path::Path) -> Outcome<Vec<ChannelBits>> {
    let bytes = super::bytes_of(path)?;
    guarded(|| bits(&bytes)).map_err(|why| cannot_use(path, &why))
}

fn bits(bytes: &[u8]) -> Result<Vec<ChannelBits>> {
    let chunks = checked(bytes)?;
    let header = chunks.headers().first().cloned().ok_or_else(|| invalid("it has no part"))?;
    if header.deep || header.channels.list.iter().any(|channel| channel.sampling != Vec2(1, 1)) {
        return Err(invalid("it has deep or subsampled channels"));
    }
    let Vec2(width, height) = header.layer_size;
    let new = |channel: &ChannelDescription| (string(&channel.name), vec![0; width * height]);
    let mut channels: Vec<ChannelBits> = header.channels.list.iter().map(new).collect();
    each_block(chunks, 0, |block| {
        for line in block.lines(&header.channels) {
            let (channel, Vec2(x, y)) = (line.location.channel, line.location.position);
            let start = y * width + x;
            let row = channels[channel].1.get_mut(start..start + line.location.sample_count);
            let row = row.ok_or_else(|| invalid("a block out of bounds"))?;
            let put = |i: usize, bits| row[i] = bits;
            match header.channels.list[channel].sample_type {
                SampleType::F16 => each_sample(&line, |x: f16| x.to_bits().into(), put),
                SampleType::F32 => each_sample(&line, f32::to_bits, put),
                SampleType::U32 => each_sample(&line, |x: u32| x, put),
            }?;
        }
        Ok(())
    })?;
    Ok(channels)
}
