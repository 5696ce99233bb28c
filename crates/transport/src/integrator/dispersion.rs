//! KHR_materials_dispersion: bodies bend each colour by an index of its own. At the first such surface a path becomes one of
//! a single channel, drawn by what its channels are worth and worth all of it from then on: each channel's mean is that of
//! the index it has.

use glam::Vec3;

use crate::bsdf::Surface;
use crate::scene::Material;

/// The set of dimensions whose first number chooses: one for all vertices of a path, as only the first has a choice.
pub const SET: u32 = u32::MAX;

/// A surface as the channel meets it that `number` in [0, 1) draws for a path of throughput `beta`, and the channel's
/// throughput. Both are unchanged where nothing is bent by its colour.
#[inline]
pub fn draw(surface: Surface, material: &Material, beta: Vec3, number: f32) -> (Surface, Vec3) {
    let sum = beta.element_sum();
    if !material.disperses() || surface.transmission * (1.0 - surface.metallic) <= 0.0 || sum <= 0.0 {
        return (surface, beta);
    }
    let x = number * sum;
    let drawn = if x < beta.x { 0 } else { 1 + usize::from(x >= beta.x + beta.y) };
    // Roundings at the end of the interval must not draw a channel of no chance.
    let channel = if beta[drawn] > 0.0 { drawn } else { beta.max_position() };
    let mut only = Vec3::ZERO;
    only[channel] = sum;
    (Surface { ior: index(surface.ior, material.dispersion, channel), ..surface }, only)
}

/// A channel's index of refraction, as the extension computes it: red's is the lowest, green's the material's.
pub fn index(ior: f32, dispersion: f32, channel: usize) -> f32 {
    let half_spread = (ior - 1.0) * 0.025 * dispersion;
    if ior == 0.0 { ior } else { (ior + half_spread * (channel as f32 - 1.0)).max(1.0) }
}
