//! The environment as a light: bilinear radiance, sampled in proportion to it.

use std::f32::consts::{FRAC_1_PI, PI};

use glam::Vec3;

use super::LightSample;
use crate::color::luminance;
use crate::sampling::{Discrete, warp};
use crate::scene::Environment;

/// Radiance is interpolated between texel centres (wrapping in u, clamped at the poles). Samples are drawn from that
/// very interpolant times sin θ at the middle of each row: cells between four texel centres by their integral, then
/// the bilinear function within the cell.
#[derive(Debug)]
pub struct EnvironmentSampler {
    width: usize,
    /// Texel rows.
    height: usize,
    /// `width * height` radiance, rotation not applied, strength applied.
    texels: Vec<Vec3>,
    /// Row of cells: `height + 1` of them, the first and last half as high.
    rows: Discrete,
    /// For each row of cells, its columns.
    columns: Vec<Option<Discrete>>,
    /// Sine and cosine of the rotation about +y.
    rotation: (f32, f32),
    /// Luminance averaged over the sphere.
    mean_luminance: f32,
}

impl EnvironmentSampler {
    /// `None` when it is black.
    pub fn new(environment: &Environment) -> Option<Self> {
        let (width, height) = (environment.width as usize, environment.height as usize);
        let texels: Vec<Vec3> =
            environment.pixels.iter().map(|&p| Vec3::from_array(p) * environment.strength).collect();
        let lum: Vec<f32> = texels.iter().map(|&t| luminance(t)).collect();
        let mut row_weights = Vec::with_capacity(height + 1);
        let mut columns = Vec::with_capacity(height + 1);
        let mut mean = 0.0f64;
        for row in 0..=height {
            let (above, below) = row_pair(row, height);
            let weight = |x: usize| {
                let next = (x + 1) % width;
                lum[above * width + x] + lum[above * width + next] + lum[below * width + x] + lum[below * width + next]
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
        let rotation = environment.rotation.sin_cos();
        Some(Self { width, height, texels, rows, columns, rotation, mean_luminance: mean as f32 })
    }

    /// Luminance averaged over the sphere (to the accuracy of one row).
    pub fn mean_luminance(&self) -> f32 {
        self.mean_luminance
    }

    /// Radiance from direction `wi`, unit, world space.
    #[inline]
    pub fn radiance(&self, wi: Vec3) -> Vec3 {
        let (u, v) = self.uv(wi);
        let cell = self.cell(u, v);
        let [a, b, c, d] = self.corners(cell.row, cell.column);
        let top = a + (b - a) * cell.fu;
        let bottom = c + (d - c) * cell.fu;
        top + (bottom - top) * cell.fv
    }

    /// Draws a direction in proportion to the radiance's luminance.
    #[inline]
    pub fn sample(&self, u: f32, v: f32) -> Option<LightSample> {
        let (row, rest_v) = self.rows.sample(v);
        let (column, rest_u) = self.columns[row as usize].as_ref()?.sample(u);
        let (row, column) = (row as usize, column as usize);
        let corners = self.corners(row, column);
        let [a, b, c, d] = corners.map(luminance);
        // The bilinear function's marginal in v is linear, then the slice in u is linear.
        let fv = warp::linear(rest_v, a + b, c + d);
        let (left, right) = (a + (c - a) * fv, b + (d - b) * fv);
        let fu = if left + right > 0.0 { warp::linear(rest_u, left, right) } else { rest_u };
        let (top, bottom) = row_extent(row, self.height);
        let map_u = (column as f32 + 0.5 + fu) / self.width as f32;
        let map_v = top + (bottom - top) * fv;
        let (sin_theta, cos_theta) = (PI * map_v).sin_cos();
        let (sin_phi, cos_phi) = (2.0 * PI * (map_u - 0.5)).sin_cos();
        let local = Vec3::new(sin_theta * cos_phi, cos_theta, sin_theta * sin_phi);
        let (s, co) = self.rotation;
        let wi = Vec3::new(co * local.x + s * local.z, local.y, -s * local.x + co * local.z);
        let value = left + (right - left) * fu;
        let pdf = self.cell_pdf(row, column, value, a + b + c + d, sin_theta);
        let [ra, rb, rc, rd] = corners;
        let upper = ra + (rb - ra) * fu;
        let radiance = upper + (rc + (rd - rc) * fu - upper) * fv;
        (pdf > 0.0).then_some(LightSample { wi, distance: f32::INFINITY, radiance, pdf })
    }

    /// Density per solid angle of [`sample`](Self::sample).
    #[inline]
    pub fn pdf(&self, wi: Vec3) -> f32 {
        let (u, v) = self.uv(wi);
        let cell = self.cell(u, v);
        let [a, b, c, d] = self.corners(cell.row, cell.column).map(luminance);
        let (left, right) = (a + (c - a) * cell.fv, b + (d - b) * cell.fv);
        let value = left + (right - left) * cell.fu;
        self.cell_pdf(cell.row, cell.column, value, a + b + c + d, sin_polar(wi))
    }

    /// Chance of the cell × bilinear density within it / solid angle of the unit square there.
    #[inline]
    fn cell_pdf(&self, row: usize, column: usize, value: f32, corner_sum: f32, sin_theta: f32) -> f32 {
        let Some(columns) = &self.columns[row] else { return 0.0 };
        let chance = self.rows.pmf(row as u32) * columns.pmf(column as u32);
        let (top, bottom) = row_extent(row, self.height);
        let density = chance * (4.0 * value / corner_sum) * self.width as f32 / (bottom - top);
        let pdf = density / (2.0 * PI * PI * sin_theta);
        if pdf.is_finite() { pdf } else { 0.0 }
    }

    #[inline]
    fn uv(&self, wi: Vec3) -> (f32, f32) {
        let (s, c) = self.rotation;
        // The inverse rotation.
        let (x, z) = (c * wi.x - s * wi.z, s * wi.x + c * wi.z);
        (0.5 + z.atan2(x) * (0.5 * FRAC_1_PI), sin_polar(wi).atan2(wi.y) * FRAC_1_PI)
    }

    #[inline]
    fn cell(&self, u: f32, v: f32) -> Cell {
        let x = u * self.width as f32 - 0.5;
        let floor = x.floor();
        let column = (floor as i64).rem_euclid(self.width as i64) as usize;
        let y = v * self.height as f32 + 0.5;
        let row = (y as usize).min(self.height);
        let (top, bottom) = row_extent(row, self.height);
        let fv = ((v - top) / (bottom - top)).clamp(0.0, 1.0);
        Cell { row, column, fu: x - floor, fv }
    }

    /// Radiance at a cell's corners: above left, above right, below left, below right.
    #[inline]
    fn corners(&self, row: usize, column: usize) -> [Vec3; 4] {
        let (above, below) = row_pair(row, self.height);
        let next = if column + 1 == self.width { 0 } else { column + 1 };
        let (above, below) = (above * self.width, below * self.width);
        [self.texels[above + column], self.texels[above + next], self.texels[below + column], self.texels[below + next]]
    }
}

struct Cell {
    row: usize,
    column: usize,
    /// Position within the cell, from left and top.
    fu: f32,
    fv: f32,
}

/// Sine of the angle from +y; from x and z, so that it is exact near the poles.
#[inline]
fn sin_polar(wi: Vec3) -> f32 {
    (wi.x * wi.x + wi.z * wi.z).sqrt()
}

/// The texel rows above and below a row of cells.
#[inline]
fn row_pair(row: usize, height: usize) -> (usize, usize) {
    (row.saturating_sub(1), row.min(height - 1))
}

/// Where a row of cells begins and ends in v.
#[inline]
fn row_extent(row: usize, height: usize) -> (f32, f32) {
    let h = height as f32;
    (((row as f32 - 0.5) / h).max(0.0), ((row as f32 + 0.5) / h).min(1.0))
}
