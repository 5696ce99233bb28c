//! What happens between two ray queries, a function a stage from queues to queues: camera rays; hits sorted by what comes
//! next; what media took; light that rays ran into; vertices on the surfaces that scatter; which samples these take; shadow rays; the next
//! rays.

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

/// Eight of some row numbers from `at` on, the first of them in spare lanes, and how many there are.
#[inline(always)]
fn eight_of(list: &[u32], at: usize) -> (Rows, usize) {
    let n = LANES.min(list.len() - at);
    let mut rows = [list[at]; LANES];
    rows[..n].copy_from_slice(&list[at..at + n]);
    let consecutive = n == LANES && rows[LANES - 1] == rows[0] + LANES as u32 - 1;
    (if consecutive { Rows::From(rows[0] as usize) } else { Rows::Each(rows) }, n)
}

/// The set of dimensions of light samples at a depth (0 for the first surface).
#[inline]
pub fn light_set(depth: u32) -> u32 {
    1 + 2 * depth
}

/// The set of dimensions of BSDF samples at a depth.
#[inline]
pub fn bsdf_set(depth: u32) -> u32 {
    2 + 2 * depth
}

/// Of the number that says whether there is a light sample at a depth; it needs no stratification.
#[inline]
pub fn roll_set(depth: u32) -> u32 {
    light_set(depth) | 1 << 8
}

/// A direct contribution `found` = g/(a_l p_l + a_b p_b), as the balance sees it: W = Σ_c Y_c Z_c and r.
#[inline]
fn observation(found: Vec3, light_pdf: f32, bsdf_pdf: f32, alpha: f32) -> (f32, f32) {
    // With counts that add up to 2N: Z = 2 · found, Y = Z · p_α/p_½; in ratios, so that no pdf overflows.
    let sum = light_pdf + bsdf_pdf;
    let (q_l, q_b) = (light_pdf / sum, bsdf_pdf / sum);
    let y_over_z = 2.0 * (alpha * q_l + (1.0 - alpha) * q_b);
    (4.0 * found.length_squared() * y_over_z, q_l - q_b)
}

/// [`observation`], of eight.
#[inline(always)]
fn observations(found: V3, light_pdf: F, bsdf_pdf: F, alpha: F) -> (F, F) {
    let sum = light_pdf + bsdf_pdf;
    let (q_l, q_b) = (light_pdf / sum, bsdf_pdf / sum);
    let y_over_z = F::splat(2.0) * alpha.mul_add(q_l, (F::ONE - alpha) * q_b);
    (F::splat(4.0) * found.length_squared() * y_over_z, q_l - q_b)
}
