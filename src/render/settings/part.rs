//! Parts of a picture: which tiles belong to which part.

use std::fmt::{self, Display};
use std::str::FromStr;

use serde::{Deserialize, Serialize};

/// Side of a tile in pixels. Tiles lie on the whole picture's grid.
pub const TILE: u32 = 16;

/// Part `number` of `of`, where numbers begin at 1.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct Part {
    /// 1 to `of`.
    pub number: u32,
    /// Number of parts, ≥ 1.
    pub of: u32,
}

impl Display for Part {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(f, "{}/{}", self.number, self.of)
    }
}

impl FromStr for Part {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers = text.split_once('/').and_then(|(k, n)| Some((k.parse().ok()?, n.parse().ok()?)));
        match numbers {
            Some((number, of)) if (1..=of).contains(&number) => Ok(Part { number, of }),
            _ => Err("not K/N with K from 1 to N, as in 3/8".into()),
        }
    }
}

impl Part {
    /// Number of tiles of this part, of `all` tiles.
    pub fn count(self, all: u64) -> u64 {
        (all + u64::from(self.of) - u64::from(self.number)) / u64::from(self.of)
    }

    /// Selects the grid positions of this part's tiles from those of a picture's window. Parts differ by at most one tile
    /// in size and are interleaved along a Z-order curve: neighbours, which have similar costs, are in different parts.
    pub fn select(self, mut all: Vec<[u32; 2]>) -> Vec<[u32; 2]> {
        all.sort_by_cached_key(|position| z_order(*position));
        let own = all.iter().skip(self.number as usize - 1).step_by(self.of as usize);
        let mut positions: Vec<_> = own.copied().collect();
        positions.sort_by_key(|[column, row]| (*row, *column));
        positions
    }
}

/// Grid positions (column, row) of the tiles that a window (x0, y0, x1, y1 in pixels; the last two exclusive) touches, row by
/// row.
pub fn grid_positions([x0, y0, x1, y1]: [u32; 4]) -> impl Iterator<Item = [u32; 2]> {
    (y0 / TILE..y1.div_ceil(TILE)).flat_map(move |row| (x0 / TILE..x1.div_ceil(TILE)).map(move |column| [column, row]))
}

/// The interleaved bits of both coordinates (Morton 1966).
fn z_order([x, y]: [u32; 2]) -> u64 {
    (0..32).fold(0, |code, bit| code | u64::from(x >> bit & 1) << (2 * bit) | u64::from(y >> bit & 1) << (2 * bit + 1))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn every_tile_is_in_one_part_and_parts_are_of_equal_size(
            (width, height, of) in (1u32..400, 1u32..400, 1u32..40), corner in (0u32..100, 0u32..100)
        ) {
            let window = [corner.0.min(width - 1), corner.1.min(height - 1), width, height];
            let all: Vec<_> = grid_positions(window).collect();
            let parts: Vec<_> = (1..=of).map(|number| Part { number, of }.select(all.clone())).collect();
            for (part, number) in parts.iter().zip(1..) {
                prop_assert_eq!(part.len() as u64, Part { number, of }.count(all.len() as u64));
            }
            let sizes = parts.iter().map(Vec::len);
            prop_assert!(sizes.clone().max().unwrap() - sizes.min().unwrap() <= 1);
            let mut joined: Vec<_> = parts.into_iter().flatten().collect();
            joined.sort_by_key(|[column, row]| (*row, *column));
            prop_assert_eq!(joined, all);
        }
    }

    #[test]
    fn parts_are_counted_from_one() {
        assert_eq!("3/8".parse(), Ok(Part { number: 3, of: 8 }));
        for bad in ["", "3", "0/8", "9/8", "-1/2", "1/0", "a/b", "1/2/3"] {
            assert!(bad.parse::<Part>().is_err(), "{bad}");
        }
    }
}
