//! Cameras.

use glam::Affine3A;

/// How points are projected.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Projection {
    /// Vertical field of view in radians, in (0, π). It stays whatever the picture's size.
    Perspective {
        /// Radians.
        yfov: f32,
    },
    /// Half-extents in metres; the vertical one stays, the horizontal one follows the picture's aspect.
    Orthographic {
        /// Half-width.
        xmag: f32,
        /// Half-height.
        ymag: f32,
    },
}

/// A camera that looks along its −z with +y up.
#[derive(Debug, Clone)]
pub struct Camera {
    /// Name, for `--camera`.
    pub name: String,
    /// Projection.
    pub projection: Projection,
    /// Width over height, when the file says one; sizes the default picture.
    pub aspect: Option<f32>,
    /// Camera to world; rotation and translation, any scale removed.
    pub to_world: Affine3A,
}
