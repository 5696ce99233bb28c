//! The contact sheet: pictures in a grid, each with a label above it.

use std::path::Path;

use noto_sans_mono_bitmap::{FontWeight, RasterHeight, get_raster, get_raster_width};

use crate::Result;
use crate::cli::options::check_ending;
use crate::film::lock::claim;
use crate::film::view::srgb_decode;
use crate::film::{Picture, preview};

/// A contact sheet, display-encoded.
pub struct Sheet {
    /// Width and height in pixels.
    pub size: [u32; 2],
    /// RGB, row by row from the top.
    pub bytes: Vec<u8>,
}

/// A label and its picture: display-encoded RGB, row by row.
pub type Cell = (String, Vec<u8>);

const FONT: (FontWeight, RasterHeight) = (FontWeight::Regular, RasterHeight::Size16);
/// Pixels around text and pictures.
const GAP: usize = 6;
/// Height of a line of text with its gap.
const LINE: usize = FONT.1.val() + GAP;
const PAPER: u8 = 28;
const INK: u8 = 225;

impl Sheet {
    /// A sheet of pictures of one size, row by row, below lines of text.
    pub fn of(title: &[String], cells: Vec<Cell>, columns: usize, [width, height]: [u32; 2]) -> Self {
        let [w, h] = [width as usize, height as usize];
        let (columns, rows) = (columns.max(1), cells.len().div_ceil(columns.max(1)));
        let top = GAP + LINE * title.len();
        let size = [GAP + columns * (w + GAP), top + rows * (LINE + h + GAP)];
        let mut sheet = Self { size: size.map(|n| n as u32), bytes: vec![PAPER; size[0] * size[1] * 3] };
        for (i, line) in title.iter().enumerate() {
            sheet.write_text(line, [GAP, GAP + i * LINE], size[0] - 2 * GAP);
        }
        for (i, (label, picture)) in cells.iter().enumerate() {
            let [x, y] = [GAP + (i % columns) * (w + GAP), top + (i / columns) * (LINE + h + GAP)];
            sheet.write_text(label, [x, y], w);
            for (row, pixels) in picture.chunks(3 * w.max(1)).enumerate() {
                let at = ((y + LINE + row) * size[0] + x) * 3;
                sheet.bytes[at..at + pixels.len()].copy_from_slice(pixels);
            }
        }
        sheet
    }

    /// Writes text from its upper left corner on; what does not fit into `width` pixels is left out.
    fn write_text(&mut self, text: &str, [x, y]: [usize; 2], width: usize) {
        let each = get_raster_width(FONT.0, FONT.1);
        let raster = |c| get_raster(c, FONT.0, FONT.1).or_else(|| get_raster('?', FONT.0, FONT.1));
        for (i, glyph) in text.chars().take(width / each).filter_map(raster).enumerate() {
            for (row, levels) in glyph.rows().enumerate() {
                let at = ((y + row) * self.size[0] as usize + x + i * each) * 3;
                let level = |level: &u8| PAPER + ((u16::from(*level) * u16::from(INK - PAPER)) / 255) as u8;
                let bytes = levels.iter().flat_map(|l| [level(l); 3]);
                self.bytes[at..].iter_mut().zip(bytes).for_each(|(to, byte)| *to = byte);
            }
        }
    }

    /// Writes the sheet; the name's ending chooses the format.
    /// Errors: [`Error::Usage`](crate::Error::Usage) for another ending; those of [`claim`] and of writing files.
    pub fn write(&self, path: &Path) -> Result<()> {
        check_ending("the sheet", path, &preview::ENDINGS)?;
        let _claim = claim(path)?;
        preview::write_rgb8(path, self.size[0], self.size[1], &self.bytes)
    }

    /// The sheet as a PNG.
    /// Errors: [`Error::Bug`](crate::Error::Bug) if the encoder fails.
    pub fn png(&self) -> Result<Vec<u8>> {
        preview::encoded(self.size[0], self.size[1], &self.bytes)
    }

    /// The sheet as a picture, to compare.
    pub fn picture(&self) -> Picture {
        picture(&self.bytes, self.size)
    }
}

/// Display-encoded RGB, row by row, as a picture to compare.
pub fn picture(bytes: &[u8], [width, height]: [u32; 2]) -> Picture {
    let window = [0, 0, i64::from(width), i64::from(height)];
    let linear = |byte: &u8| srgb_decode(f32::from(*byte) / 255.0);
    let rgb = bytes.as_chunks::<3>().0.iter().map(|[r, g, b]| [r, g, b].map(linear)).collect();
    Picture { window, display: window, rgb, variance: None, alpha: None, displayed: true, mean_variance: [1.0; 3] }
}
