//! Cameras.

use std::sync::Arc;

use glam::Affine3A;

use super::Motion;

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
    /// Camera to world at the picture's own moment; rotation and translation, any scale removed.
    pub to_world: Affine3A,
    /// What it does while the shutter is open; `None` if it stands still.
    pub motion: Option<Arc<Motion>>,
    /// Camera to world a frame before and after, for velocities; `None` if it is the same, or nobody asks.
    pub adjacent_frames: Option<[Affine3A; 2]>,
}
