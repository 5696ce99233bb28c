//! The pixels of a window, read from tiles.

use std::borrow::Cow;

use super::tile::Tile;
use crate::film::{AovSums, Background, ExtraSums, PixelStats, Pixels};
use crate::render::settings::RenderSettings;
use crate::render::settings::light_groups::LightGroups;
use crate::render::settings::part::TILE;

/// The window's pixels, read from tiles. Pixels without a tile have no samples.
pub struct TilePixels<'a> {
    settings: &'a RenderSettings,
    background: Background,
    /// Tiles per row of `tiles`.
    columns: u32,
    /// The tiles that the window touches, row by row.
    tiles: Vec<Option<&'a Tile>>,
}

impl<'a> TilePixels<'a> {
    /// The pixels of tiles of a render with these settings, in any order.
    pub fn new(tiles: &'a [Tile], settings: &'a RenderSettings, background: Background) -> Self {
        let [x0, y0, x1, y1] = settings.window();
        let (columns, rows) = (x1.div_ceil(TILE) - x0 / TILE, y1.div_ceil(TILE) - y0 / TILE);
        let mut grid = vec![None; (columns * rows) as usize];
        for tile in tiles {
            let [x, y] = tile.grid_position();
            grid[((y - y0 / TILE) * columns + (x - x0 / TILE)) as usize] = Some(tile);
        }
        Self { settings, background, columns, tiles: grid }
    }
}

impl TilePixels<'_> {
    /// The tile of a pixel, and the pixel's index in it.
    fn locate(&self, x: u32, y: u32) -> Option<(&Tile, usize)> {
        let [x0, y0, ..] = self.window();
        let (column, row) = (x / TILE, y / TILE);
        let tile = self.tiles[((row - y0 / TILE) * self.columns + (column - x0 / TILE)) as usize]?;
        let width = TILE.min(self.settings.width - column * TILE);
        Some((tile, ((y % TILE) * width + x % TILE) as usize))
    }
}

impl Pixels for TilePixels<'_> {
    fn size(&self) -> [u32; 2] {
        [self.settings.width, self.settings.height]
    }

    fn window(&self) -> [u32; 4] {
        self.settings.window()
    }

    fn has_aovs(&self) -> bool {
        self.settings.aovs
    }

    fn extras(&self, x: u32, y: u32) -> Option<Cow<'_, ExtraSums>> {
        let no_tile = self.settings.extras.then(Cow::default);
        self.locate(x, y).map_or(no_tile, |(tile, i)| tile.extras.get(i).map(Cow::Borrowed))
    }

    fn light_groups(&self) -> &[String] {
        self.settings.light_groups.as_ref().map_or(&[][..], LightGroups::names)
    }

    fn light(&self, x: u32, y: u32, layer: usize) -> [f32; 3] {
        let of = |(tile, i): (&Tile, usize)| tile.layers.get(i * self.light_groups().len() + layer).copied();
        self.locate(x, y).and_then(of).unwrap_or_default()
    }

    fn light_share(&self, x: u32, y: u32) -> f32 {
        self.locate(x, y).map_or(0.5, |(tile, i)| tile.shares[i].light_share)
    }

    fn background(&self) -> Background {
        self.background
    }

    fn at(&self, x: u32, y: u32) -> (PixelStats, AovSums) {
        self.locate(x, y).map_or((PixelStats::EMPTY, AovSums::default()), |(tile, i)| tile.at(i))
    }
}
