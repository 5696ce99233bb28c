//! Camera rays.

use glam::{Affine3A, Vec3};

use crate::scene::{Camera, Projection};

/// A camera for a picture of a given size.
#[derive(Debug, Clone, Copy)]
pub struct CameraRays {
    to_world: Affine3A,
    /// Half-extents of the picture at distance one (perspective) or of the view volume (orthographic).
    half: [f32; 2],
    size: [f32; 2],
    perspective: bool,
}

impl CameraRays {
    /// The vertical field stays whatever the size; the horizontal one follows the picture's aspect.
    pub fn new(camera: &Camera, width: u32, height: u32) -> Self {
        let aspect = width as f32 / height as f32;
        let (half_height, perspective) = match camera.projection {
            Projection::Perspective { yfov } => ((0.5 * yfov).tan(), true),
            Projection::Orthographic { ymag, .. } => (ymag, false),
        };
        Self {
            to_world: camera.to_world,
            half: [half_height * aspect, half_height],
            size: [width as f32, height as f32],
            perspective,
        }
    }

    /// Origin and unit direction through the picture's point (`x`, `y`) in pixels from its upper left corner.
    #[inline]
    pub fn ray(&self, x: f32, y: f32) -> (Vec3, Vec3) {
        let sx = (2.0 * x / self.size[0] - 1.0) * self.half[0];
        let sy = (1.0 - 2.0 * y / self.size[1]) * self.half[1];
        if self.perspective {
            let direction = self.to_world.transform_vector3(Vec3::new(sx, sy, -1.0)).normalize();
            (self.to_world.translation.into(), direction)
        } else {
            let direction = self.to_world.transform_vector3(Vec3::NEG_Z).normalize();
            (self.to_world.transform_point3(Vec3::new(sx, sy, 0.0)), direction)
        }
    }
}
