//! The map in cells between texel centres, sampled by its luminance.

use std::f32::consts::PI;

use crate::sampling::Discrete;

/// The density of directions toward the environment.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Density {
    /// In proportion to the luminance.
    #[default]
    Radiance,
    /// In proportion to the luminance above its mean, or like `Radiance` if none is: MIS compensation (Karlík, Šik, Vévoda,
    /// Skřivan and Křivánek 2019, *MIS Compensation: Optimizing Sampling Techniques in Multiple Importance Sampling*). BSDF
    /// samples must find the rest.
    Compensated,
}

/// Probabilities of cells, in proportion to the integrals of their bilinear functions.
#[derive(Debug)]
pub(super) struct Table {
    /// Rows of cells: `height + 1`, the first and the last half as high.
    rows: Discrete,
    /// The columns of each row of cells.
    columns: Vec<Option<Discrete>>,
    /// The value that is subtracted from the texels' luminance.
    pub(super) level: f32,
}

impl Table {
    /// A table of the luminances, `width` per row, minus `level`, and the mean of these differences over the sphere. `None` if no
    /// difference is positive.
    pub(super) fn new(luminance: &[f32], width: usize, level: f32) -> Option<(Self, f32)> {
        let height = luminance.len() / width;
        let excess = |x: usize| (luminance[x] - level).max(0.0);
        let mut row_weights = Vec::with_capacity(height + 1);
        let mut columns = Vec::with_capacity(height + 1);
        let mut mean = 0.0f64;
        for row in 0..=height {
            let (above, below) = row_pair(row, height);
            let weight = |x: usize| {
                let next = (x + 1) % width;
                excess(above * width + x)
                    + excess(above * width + next)
                    + excess(below * width + x)
                    + excess(below * width + next)
            };
            let (top, bottom) = row_extent(row, height);
            let sin = (PI * 0.5 * (top + bottom)).sin();
            let column = Discrete::new((0..width).map(weight));
            let total = column.as_ref().map_or(0.0, Discrete::total) * 0.25;
            // Integral over the cells: mean value × sin θ × height in v × width in u.
            let integral = total * f64::from(sin) * f64::from(bottom - top) / width as f64;
            mean += integral * std::f64::consts::FRAC_PI_2;
            row_weights.push(integral as f32);
            columns.push(column);
        }
        let rows = Discrete::new(row_weights.into_iter())?;
        Some((Self { rows, columns, level }, mean as f32))
    }

    /// Samples a cell by two numbers in [0, 1), for columns and rows: its row and column, and new numbers in [0, 1) for the
    /// position along the cell's width and height.
    #[inline(always)]
    pub(super) fn sample(&self, [u, v]: [f32; 2]) -> ([usize; 2], [f32; 2]) {
        let (row, rest_v) = self.rows.sample(v);
        let (column, rest_u) = self.columns[row as usize].as_ref().map_or((0, 0.0), |row| row.sample(u));
        ([row as usize, column as usize], [rest_u, rest_v])
    }

    #[inline(always)]
    pub(super) fn cell_probability(&self, [row, column]: [usize; 2]) -> f32 {
        self.rows.pmf(row as u32) * self.columns[row].as_ref().map_or(0.0, |row| row.pmf(column as u32))
    }
}

/// The texel rows above and below a row of cells.
#[inline]
pub(super) fn row_pair(row: usize, height: usize) -> (usize, usize) {
    (row.saturating_sub(1), row.min(height - 1))
}

/// Start and end of a row of cells in v.
#[inline]
pub(super) fn row_extent(row: usize, height: usize) -> (f32, f32) {
    let h = height as f32;
    (((row as f32 - 0.5) / h).max(0.0), ((row as f32 + 0.5) / h).min(1.0))
}
