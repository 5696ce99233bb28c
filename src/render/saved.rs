//! What a render needs to go on: its tiles and what they took, as bytes and back.

use rayon::prelude::*;
use serde::de::DeserializeOwned;

use super::tile::{Columns, Tile, Tile2};
use super::{RenderSettings, RenderStats, paths_range};
use crate::{Error, Result};

/// A render that can go on.
#[derive(Debug)]
pub struct Saved {
    /// Row by row.
    pub tiles: Vec<Tile>,
    /// Over all sessions so far.
    pub stats: RenderStats,
}

impl Saved {
    /// Has it taken the passes that a render of these settings begins with? Then it ends with the same bits. Else its
    /// passes were cut by another goal or by time: the picture is as right, but another one.
    pub fn is_on_the_way(&self, settings: &RenderSettings) -> bool {
        let (done, ahead) = paths_range(&self.tiles);
        let (mut paths, mut passes) = (0, 0);
        while paths < ahead {
            let Some(pass) = settings.balance.method().next_pass(paths, settings.spp, settings.pilot) else {
                return false;
            };
            if paths == done && passes == self.stats.passes {
                // The pass that is half-way.
                return done + pass == ahead;
            }
            (paths, passes) = (paths + pass, passes + 1);
        }
        (paths, passes) == (done, self.stats.passes)
    }
}

/// Raised whenever tiles saved by an older version can no longer be read.
pub const FORMAT: u32 = 3;

/// Bytes of a tile, unpacked, at most.
const LARGEST: usize = 1 << 24;

/// Tiles as bytes: for each its length (32 bits, little-endian) and itself (postcard in LZ4, which is faster than a disk
/// and leaves out what is zero).
///
/// # Errors
/// [`Error::Bug`] if a tile cannot be said.
pub fn pack(tiles: &[Tile]) -> Result<Vec<u8>> {
    let records = tiles.par_iter().map(|tile| Ok(lz4_flex::compress_prepend_size(&postcard::to_stdvec(tile)?)));
    let records: std::result::Result<Vec<_>, postcard::Error> = records.collect();
    let records = records.map_err(|e| Error::Bug(format!("a tile cannot be saved: {e}")))?;
    let mut bytes = Vec::with_capacity(records.iter().map(|r| 4 + r.len()).sum());
    for record in records {
        bytes.extend((record.len() as u32).to_le_bytes());
        bytes.extend(record);
    }
    Ok(bytes)
}

/// Reads what [`pack`] made; nothing in it is trusted. `None` if it is not that.
pub fn unpack(bytes: &[u8]) -> Option<Vec<Tile>> {
    records(bytes)
}

/// Reads what `pack` of format 2 made, and keeps the columns that such a render has.
pub fn unpack_2(bytes: &[u8], columns: Columns) -> Option<Vec<Tile>> {
    Some(records::<Tile2>(bytes)?.into_iter().map(|tile| tile.into_tile(columns)).collect())
}

fn records<T: DeserializeOwned + Send>(bytes: &[u8]) -> Option<Vec<T>> {
    let mut records = Vec::new();
    let mut rest = bytes;
    while let Some((length, after)) = rest.split_first_chunk::<4>() {
        let (record, after) = after.split_at_checked(u32::from_le_bytes(*length) as usize)?;
        records.push(record);
        rest = after;
    }
    if !rest.is_empty() {
        return None;
    }
    let read = |record: &&[u8]| {
        let (size, packed) = lz4_flex::block::uncompressed_size(record).ok().filter(|(size, _)| *size <= LARGEST)?;
        let record = lz4_flex::decompress(packed, size).ok()?;
        match postcard::take_from_bytes::<T>(&record) {
            Ok((tile, [])) => Some(tile),
            _ => None,
        }
    };
    records.par_iter().map(read).collect()
}

/// Are these the tiles that a render begins with, each whole, and no two more than a pass apart?
pub fn fits(saved: &[Tile], fresh: &[Tile]) -> bool {
    let paths = saved.iter().map(Tile::paths);
    let (low, high) = (paths.clone().min(), paths.clone().max());
    saved.len() == fresh.len()
        && saved.iter().zip(fresh).all(|(a, b)| a.covers(b))
        && paths.into_iter().all(|n| Some(n) == low || Some(n) == high)
}

#[cfg(test)]
mod tests {
    use super::*;

    const BOTH: Columns = Columns { moments: true, aovs: true };

    #[test]
    fn tiles_come_back_and_anything_else_does_not() {
        let mut tiles = Tile::cover(40, 20, [0, 0, 40, 20], BOTH);
        tiles[1].stats[3].sum = [0.1, -0.0, f64::NAN];
        let bytes = pack(&tiles).unwrap();
        let again = unpack(&bytes).unwrap();
        assert_eq!(pack(&again).unwrap(), bytes);
        assert!(fits(&again, &Tile::cover(40, 20, [0, 0, 40, 20], BOTH)));
        assert!(!fits(&again, &Tile::cover(40, 21, [0, 0, 40, 21], BOTH)));
        for cut in [1, 3, 4, bytes.len() / 2, bytes.len() - 1] {
            assert!(unpack(&bytes[..cut]).is_none(), "{cut}");
        }
        let mut longer = bytes.clone();
        longer.extend([1, 0, 0, 0, 7]);
        assert!(unpack(&longer).is_none());
    }
}
