//! KHR_materials_dispersion: an index of refraction for each colour channel. At the first dispersive surface a path keeps a
//! single channel, chosen with probability proportional to its throughput, and the channel's throughput is divided by that
//! probability. The estimator of each channel is unbiased.

use glam::Vec3;

use crate::bsdf::Surface;
use crate::scene::Material;

/// Chooses a channel by `number`, uniform in [0, 1), for a path of throughput `beta`. Returns the surface with the channel's
/// index of refraction and the new throughput; both are unchanged where the material does not disperse.
#[inline]
pub fn sample_channel(surface: Surface, material: &Material, beta: Vec3, number: f32) -> (Surface, Vec3) {
    let sum = beta.element_sum();
    if !material.disperses() || surface.transmission * (1.0 - surface.metallic) <= 0.0 || sum <= 0.0 {
        return (surface, beta);
    }
    let x = number * sum;
    let drawn = if x < beta.x { 0 } else { 1 + usize::from(x >= beta.x + beta.y) };
    // Rounding at the end of the interval must not choose a channel of probability zero.
    let channel = if beta[drawn] > 0.0 { drawn } else { beta.max_position() };
    let mut only = Vec3::ZERO;
    only[channel] = sum;
    (Surface { ior: index(surface.ior, material.dispersion, channel), ..surface }, only)
}

/// Index of refraction of a channel (0 red, 1 green, 2 blue) by the extension's formula; green has the material's `ior`.
pub fn index(ior: f32, dispersion: f32, channel: usize) -> f32 {
    let half_spread = (ior - 1.0) * 0.025 * dispersion;
    if ior == 0.0 { ior } else { (ior + half_spread * (channel as f32 - 1.0)).max(1.0) }
}
