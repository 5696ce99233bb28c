//! Light from infinity: an equirectangular picture.

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
    pub pixels: Vec<[f32; 3]>,
    /// Radians about +y.
    pub rotation: f32,
    /// Multiplies the radiance, ≥ 0.
    pub strength: f32,
}

impl Environment {
    /// The same radiance from everywhere.
    pub fn constant(radiance: [f32; 3]) -> Self {
        Self { name: "constant".into(), width: 1, height: 1, pixels: vec![radiance], rotation: 0.0, strength: 1.0 }
    }
}
