//! Point, spot and directional lights (KHR_lights_punctual).

use std::sync::Arc;

use glam::Vec3;

use super::motion::{key_before, mix};

/// Type of a punctual light.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PunctualKind {
    /// Parallel light along `direction`; `intensity` is irradiance in W/m² (lux in glTF).
    Directional,
    /// Light from a point; `intensity` in W/sr (candela in glTF).
    Point,
    /// Light from a point within a cone; angles from its axis in radians; `intensity` in W/sr (candela in glTF).
    Spot {
        /// Angle below which the intensity is full.
        inner: f32,
        /// Angle beyond which there is no light.
        outer: f32,
    },
}

/// A light of KHR_lights_punctual, in world space. The extension knows no sizes; with one, a point or spot light is a sphere and a
/// directional light a disc at infinity, with the same irradiance.
#[derive(Debug, Clone)]
pub struct PunctualLight {
    /// Name for messages.
    pub name: String,
    /// Type, with the parameters of a spot.
    pub kind: PunctualKind,
    /// Linear RGB times intensity, ≥ 0.
    pub intensity: Vec3,
    /// Position in metres (point, spot).
    pub position: Vec3,
    /// Unit vector in the direction of the light's travel (directional, spot).
    pub direction: Vec3,
    /// Distance in metres beyond which the light is zero (point, spot), > 0; infinite if unlimited.
    pub range: f32,
    /// Radius in metres of a point or spot light, at most [`MAX_RADIUS`]; half of the angle in radians that a directional light
    /// subtends, at most π/2. 0 for a light without a size.
    pub size: f32,
    /// Keys while the shutter is open, evenly spaced in time: at least two, or none if the light does not change.
    pub motion: Vec<LightKey>,
}

/// The node that places a light.
#[derive(Debug, Clone)]
pub struct LightNode {
    pub name: String,
    /// Group of lights: `extras.light_group` of the node, of the nearest node above it that has one, or of the light.
    pub group: Option<Arc<str>>,
}

/// Largest radius of a light in metres: its square is finite as a 32-bit float.
pub const MAX_RADIUS: f32 = 1e9;

/// State of a punctual light at one time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LightKey {
    /// Linear RGB; see [`PunctualLight::intensity`].
    pub intensity: Vec3,
    /// World space, metres.
    pub position: Vec3,
    /// Unit vector in world space.
    pub direction: Vec3,
}

impl PunctualLight {
    /// Sets the size to a `radius` in metres or, of a directional light, to that of a disc with this `angle` in radians across.
    pub fn set_size(&mut self, radius: Option<f32>, angle: Option<f32>) {
        let own = if self.kind == PunctualKind::Directional { angle.map(|angle| 0.5 * angle) } else { radius };
        self.size = own.unwrap_or(self.size);
    }

    /// The state at the picture's own time.
    #[inline]
    pub fn key(&self) -> LightKey {
        LightKey { intensity: self.intensity, position: self.position, direction: self.direction }
    }

    /// The state at a time in [0, 1] of the shutter.
    #[inline]
    pub fn at(&self, time: f32) -> LightKey {
        if self.motion.is_empty() {
            return self.key();
        }
        let (before, weight) = key_before(self.motion.len(), time);
        let (a, b) = (&self.motion[before], &self.motion[before + 1]);
        LightKey {
            intensity: mix(a.intensity, b.intensity, weight),
            position: mix(a.position, b.position, weight),
            direction: mix(a.direction, b.direction, weight).normalize_or(a.direction),
        }
    }
}
