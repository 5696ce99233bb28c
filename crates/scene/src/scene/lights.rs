//! KHR_lights_punctual.

use glam::Vec3;

use super::motion::{between, mix};

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
    /// What it does while the shutter is open, at even steps, two or more; empty if it stands still.
    pub motion: Vec<LightKey>,
}

/// A light without size at a moment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LightKey {
    /// As in [`PunctualLight`].
    pub intensity: Vec3,
    /// As in [`PunctualLight`].
    pub position: Vec3,
    /// As in [`PunctualLight`].
    pub direction: Vec3,
}

impl PunctualLight {
    /// At the picture's own moment.
    #[inline]
    pub fn key(&self) -> LightKey {
        LightKey { intensity: self.intensity, position: self.position, direction: self.direction }
    }

    /// At a time in [0, 1] of the shutter.
    #[inline]
    pub fn at(&self, time: f32) -> LightKey {
        if self.motion.is_empty() {
            return self.key();
        }
        let (before, share) = between(self.motion.len(), time);
        let (a, b) = (&self.motion[before], &self.motion[before + 1]);
        LightKey {
            intensity: mix(a.intensity, b.intensity, share),
            position: mix(a.position, b.position, share),
            direction: mix(a.direction, b.direction, share).normalize_or(a.direction),
        }
    }
}
