//! Which pixels are measured: whole tiles of a large picture, spread evenly over its view.
//!
//! In a small picture of a whole scene nearly every pixel has an edge in it, and where in the pixel a path goes rules its
//! variance. What is rendered in earnest has small pixels, and neighbours alike. Tiles are rendered as in the whole
//! picture, to the bit.

use std::sync::Arc;

use bismar::render::{pass::tile::Tile, settings::part::TILE};
use bismar::{Error, Result};

/// Tiles of a picture, side by side.
#[derive(Debug, Clone)]
pub struct Mosaic {
    /// Measured pixels a row, and rows.
    pub size: [u32; 2],
    /// Size of the picture that they are of.
    pub picture: [u32; 2],
    /// The tiles' places in the picture's grid, row by row of the mosaic.
    pub tiles: Arc<[[u32; 2]]>,
}

impl Mosaic {
    /// Selects tiles of a picture of size `footprint` that cover `size` pixels; without `footprint`, a picture of `size`.
    pub fn new(size: [u32; 2], footprint: Option<[u32; 2]>) -> Result<Self> {
        let picture = footprint.unwrap_or(size);
        let columns = size.map(|n| n.div_ceil(TILE));
        // Tiles at the picture's far edges may be narrower: they are measured in a whole picture alone.
        let there = [0, 1].map(|i| if picture == size { columns[i] } else { picture[i] / TILE });
        if there[0] < columns[0] || there[1] < columns[1] {
            let [[w, h], [pw, ph]] = [size, picture];
            return Err(Error::Usage(format!(
                "a picture of {pw}x{ph} has fewer tiles of {TILE}x{TILE} pixels than --size {w}x{h}: give a larger --footprint, \
                 or none to measure a picture of {w}x{h}"
            )));
        }
        // The middles of as many equal stretches.
        let nth = |n: u32, axis: usize| (2 * n + 1) * there[axis] / (2 * columns[axis]);
        let rows = (0..columns[1]).flat_map(|row| (0..columns[0]).map(move |column| [column, row]));
        let tiles = rows.map(|[column, row]| [nth(column, 0), nth(row, 1)]).collect();
        Ok(Self { size, picture, tiles })
    }

    pub fn pixels(&self) -> usize {
        (self.size[0] * self.size[1]) as usize
    }

    pub fn is_whole(&self) -> bool {
        self.size == self.picture
    }

    pub fn middle(&self) -> usize {
        let columns = self.columns() as usize;
        let rows = self.tiles.len() / columns;
        rows / 2 * columns + columns / 2
    }

    fn columns(&self) -> u32 {
        self.size[0].div_ceil(TILE)
    }

    /// Indices of the measured pixels of tile `number`, row by row: in the mosaic, and in the tile.
    pub(crate) fn pixels_of(&self, number: usize) -> impl Iterator<Item = (usize, usize)> {
        let ([width, height], tile) = (self.size, number as u32);
        let (x0, y0) = (tile % self.columns() * TILE, tile / self.columns() * TILE);
        let side = TILE.min(self.picture[0] - self.tiles[number][0] * TILE);
        let (x1, y1) = ((x0 + TILE).min(width), (y0 + TILE).min(height));
        (y0..y1)
            .flat_map(move |y| (x0..x1).map(move |x| ((y * width + x) as usize, ((y - y0) * side + x - x0) as usize)))
    }

    /// Coordinates of a measured pixel in the picture.
    pub fn coordinates(&self, pixel: usize) -> [u32; 2] {
        let [x, y] = [pixel as u32 % self.size[0], pixel as u32 / self.size[0]];
        let [column, row] = self.tiles[(y / TILE * self.columns() + x / TILE) as usize];
        [column * TILE + x % TILE, row * TILE + y % TILE]
    }

    /// Applies `of` to each measured pixel of some tiles, given by their numbers in the mosaic, in the order of
    /// `tiles`; the default elsewhere. `of` takes a tile and a pixel's index in it.
    pub fn gather<T: Clone + Default>(
        &self,
        numbers: impl Iterator<Item = usize>,
        tiles: &[Tile],
        of: impl Fn(&Tile, usize) -> T,
    ) -> Vec<T> {
        let mut all = vec![T::default(); self.pixels()];
        for (number, tile) in numbers.zip(tiles) {
            self.pixels_of(number).for_each(|(at, in_tile)| all[at] = of(tile, in_tile));
        }
        all
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tiles_are_whole_and_spread_over_the_view() {
        let mosaic = Mosaic::new([40, 32], Some([1920, 1080])).unwrap();
        assert_eq!(*mosaic.tiles, [[20, 16], [60, 16], [100, 16], [20, 50], [60, 50], [100, 50]]);
        assert!(!mosaic.is_whole() && mosaic.middle() == 4);
        assert_eq!(mosaic.coordinates(0), [320, 256]);
        assert_eq!(mosaic.coordinates(17 * 40 + 33), [1600 + 1, 800 + 1]);
        // The last tile is cut off by the mosaic's edge, not narrower itself.
        let places = mosaic.pixels_of(2).collect::<Vec<_>>();
        assert_eq!((places.len(), places[8]), (8 * 16, (40 + 32, 16)));
        let mut seen = vec![0; mosaic.pixels()];
        (0..6).flat_map(|tile| mosaic.pixels_of(tile)).for_each(|(at, _)| seen[at] += 1);
        assert!(seen.iter().all(|n| *n == 1));
    }

    #[test]
    fn a_picture_of_the_size_itself_is_whole() {
        for footprint in [None, Some([40, 20])] {
            let mosaic = Mosaic::new([40, 20], footprint).unwrap();
            assert_eq!(*mosaic.tiles, [[0, 0], [1, 0], [2, 0], [0, 1], [1, 1], [2, 1]]);
            assert!(mosaic.is_whole());
            // The last tile is 8 pixels wide and 4 high.
            assert_eq!(mosaic.pixels_of(5).last(), Some((40 * 20 - 1, 4 * 8 - 1)));
            assert!((0..800).all(|pixel| mosaic.coordinates(pixel) == [pixel as u32 % 40, pixel as u32 / 40]));
        }
        let error = Mosaic::new([64, 64], Some([63, 100])).unwrap_err();
        assert!(error.to_string().contains("--footprint"), "{error}");
    }
}
