//! Environment light: an equirectangular picture at infinity.

use std::f32::consts::PI;
use std::sync::Arc;

use glam::Vec3;

/// An environment light. A direction (x, y, z) in world space reads u = 0.5 + atan2(z, x)/2π, v = acos(y)/π from the top;
/// `rotation` rotates the map about +y.
#[derive(Debug, Clone)]
pub struct Environment {
    /// Name or path, for messages.
    pub name: String,
    /// Width in pixels, ≥ 1.
    pub width: u32,
    /// Height in pixels, ≥ 1.
    pub height: u32,
    /// Linear RGB radiance, row-major from the top, finite and ≥ 0.
    pub pixels: Arc<[[f32; 3]]>,
    /// Rotation about +y in radians.
    pub rotation: f32,
    /// Factor of the radiance, 0 to [`MAX_STRENGTH`](Self::MAX_STRENGTH).
    pub strength: f32,
}

/// Soft lights of [`Environment::studio`]: direction, radiance, and exponent of the cosine lobe.
const STUDIO_LIGHTS: [(Vec3, f32, f32); 2] = [
    // A key light from above, front left of the framed view; a rim light from behind.
    (Vec3::new(-0.34, 0.92, 0.63), 9.0, 24.0),
    (Vec3::new(0.75, 0.4, -0.65), 4.0, 60.0),
];

impl Environment {
    /// Largest strength: with it, sums of squares over a picture stay finite as 32-bit floats.
    pub const MAX_STRENGTH: f32 = 1e10;

    /// Default light for scenes without light: a grey gradient, brighter above, with a large soft key light and a smaller rim
    /// light. A white surface that faces the key light reflects a radiance of about 1.
    pub fn studio() -> Self {
        Self::made("studio", 64, |d| {
            let lights = STUDIO_LIGHTS
                .iter()
                .map(|(at, radiance, power)| radiance * d.dot(at.normalize()).max(0.0).powf(*power));
            [0.22 + 0.14 * d.y + lights.sum::<f32>(); 3]
        })
    }

    /// An environment of `height` rows and twice as many columns, by the radiance from unit directions.
    pub(super) fn made(name: &str, height: u32, radiance: impl Fn(Vec3) -> [f32; 3]) -> Self {
        let (width, rows) = (2 * height, height as f32);
        let pixel = |row: u32, column: u32| {
            let theta = PI * (row as f32 + 0.5) / rows;
            let phi = PI * ((column as f32 + 0.5) / rows - 1.0);
            radiance(Vec3::new(theta.sin() * phi.cos(), theta.cos(), theta.sin() * phi.sin()))
        };
        let pixels = (0..width * height).map(|i| pixel(i / width, i % width)).collect();
        Self { name: name.into(), width, height, pixels, rotation: 0.0, strength: 1.0 }
    }

    /// Do both share the same decoded pixels, with equal rotation and strength?
    pub fn is_same(&self, other: &Self) -> bool {
        let parameters = |e: &Self| (e.rotation.to_bits(), e.strength.to_bits());
        Arc::ptr_eq(&self.pixels, &other.pixels) && parameters(self) == parameters(other)
    }

    /// Constant linear RGB radiance from all directions.
    pub fn constant(radiance: [f32; 3]) -> Self {
        Self { name: "constant".into(), width: 1, height: 1, pixels: [radiance].into(), rotation: 0.0, strength: 1.0 }
    }
}
