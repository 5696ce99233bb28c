//! What happens between two ray queries, stage by stage: what the hits emit ([`hits`]), which shadow rays follow
//! ([`lights`]), which next rays ([`scatter`]).

pub mod hits;
pub mod lights;
pub mod scatter;

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

/// r = (p_l − p_b)/(p_l + p_b) of a direction that light sampling draws with density `light_pdf` and BSDF sampling with
/// `bsdf_pdf`, not both zero.
#[inline]
fn contrast(light_pdf: f32, bsdf_pdf: f32) -> f32 {
    // As a ratio of the smaller to the larger, so that no pdf overflows.
    if light_pdf >= bsdf_pdf {
        let q = bsdf_pdf / light_pdf;
        (1.0 - q) / (1.0 + q)
    } else {
        let q = light_pdf / bsdf_pdf;
        (q - 1.0) / (1.0 + q)
    }
}
