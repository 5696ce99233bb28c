//! Camera rays.

use glam::Affine3A;

use crate::lanes::{F, V3};
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

    /// Origins and unit directions through the picture's points (`x`, `y`) in pixels from its upper left corner.
    #[inline(always)]
    pub fn rays(&self, x: F, y: F) -> (V3, V3) {
        let m = &self.to_world.matrix3;
        let [right, up, back] = [m.x_axis, m.y_axis, m.z_axis].map(|axis| V3::splat(axis.into()));
        let eye = V3::splat(self.to_world.translation.into());
        let sx = x.mul_add(F::splat(2.0 / self.size[0]), F::splat(-1.0)) * F::splat(self.half[0]);
        let sy = y.mul_add(F::splat(-2.0 / self.size[1]), F::ONE) * F::splat(self.half[1]);
        let across = right * sx + up * sy;
        if self.perspective {
            (eye, (across - back).normalize_or(back))
        } else {
            (eye + across, (V3::ZERO - back).normalize_or(back))
        }
    }
}
