//! The environment light: bilinearly interpolated radiance, sampled in proportion to its luminance.

use std::f32::consts::{FRAC_1_PI, PI};
use std::sync::OnceLock;

use glam::Vec3;

mod table;

use super::samples::{LightProposal, LightSamples};
use crate::color::luminance;
use crate::lanes::{F, LANES, V3, eight};
use crate::sampling::warp;
use crate::scene::Environment;
pub use table::Density;
use table::{Table, row_extent, row_pair};

/// Radiance is interpolated between texel centres (wrapping in u, clamped at the poles). Samples follow the luminance of this
/// interpolant times sin θ at the middle of each row: first a cell between four texel centres by its integral, then the
/// bilinear function within the cell.
#[derive(Debug)]
pub struct EnvironmentSampler {
    width: usize,
    height: usize,
    /// Radiance of `width * height` texels, linear RGB, with strength and without rotation.
    texels: Vec<Vec3>,
    /// By luminance.
    plain: Table,
    /// By the luminance above the mean, if any is; made on first use.
    compensated: OnceLock<Option<Table>>,
    /// Sine and cosine of the rotation about +y.
    rotation: (f32, f32),
    /// Luminance averaged over the sphere.
    mean_luminance: f32,
}

impl EnvironmentSampler {
    /// A sampler of an environment; `None` if it is black.
    pub fn new(environment: &Environment) -> Option<Self> {
        let (width, height) = (environment.width as usize, environment.height as usize);
        let texels: Vec<Vec3> =
            environment.pixels.iter().map(|&p| Vec3::from_array(p) * environment.strength).collect();
        let lum: Vec<f32> = texels.iter().map(|&t| luminance(t)).collect();
        let (plain, mean_luminance) = Table::new(&lum, width, 0.0)?;
        let rotation = environment.rotation.sin_cos();
        Some(Self { width, height, texels, plain, compensated: OnceLock::new(), rotation, mean_luminance })
    }

    /// Luminance averaged over the sphere (to the accuracy of one row).
    pub fn mean_luminance(&self) -> f32 {
        self.mean_luminance
    }

    /// Radiance (linear RGB) from unit directions `wi` in world space, and the density per solid angle of [`sample`](Self::sample)
    /// with `density`.
    #[inline]
    pub fn radiance_pdf(&self, wi: V3, density: Density) -> (V3, F) {
        let (s, c) = (F::splat(self.rotation.0), F::splat(self.rotation.1));
        // The inverse rotation.
        let (x, z) = (c * wi.x - s * wi.z, s * wi.x + c * wi.z);
        // By x and z, which is accurate near the poles.
        let sin_theta = x.mul_add(x, z * z).sqrt();
        let u = z.atan2(x).mul_add(F::splat(0.5 * FRAC_1_PI), F::HALF);
        let v = sin_theta.atan2(wi.y) * F::splat(FRAC_1_PI);
        let column = u.mul_sub(F::splat(self.width as f32), F::HALF);
        let floor = column.floor();
        let row = v.mul_add(F::splat(self.height as f32), F::HALF).floor();
        let wrapped = floor.simd_lt(F::ZERO).select(floor + F::splat(self.width as f32), floor);
        let table = self.table(density);
        let (row, column_at) = (row.as_array().map(|r| r as usize), wrapped.as_array().map(|c| c as usize));
        // Rounding may lead past the last cell.
        let at = eight(|lane| [row[lane].min(self.height), column_at[lane].min(self.width - 1)]);
        let cells = self.cells(table, at);
        let fu = column - floor;
        let fv = ((v - cells.top) / cells.height).fast_max(F::ZERO).fast_min(F::ONE);
        let radiance = cells.radiance(fu, fv);
        (radiance, self.pdf(&cells, cells.weight(table.level, radiance, fu, fv), sin_theta, table.level))
    }

    /// Whether any luminance is above the mean.
    pub fn has_compensated(&self) -> bool {
        self.compensated().is_some()
    }

    fn compensated(&self) -> Option<&Table> {
        let make = || {
            let luminance: Vec<f32> = self.texels.iter().map(|&t| luminance(t)).collect();
            Table::new(&luminance, self.width, self.mean_luminance).map(|(table, _)| table)
        };
        self.compensated.get_or_init(make).as_ref()
    }

    fn table(&self, density: Density) -> &Table {
        match density {
            Density::Radiance => &self.plain,
            Density::Compensated => self.compensated().unwrap_or(&self.plain),
        }
    }

    /// Samples directions by the last two of three random numbers in [0, 1).
    #[inline]
    pub fn sample(&self, proposal: &LightProposal, [_, u, v]: [F; 3]) -> LightSamples {
        let table = self.table(proposal.density);
        let (u, v) = (u.as_array(), v.as_array());
        let sampled = eight(|lane| table.sample([u[lane], v[lane]]));
        let cells = self.cells(table, sampled.map(|(at, _)| at));
        let [rest_u, rest_v] = [0, 1].map(|k| sampled.map(|(_, rest)| rest[k]));
        let [a, b, c, d] = cells.weights(table.level);
        // The bilinear function's marginal in v is linear, then the slice in u is linear.
        let fv = warp::linear(F::from(rest_v), a + b, c + d);
        let (left, right) = ((c - a).mul_add(fv, a), (d - b).mul_add(fv, b));
        let fu = warp::linear(F::from(rest_u), left, right);
        let map_u = (F::from(sampled.map(|(at, _)| at[1] as f32 + 0.5)) + fu) / F::splat(self.width as f32);
        let map_v = cells.height.mul_add(fv, cells.top);
        let (sin_theta, cos_theta) = warp::sin_cos_turns(map_v * F::HALF);
        let past = map_u.simd_gt(F::ONE);
        let (sin_phi, cos_phi) = warp::sin_cos_turns(past.select(map_u - F::ONE, map_u));
        // u = ½ is the direction +x, so the angle is turned by half a turn.
        let (x, z) = (-(sin_theta * cos_phi), -(sin_theta * sin_phi));
        let (s, co) = (F::splat(self.rotation.0), F::splat(self.rotation.1));
        let wi = V3 { x: co * x + s * z, y: cos_theta, z: co * z - s * x };
        let radiance = cells.radiance(fu, fv);
        let pdf = self.pdf(&cells, cells.weight(table.level, radiance, fu, fv), sin_theta, table.level);
        let distance = F::splat(f32::INFINITY);
        LightSamples { wi, distance, end: distance, radiance, pdf, emitter: [0; LANES] }
    }

    /// Density per solid angle: probability of the cell × bilinear density within it / solid angle per unit of the square.
    #[inline(always)]
    fn pdf(&self, cells: &Cells, weight: F, sin_theta: F, level: f32) -> F {
        let [a, b, c, d] = cells.weights(level);
        let density = cells.probability * F::splat(4.0 * self.width as f32) * weight / ((a + b + c + d) * cells.height);
        let pdf = density / (F::splat(2.0 * PI * PI) * sin_theta);
        pdf & pdf.is_finite()
    }

    /// The cells at rows and columns, with their probabilities in a table.
    #[inline(always)]
    fn cells(&self, table: &Table, at: [[usize; 2]; LANES]) -> Cells {
        let mut corners = [[[0.0; LANES]; 3]; 4];
        let (mut top, mut height) = ([0.0; LANES], [0.0; LANES]);
        for i in 0..LANES {
            let [row, column] = at[i];
            let (above, below) = row_pair(row, self.height);
            let next = if column + 1 == self.width { 0 } else { column + 1 };
            let texels = [(above, column), (above, next), (below, column), (below, next)];
            for (corner, (y, x)) in corners.iter_mut().zip(texels) {
                let texel = self.texels[y * self.width + x];
                (corner[0][i], corner[1][i], corner[2][i]) = (texel.x, texel.y, texel.z);
            }
            let (from, to) = row_extent(row, self.height);
            (top[i], height[i]) = (from, to - from);
        }
        Cells {
            corners: corners.map(V3::from_arrays),
            probability: F::from(at.map(|at| table.cell_probability(at))),
            top: F::from(top),
            height: F::from(height),
        }
    }
}

/// Cells between four texel centres.
struct Cells {
    /// Radiance above left, above right, below left, below right.
    corners: [V3; 4],
    probability: F,
    /// Start in v.
    top: F,
    /// Extent in v.
    height: F,
}

impl Cells {
    /// Weights of the corners in a table with this level.
    #[inline(always)]
    fn weights(&self, level: f32) -> [F; 4] {
        self.corners.map(|corner| (corner.luminance() - F::splat(level)).fast_max(F::ZERO))
    }

    /// The bilinear interpolant of the weights; `radiance` is that of the radiance.
    #[inline(always)]
    fn weight(&self, level: f32, radiance: V3, fu: F, fv: F) -> F {
        if level == 0.0 {
            return radiance.luminance();
        }
        let [a, b, c, d] = self.weights(level);
        let (top, bottom) = ((b - a).mul_add(fu, a), (d - c).mul_add(fu, c));
        (bottom - top).mul_add(fv, top)
    }

    /// The bilinear interpolant at (`fu`, `fv`) from the upper left corner.
    #[inline(always)]
    fn radiance(&self, fu: F, fv: F) -> V3 {
        let [a, b, c, d] = self.corners;
        let (top, bottom) = (a + (b - a) * fu, c + (d - c) * fu);
        top + (bottom - top) * fv
    }
}
