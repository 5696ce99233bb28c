//! The stages between ray queries. Each is a function from queues to queues: camera rays; sorting of hits; absorption by
//! media; emission; vertices on scattering surfaces; sample requests; light samples (shadow rays); BSDF samples (next rays).

pub mod camera_rays;
pub mod emission;
pub mod lights;
pub mod media;
pub mod mixture;
pub mod requests;
pub mod scatter;
pub mod sort;
pub mod surfaces;

use glam::Vec3;

use crate::lanes::{F, LANES, Rows, V3};

/// Up to eight entries of a list of row numbers from `at` on, and their number. Spare lanes repeat the first entry.
#[inline(always)]
fn eight_of(list: &[u32], at: usize) -> (Rows, usize) {
    let n = LANES.min(list.len() - at);
    let mut rows = [list[at]; LANES];
    rows[..n].copy_from_slice(&list[at..at + n]);
    let consecutive = n == LANES && rows[LANES - 1] == rows[0] + LANES as u32 - 1;
    (if consecutive { Rows::From(rows[0] as usize) } else { Rows::Each(rows) }, n)
}

/// Sequence dimensions of light samples at a depth (0 for the first surface).
#[inline]
pub fn light_set(depth: u32) -> u32 {
    1 + 2 * depth
}

/// Sequence dimensions of BSDF samples at a depth.
#[inline]
pub fn bsdf_set(depth: u32) -> u32 {
    2 + 2 * depth
}

/// Sequence dimensions of the roulette of light samples at a depth, which needs no stratification.
#[inline]
pub fn roulette_set(depth: u32) -> u32 {
    light_set(depth) | 1 << 8
}

/// The terms W = Σ_c Y_c Z_c and r of a direct contribution `radiance` = g/(a_l p_l + a_b p_b). See
/// [`Contribution`](crate::balance::Contribution).
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
