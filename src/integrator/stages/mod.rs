//! What happens between two ray queries, stage by stage: what the hits emit ([`hits`]), which shadow rays follow
//! ([`lights`]), which next rays ([`scatter`]).

pub mod hits;
pub mod lights;
pub mod scatter;

use glam::Vec3;

/// The set of dimensions of light samples at a depth (0 for the first surface).
#[inline]
fn light_set(depth: u32) -> u32 {
    1 + 2 * depth
}

/// The set of dimensions of BSDF samples at a depth.
#[inline]
fn bsdf_set(depth: u32) -> u32 {
    2 + 2 * depth
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
