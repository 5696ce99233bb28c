//! Contributions of samples at first surfaces, for the observer of a balance method.

use glam::Vec3;

use crate::balance::{Contribution, Observer, Technique};
use crate::integrator::data::context::WaveContext;
use crate::integrator::data::dimensions::AREA_LIGHT_INDEX;
use crate::integrator::data::queues::{LightKind, PathRays, ShadowRays};
use crate::integrator::data::requests::{LightTarget, RequestPacket};
use crate::integrator::data::vertices::Vertices;
use crate::integrator::events::{
    BorrowedLight, FoundEmission, LightSamplePacket, PathEvents, ScatteredPacket, UnoccludedLight,
};
use crate::lanes::{F, U, V3, grow, store, store_bits};

/// Reports contributions at first surfaces, and the radiance of paths, to an observer.
pub struct Contributions<'a> {
    pub observer: &'a mut dyn Observer,
    /// Columns, reused between waves.
    pub columns: &'a mut ContributionColumns,
}

#[derive(Debug, Default)]
pub struct ContributionColumns {
    light: LightColumns,
    /// By BSDF sample at a first surface ([`PathRays::root`]), its sub-path; then what is borrowed.
    sub_paths: Vec<SubPath>,
}

/// By row of shadow rays at first surfaces, except those of punctual lights: the terms of their contributions.
#[derive(Debug, Default)]
struct LightColumns {
    /// [`Contribution::index`].
    index: Vec<u32>,
    /// All bits set if the sample was allocated to area lights, else none.
    area: Vec<u32>,
    /// [`Contribution::w`].
    w: Vec<f32>,
    /// [`Contribution::r`].
    r: Vec<f32>,
}

/// The sub-path that begins with a BSDF sample at a first surface.
#[derive(Debug, Clone, Copy)]
struct SubPath {
    /// Index of its path in the wave.
    path: u32,
    /// Index of the BSDF sample in its pixel's sequence.
    index: u32,
    /// Radiance that it contributes by way of further surfaces.
    indirect: Vec3,
}

impl PathEvents for Contributions<'_> {
    fn begin(&mut self, _at: &WaveContext) {
        self.columns.sub_paths.clear();
    }

    fn emission(&mut self, at: &WaveContext, rays: &PathRays, found: &FoundEmission) {
        let (row, radiance) = (found.ray as usize, found.radiance);
        match at.depth {
            0 => {}
            1 => {
                let path = &at.paths[rays.path[row] as usize];
                let [a_env, a_area, a_b] = path.samples_per_path;
                let (a_l, weighted_light) = (a_env + a_area, a_env * found.pdf[0] + a_area * found.pdf[1]);
                let (p_l, p_b) = (weighted_light / a_l, rays.weighted_pdf[row] / a_b);
                let (w, r) = contribution_terms(radiance, p_l, p_b, a_l / (a_l + a_b));
                let divided = at.tasks[path.pixel as usize].counts.environment.is_some();
                let (area, index) = (divided && found.pdf[1] > 0.0, rays.index[row]);
                let (technique, layer) = (Technique::Bsdf, found.layer);
                let contribution = Contribution { pixel: 0, technique, area, layer, index, r, w, radiance };
                self.notify(at, rays.path[row], contribution);
            }
            _ => self.columns.add_indirect(rays.root[row], radiance),
        }
    }

    fn light_samples(
        &mut self,
        at: &WaveContext,
        _vertices: &Vertices,
        packet: &RequestPacket,
        samples: &LightSamplePacket,
    ) {
        if at.depth > 0 {
            return;
        }
        let LightSamplePacket { survivors, first_row, weighted_pdf, bsdf_pdf, radiance, .. } = *samples;
        let [a_env, a_area, a_b] = packet.samples_per_path;
        let a_l = a_env + a_area;
        let (w, r) = contribution_terms_wide(radiance, weighted_pdf / a_l, bsdf_pdf, a_l / (a_l + a_b));
        let index = packet.path_ids.index & U::splat(!AREA_LIGHT_INDEX);
        let area = packet.target.simd_eq(U::splat(LightTarget::AreaLight as u32));
        let columns = &mut self.columns.light;
        for (column, value) in [(&mut columns.index, index), (&mut columns.area, area)] {
            grow(column, first_row);
            store_bits(column, first_row, survivors.compress_bits(value));
        }
        for (column, value) in [(&mut columns.w, w), (&mut columns.r, r)] {
            grow(column, first_row);
            store(column, first_row, survivors.compress(value));
        }
    }

    fn scattered(&mut self, at: &WaveContext, _: &Vertices, packet: &RequestPacket, _: &ScatteredPacket) {
        if at.depth == 0 {
            let (path, index) = (packet.path_ids.path.to_array(), packet.path_ids.index.to_array());
            let new = (0..packet.len).map(|i| SubPath { path: path[i], index: index[i], indirect: Vec3::ZERO });
            self.columns.sub_paths.extend(new);
        }
    }

    fn unoccluded(&mut self, at: &WaveContext, shadows: &ShadowRays, found: &UnoccludedLight) {
        let UnoccludedLight { row, radiance, scale } = *found;
        if at.depth > 0 {
            self.columns.add_indirect(shadows.root[row], radiance);
        } else if shadows.kind(row) != LightKind::Punctual {
            let LightColumns { index, area, w, r } = &self.columns.light;
            if w[row] > 0.0 {
                let (area, index, r) = (area[row] != 0, index[row], r[row]);
                let (technique, w) = (Technique::Light, w[row] * scale * scale);
                let layer = at.transport.sampled_layer(shadows.light(row));
                let contribution = Contribution { pixel: 0, technique, area, layer, index, r, w, radiance };
                self.notify(at, shadows.path[row], contribution);
            }
        }
    }

    fn borrowed(&mut self, _at: &WaveContext, light: &BorrowedLight) {
        let BorrowedLight { path, index, radiance } = *light;
        self.columns.sub_paths.push(SubPath { path, index, indirect: radiance });
    }

    fn end(&mut self, at: &WaveContext, radiance: &[Vec3]) {
        for i in 0..self.columns.sub_paths.len() {
            let SubPath { path, index, indirect: radiance } = self.columns.sub_paths[i];
            if radiance != Vec3::ZERO {
                // Light samples cannot find it: Z = 2X, Y = 2 a_b X, r = −1.
                let w = 4.0 * at.paths[path as usize].samples_per_path[2] * radiance.length_squared();
                let technique = Technique::Indirect;
                let contribution =
                    Contribution { pixel: 0, technique, area: false, layer: 0, index, r: -1.0, w, radiance };
                self.notify(at, path, contribution);
            }
        }
        for (task, paths) in at.by_pixel(radiance) {
            paths.iter().for_each(|radiance| self.observer.path(task.number, *radiance));
        }
    }
}

impl Contributions<'_> {
    /// Reports a contribution of a path; its pixel is set here.
    fn notify(&mut self, at: &WaveContext, path: u32, contribution: Contribution) {
        let pixel = at.tasks[at.pixel(path)].number;
        self.observer.contribution(&Contribution { pixel, ..contribution });
    }
}

impl ContributionColumns {
    /// Adds light that a ray with this root found to its sub-path.
    fn add_indirect(&mut self, root: u32, radiance: Vec3) {
        self.sub_paths[root as usize].indirect += radiance;
    }
}

/// The terms W = Σ_c Y_c Z_c and r of a direct contribution `radiance` = g/(a_l p_l + a_b p_b). See
/// [`Contribution`].
#[inline]
fn contribution_terms(radiance: Vec3, light_pdf: f32, bsdf_pdf: f32, light_share: f32) -> (f32, f32) {
    // For counts that sum to 2N: Z = 2 · radiance, Y = Z · p_α/p_½. Ratios of densities do not overflow.
    let sum = light_pdf + bsdf_pdf;
    let (q_l, q_b) = (light_pdf / sum, bsdf_pdf / sum);
    let y_over_z = 2.0 * (light_share * q_l + (1.0 - light_share) * q_b);
    (4.0 * radiance.length_squared() * y_over_z, q_l - q_b)
}

/// Eight [`contribution_terms`].
#[inline(always)]
fn contribution_terms_wide(radiance: V3, light_pdf: F, bsdf_pdf: F, light_share: F) -> (F, F) {
    let sum = light_pdf + bsdf_pdf;
    let (q_l, q_b) = (light_pdf / sum, bsdf_pdf / sum);
    let y_over_z = F::splat(2.0) * light_share.mul_add(q_l, (F::ONE - light_share) * q_b);
    (F::splat(4.0) * radiance.length_squared() * y_over_z, q_l - q_b)
}
