//! Light from infinity: an equirectangular picture.

use std::f32::consts::PI;
use std::sync::Arc;

use glam::Vec3;

/// A direction (x, y, z) of glTF space reads u = 0.5 + atan2(z, x)/2π, v = acos(y)/π from the top; `rotation` turns
/// the map about +y.
#[derive(Debug, Clone)]
pub struct Environment {
    /// Name or path, for messages.
    pub name: String,
    /// Pixels a row, ≥ 1.
    pub width: u32,
    /// Rows, ≥ 1.
    pub height: u32,
    /// Linear RGB radiance, row-major from the top, finite and ≥ 0.
    pub pixels: Arc<[[f32; 3]]>,
    /// Radians about +y.
    pub rotation: f32,
    /// Multiplies the radiance, ≥ 0.
    pub strength: f32,
}

/// A soft lamp of [`Environment::studio`]: where it is, its radiance, and how narrow it is (a power of the cosine).
const LAMPS: [(Vec3, f32, f32); 2] = [
    // From above, in front and left of the view that scenes without a camera get; and an edge from behind.
    (Vec3::new(-0.34, 0.92, 0.63), 9.0, 24.0),
    (Vec3::new(0.75, 0.4, -0.65), 4.0, 60.0),
];

impl Environment {
    /// Light for scenes that bring none, so that their forms are seen: a grey room, brighter above than below, a large soft
    /// lamp and a smaller one. A white surface reflects about 1 where the large lamp stands above it.
    pub fn studio() -> Self {
        const HEIGHT: usize = 64;
        let pixel = |row: usize, column: usize| {
            let theta = PI * (row as f32 + 0.5) / HEIGHT as f32;
            let phi = PI * ((column as f32 + 0.5) / HEIGHT as f32 - 1.0);
            let d = Vec3::new(theta.sin() * phi.cos(), theta.cos(), theta.sin() * phi.sin());
            let lamps =
                LAMPS.iter().map(|(at, radiance, power)| radiance * d.dot(at.normalize()).max(0.0).powf(*power));
            [0.22 + 0.14 * d.y + lamps.sum::<f32>(); 3]
        };
        let pixels = (0..HEIGHT).flat_map(|row| (0..2 * HEIGHT).map(move |column| pixel(row, column))).collect();
        let (width, height) = (2 * HEIGHT as u32, HEIGHT as u32);
        Self { name: "studio".into(), width, height, pixels, rotation: 0.0, strength: 1.0 }
    }

    /// Is it this very one, from the same decoding?
    pub fn is(&self, other: &Self) -> bool {
        let turned = |e: &Self| (e.rotation.to_bits(), e.strength.to_bits());
        Arc::ptr_eq(&self.pixels, &other.pixels) && turned(self) == turned(other)
    }

    /// The same radiance from everywhere.
    pub fn constant(radiance: [f32; 3]) -> Self {
        Self { name: "constant".into(), width: 1, height: 1, pixels: [radiance].into(), rotation: 0.0, strength: 1.0 }
    }
}
