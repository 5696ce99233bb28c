//! Camera rays.

use std::f32::consts::TAU;
use std::sync::Arc;

use glam::{Affine3A, Mat3, Mat4, Vec2, Vec3, Vec3A, Vec4};

use crate::lanes::{F, V3, eight};
use crate::scene::{Camera, Motion, Projection};

/// A thin lens; all that lies in the plane of its focus is sharp.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lens {
    /// Radius of its opening in metres, > 0.
    pub radius: f32,
    /// Distance of the plane in focus, along the view, in metres, > 0.
    pub focus: f32,
    /// Sides of its opening, a regular polygon in the circle of `radius` with a corner to the right; 0 for the circle itself.
    pub blades: u32,
}

impl Lens {
    /// A point of the opening, uniform for uniform `u` and `v` in [0, 1), in metres to the right and up.
    #[inline]
    pub fn point(&self, u: F, v: F) -> (F, F) {
        let radius = F::splat(self.radius);
        if self.blades == 0 {
            // Concentric would keep strata together better, and needs sub-paths; areas are equal in both.
            let (s, c) = (F::splat(TAU) * u).sin_cos();
            let r = radius * v.sqrt();
            return (r * c, r * s);
        }
        // One of the triangles about the centre, and a point of it.
        let n = self.blades as f32;
        let scaled = u * F::splat(n);
        let blade = scaled.floor();
        let along = scaled - blade;
        let r = radius * v.sqrt();
        let angle = F::splat(TAU / n);
        let ((s0, c0), (s1, c1)) = ((blade * angle).sin_cos(), ((blade + F::ONE) * angle).sin_cos());
        (r * (c0 + along * (c1 - c0)), r * (s0 + along * (s1 - s0)))
    }
}

/// A camera for a picture of a given size.
#[derive(Debug, Clone)]
pub struct CameraRays {
    to_world: Affine3A,
    motion: Option<Arc<Motion>>,
    /// As [`Camera::beside`].
    pub adjacent_frames: Option<[Affine3A; 2]>,
    /// Half-extents of the picture at distance one (perspective) or of the view volume (orthographic).
    half: [f32; 2],
    size: [f32; 2],
    perspective: bool,
    lens: Option<Lens>,
}

/// Where a camera stands, eight times: its axes and its eye.
struct Stand {
    right: V3,
    up: V3,
    back: V3,
    eye: V3,
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
            motion: camera.motion.clone(),
            adjacent_frames: camera.adjacent_frames,
            half: [half_height * aspect, half_height],
            size: [width as f32, height as f32],
            perspective,
            lens: None,
        }
    }

    /// With a lens instead of a pinhole.
    pub fn with_lens(self, lens: Option<Lens>) -> Self {
        Self { lens, ..self }
    }

    /// Matrices for row vectors, row by row: from the world to the camera's space (x to the right, y up, z along the
    /// view), and to the picture's (x and y from 0 in the upper left to 1 in the lower right corner, after division by
    /// w), as OpenEXR's `worldToCamera` and `worldToNDC` have them.
    pub fn matrices(&self) -> [[f32; 16]; 2] {
        let m = &self.to_world.matrix3;
        let [right, up, forward] = [m.x_axis, m.y_axis, -m.z_axis].map(Vec3::from);
        let eye = Vec3::from(self.to_world.translation);
        let to_camera = Mat4::from_mat3(Mat3::from_cols(right, up, forward).transpose()) * Mat4::from_translation(-eye);
        // Columns are what x, y, z and 1 of camera space give.
        let [x, y] = self.half.map(|half| 0.5 / half);
        let (centre, one) = (Vec4::new(0.5, 0.5, 0.0, 0.0), Vec4::new(0.0, 0.0, 0.0, 1.0));
        let (along, constant) = match self.perspective {
            true => (centre + Vec4::Z + one, -Vec4::Z),
            false => (Vec4::Z, centre + one),
        };
        let to_picture = Mat4::from_cols(Vec4::X * x, Vec4::Y * -y, along, constant) * to_camera;
        // Columns of a matrix for column vectors are the rows of that for row vectors.
        [to_camera, to_picture].map(|m| m.to_cols_array())
    }

    /// Where a point is in the picture, in pixels to the right and up from its middle, from where the camera stands at the
    /// picture's own moment or from `to_world`; `None` behind it.
    pub fn place(&self, to_world: Option<Affine3A>, p: Vec3) -> Option<Vec2> {
        let p = to_world.unwrap_or(self.to_world).inverse().transform_point3(p);
        let depth = if self.perspective { -p.z } else { 1.0 };
        let at = Vec2::new(p.x, p.y) * 0.5 * Vec2::from(self.size) / (Vec2::from(self.half) * depth);
        Some(at).filter(|at| at.is_finite() && depth > 0.0)
    }

    /// As [`Self::rays`], through the points of the lens that `u` and `v`, uniform in [0, 1), choose; through the pinhole
    /// where there is no lens.
    #[inline(always)]
    pub fn rays_through(&self, (x, y): (F, F), (u, v): (F, F), time: F) -> (V3, V3) {
        let stand = self.stand(time);
        let (origin, direction) = self.rays_from(&stand, x, y);
        match &self.lens {
            None => (origin, direction),
            Some(lens) => self.refracted(&stand, lens, (origin, direction), lens.point(u, v)),
        }
    }

    #[inline(always)]
    fn stand(&self, time: F) -> Stand {
        match &self.motion {
            None => {
                let m = &self.to_world.matrix3;
                let [right, up, back] = [m.x_axis, m.y_axis, m.z_axis].map(|axis| V3::splat(axis.into()));
                Stand { right, up, back, eye: V3::splat(self.to_world.translation.into()) }
            }
            Some(motion) => Self::moved(motion, time),
        }
    }

    #[inline(never)]
    fn moved(motion: &Motion, time: F) -> Stand {
        let at = time.to_array().map(|time| motion.at(time));
        let column = |of: fn(&Affine3A) -> Vec3A| V3::gather(eight(|lane| of(&at[lane]).into()));
        Stand {
            right: column(|m| m.matrix3.x_axis),
            up: column(|m| m.matrix3.y_axis),
            back: column(|m| m.matrix3.z_axis),
            eye: column(|m| m.translation),
        }
    }

    /// A pinhole's ray, bent to meet it in the plane of focus after it came through this point of the lens.
    #[inline(never)]
    fn refracted(
        &self,
        stand: &Stand,
        lens: &Lens,
        (origin, direction): (V3, V3),
        (across, above): (F, F),
    ) -> (V3, V3) {
        let distance = F::splat(-lens.focus) / direction.dot(stand.back);
        let aside = stand.right * across + stand.up * above;
        let toward = direction * distance - aside;
        (origin + aside, toward.normalize_or(direction))
    }

    /// Origins and unit directions through the picture's points (`x`, `y`) in pixels from its upper left corner, at times in
    /// [0, 1] of the shutter.
    #[inline(always)]
    pub fn rays(&self, x: F, y: F, time: F) -> (V3, V3) {
        self.rays_from(&self.stand(time), x, y)
    }

    #[inline(always)]
    fn rays_from(&self, &Stand { right, up, back, eye }: &Stand, x: F, y: F) -> (V3, V3) {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lanes::LANES;

    #[test]
    fn matrices_take_points_on_a_pixels_ray_back_to_the_pixel() {
        let pose = Mat3::from_rotation_y(0.7) * Mat3::from_rotation_x(-0.4) * Mat3::from_rotation_z(0.2);
        let to_world = Affine3A::from_mat3_translation(pose, Vec3::new(1.0, -2.0, 3.0));
        for projection in [Projection::Perspective { yfov: 0.8 }, Projection::Orthographic { xmag: 2.0, ymag: 1.5 }] {
            let camera =
                Camera { name: String::new(), projection, aspect: None, to_world, motion: None, adjacent_frames: None };
            let rays = CameraRays::new(&camera, 320, 200);
            let [to_camera, to_picture] = rays.matrices().map(|m| Mat4::from_cols_array(&m));
            for (x, y) in [(0.0, 0.0), (320.0, 200.0), (31.0, 170.0), (160.0, 100.0)] {
                let (origin, direction) = rays.rays(F::splat(x), F::splat(y), F::ZERO);
                let point = origin.lane(LANES - 1) + direction.lane(LANES - 1) * 5.0;
                let seen = to_camera.transform_point3(point);
                assert!(seen.z > 0.0 && seen.x.signum() * (x - 160.0) >= -1e-3, "{seen}");
                let at = to_picture.project_point3(point);
                assert!((at.x - x / 320.0).abs() < 1e-5 && (at.y - y / 200.0).abs() < 1e-5, "{projection:?}: {at}");
            }
        }
    }
}
