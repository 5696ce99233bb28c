//! A window's pixels where they were collected: in tiles.

use super::RenderSettings;
use super::tile::{TILE, Tile};
use crate::film::{AovSums, Background, ExtraSums, PixelStats, Pixels};

/// The window's pixels, read from tiles. Where no tile is, nothing was sampled.
pub struct TilePixels<'a> {
    size: [u32; 2],
    window: [u32; 4],
    aovs: bool,
    extras: bool,
    background: Background,
    /// Tiles a row of `tiles`.
    columns: u32,
    /// Row by row, all that the window touches.
    tiles: Vec<Option<&'a Tile>>,
}

impl<'a> TilePixels<'a> {
    /// Of tiles of a picture of these settings, in any order, with this behind everything.
    pub fn new(tiles: &'a [Tile], settings: &RenderSettings, background: Background) -> Self {
        let window @ [x0, y0, x1, y1] = settings.window();
        let (columns, rows) = (x1.div_ceil(TILE) - x0 / TILE, y1.div_ceil(TILE) - y0 / TILE);
        let mut grid = vec![None; (columns * rows) as usize];
        for tile in tiles {
            let [x, y] = tile.grid_position();
            grid[((y - y0 / TILE) * columns + (x - x0 / TILE)) as usize] = Some(tile);
        }
        let (size, aovs, extras) = ([settings.width, settings.height], settings.aovs, settings.extras);
        Self { size, window, aovs, extras, background, columns, tiles: grid }
    }
}

impl TilePixels<'_> {
    /// The tile of a pixel, and the pixel's place in it.
    fn place(&self, x: u32, y: u32) -> Option<(&Tile, usize)> {
        let [x0, y0, ..] = self.window;
        let (column, row) = (x / TILE, y / TILE);
        let tile = self.tiles[((row - y0 / TILE) * self.columns + (column - x0 / TILE)) as usize]?;
        let width = TILE.min(self.size[0] - column * TILE);
        Some((tile, ((y % TILE) * width + x % TILE) as usize))
    }
}

impl Pixels for TilePixels<'_> {
    fn size(&self) -> [u32; 2] {
        self.size
    }

    fn window(&self) -> [u32; 4] {
        self.window
    }

    fn has_aovs(&self) -> bool {
        self.aovs
    }

    fn extras(&self, x: u32, y: u32) -> Option<ExtraSums> {
        let no_tile = self.extras.then(ExtraSums::default);
        self.place(x, y).map_or(no_tile, |(tile, i)| tile.extras.get(i).copied())
    }

    fn background(&self) -> Background {
        self.background
    }

    fn at(&self, x: u32, y: u32) -> (PixelStats, AovSums) {
        self.place(x, y).map_or((PixelStats::EMPTY, AovSums::default()), |(tile, i)| tile.at(i))
    }
}
