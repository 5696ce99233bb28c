//! KHR_lights_punctual.

use glam::Vec3;

/// Which punctual light.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PunctualKind {
    /// Light along a direction; `intensity` is irradiance in lux (W/m² here).
    Directional,
    /// Light from a point; `intensity` in candela (W/sr here).
    Point,
    /// Light from a point in a cone, angles from its axis in radians; `intensity` in candela.
    Spot {
        /// Full intensity inside.
        inner: f32,
        /// Nothing outside.
        outer: f32,
    },
}

/// A light without size, in world space.
#[derive(Debug, Clone)]
pub struct PunctualLight {
    /// Name for messages.
    pub name: String,
    /// Kind.
    pub kind: PunctualKind,
    /// Linear RGB times intensity, ≥ 0.
    pub intensity: Vec3,
    /// Where it stands (point, spot).
    pub position: Vec3,
    /// Unit vector along which it shines (directional, spot).
    pub direction: Vec3,
    /// Metres from which on it gives no light (point, spot), > 0; infinite without an end.
    pub range: f32,
}
