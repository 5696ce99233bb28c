//! The sequence dimensions of every random decision of a path, in sets of four. A set belongs to one use: two uses of the same
//! numbers would be correlated.
//!
//! [`samples`](crate::sampling::samples) are stratified, [`keys`](crate::sampling::keys) are not; the two do not share numbers.

/// Path segments that a path has at most, all counted, so that the sets of all depths are disjoint.
pub const MAX_SEGMENTS: u32 = (1 << 15) - 1;

/// Position in the pixel filter and on the lens; the key of camera rays.
pub const CAMERA: u32 = 0;
/// Time in the shutter interval.
pub(crate) const TIME: u32 = u32::MAX - 1;
/// Colour channel of a path that meets a dispersive surface.
pub const CHANNEL: u32 = u32::MAX;

/// Light samples at a depth (0 for the first surface), and the keys of their shadow rays.
#[inline]
pub fn light(depth: u32) -> u32 {
    1 + 2 * depth
}

/// BSDF samples at a depth, and the keys of their rays.
#[inline]
pub fn bsdf(depth: u32) -> u32 {
    2 + 2 * depth
}

/// Keys of the roulette of light samples at a depth.
#[inline]
pub fn roulette(depth: u32) -> u32 {
    (1 << 30) + depth
}

/// Keys of the pools of path re-use.
pub(crate) const REUSE: u32 = u32::MAX - 2;

/// Sets of a ray's choices at thin walls.
const WALL_SETS: u32 = 64;
/// Choices of a ray at thin walls.
pub const MAX_WALLS: u32 = 4 * WALL_SETS;

/// Choice number `wall` (below [`MAX_WALLS`]) at thin walls of rays at a depth: the set, and the dimension in it.
#[inline]
pub fn wall(depth: u32, wall: u32) -> (u32, usize) {
    ((1 << 16) + depth * WALL_SETS + wall / 4, wall as usize % 4)
}

/// Where light samples are allocated to targets, those of area lights begin at this index of their pixel's sequence.
pub(crate) const AREA_LIGHT_INDEX: u32 = 1 << 31;

#[cfg(test)]
mod tests {
    use std::collections::HashSet;

    use super::*;

    #[test]
    fn no_two_uses_share_numbers() {
        let depths = || 0..MAX_SEGMENTS;
        let walls = || depths().flat_map(|depth| (0..MAX_WALLS).map(move |n| wall(depth, n)));
        assert_eq!(walls().collect::<HashSet<_>>().len() as u32, MAX_SEGMENTS * MAX_WALLS);
        let wall_sets: HashSet<_> = walls().map(|(set, _)| set).collect();
        let samples = depths().flat_map(|depth| [light(depth), bsdf(depth)]).chain([CAMERA, TIME, CHANNEL]);
        let samples: Vec<_> = samples.chain(wall_sets).collect();
        let keys: Vec<_> = depths().flat_map(|depth| [light(depth), bsdf(depth), roulette(depth)]).collect();
        for sets in [samples, [keys, vec![CAMERA, REUSE]].concat()] {
            assert_eq!(sets.iter().collect::<HashSet<_>>().len(), sets.len());
        }
    }
}
