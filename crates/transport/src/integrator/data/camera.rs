//! Camera rays.

use std::f32::consts::{PI, TAU};
use std::sync::Arc;

use glam::{Affine3A, Mat3, Mat4, Vec2, Vec3, Vec3A, Vec4};

use crate::lanes::{F, V3, eight};
use crate::scene::{Camera, Motion, Projection};

/// A thin lens.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lens {
    /// Radius of the aperture in metres, > 0.
    pub radius: f32,
    /// Distance of the focal plane along the view axis, in metres, > 0.
    pub focus: f32,
    /// Number of sides of the aperture, a regular polygon in the circle of `radius` with a corner to the right; 0 for a circle.
    pub blades: u32,
}

impl Lens {
    /// A point on the aperture, uniform for uniform `u` and `v` in [0, 1), in metres to the right and up.
    #[inline]
    pub fn point(&self, u: F, v: F) -> (F, F) {
        let radius = F::splat(self.radius);
        if self.blades == 0 {
            // The polar mapping: equal-area as the concentric one, and without branches.
            let (s, c) = (F::splat(TAU) * u).sin_cos();
            let r = radius * v.sqrt();
            return (r * c, r * s);
        }
        // Choose one of the triangles around the centre, then a point in it.
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

/// Generates the camera rays of a picture of a given size.
#[derive(Debug, Clone)]
pub struct CameraRays {
    to_world: Affine3A,
    motion: Option<Arc<Motion>>,
    /// Camera-to-world transforms of the previous and the next frame, see [`Camera::adjacent_frames`].
    pub adjacent_frames: Option<[Affine3A; 2]>,
    /// Half width and height of the picture at distance 1 (perspective) or of the view volume (orthographic), in metres; π and
    /// π/2 of a panorama, in radians.
    half: [f32; 2],
    size: [f32; 2],
    kind: Kind,
    lens: Option<Lens>,
    /// [`Camera::clip`].
    clip: Option<[f32; 2]>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Perspective,
    Orthographic,
    Panorama,
}

/// Eight camera poses in world space: unit axes and position.
struct CameraPose {
    right: V3,
    up: V3,
    back: V3,
    eye: V3,
}

impl CameraRays {
    /// A pinhole camera. The vertical field of view is the camera's; the horizontal one follows from the aspect of the
    /// picture, `width` × `height` pixels. A panorama covers all directions whatever the aspect.
    pub fn new(camera: &Camera, width: u32, height: u32) -> Self {
        let aspect = width as f32 / height as f32;
        let (half_height, kind) = match camera.projection {
            Projection::Perspective { yfov } => ((0.5 * yfov).tan(), Kind::Perspective),
            Projection::Orthographic { ymag, .. } => (ymag, Kind::Orthographic),
            Projection::Panorama => (0.5 * PI, Kind::Panorama),
        };
        let half_width = if kind == Kind::Panorama { PI } else { half_height * aspect };
        Self {
            to_world: camera.to_world,
            motion: camera.motion.clone(),
            adjacent_frames: camera.adjacent_frames,
            half: [half_width, half_height],
            size: [width as f32, height as f32],
            kind,
            lens: None,
            clip: camera.clip,
        }
    }

    /// Replaces the pinhole by a thin lens.
    pub fn with_lens(self, lens: Option<Lens>) -> Self {
        Self { lens, ..self }
    }

    /// The matrices of OpenEXR's `worldToCamera` and `worldToNDC`, row-major for row vectors. Camera space: x right, y up, z
    /// along the view. NDC, after division by w: x and y from 0 in the upper left to 1 in the lower right corner; `None` for a
    /// panorama, which no matrix projects.
    pub fn matrices(&self) -> ([f32; 16], Option<[f32; 16]>) {
        let m = &self.to_world.matrix3;
        let [right, up, forward] = [m.x_axis, m.y_axis, -m.z_axis].map(Vec3::from);
        let eye = Vec3::from(self.to_world.translation);
        let to_camera = Mat4::from_mat3(Mat3::from_cols(right, up, forward).transpose()) * Mat4::from_translation(-eye);
        // The columns are the images of x, y, z and 1 in camera space.
        let [x, y] = self.half.map(|half| 0.5 / half);
        let (centre, one) = (Vec4::new(0.5, 0.5, 0.0, 0.0), Vec4::new(0.0, 0.0, 0.0, 1.0));
        let (along, constant) = match self.kind {
            Kind::Perspective => (centre + Vec4::Z + one, -Vec4::Z),
            Kind::Orthographic => (Vec4::Z, centre + one),
            Kind::Panorama => return (to_camera.to_cols_array(), None),
        };
        let to_picture = Mat4::from_cols(Vec4::X * x, Vec4::Y * -y, along, constant) * to_camera;
        // A matrix for column vectors, column by column, is the one for row vectors, row by row.
        (to_camera.to_cols_array(), Some(to_picture.to_cols_array()))
    }

    /// Difference of two projected points ([`Self::project`]), pixels to the right and up: the shorter way around a panorama.
    pub fn displacement(&self, from: Vec2, to: Vec2) -> Vec2 {
        let mut by = to - from;
        if self.kind == Kind::Panorama {
            by.x -= self.size[0] * (by.x / self.size[0]).round();
        }
        by
    }

    /// Projects a world-space point into the picture: pixels to the right and up from the centre. The camera-to-world transform
    /// is `to_world`, or that of the frame itself. `None` for points behind the camera.
    pub fn project(&self, to_world: Option<Affine3A>, p: Vec3) -> Option<Vec2> {
        let p = to_world.unwrap_or(self.to_world).inverse().transform_point3(p);
        let (at, depth) = match self.kind {
            Kind::Perspective => (Vec2::new(p.x, p.y), -p.z),
            Kind::Orthographic => (Vec2::new(p.x, p.y), 1.0),
            Kind::Panorama => (Vec2::new(p.x.atan2(-p.z), p.y.atan2(p.x.hypot(p.z))), 1.0),
        };
        let at = at * 0.5 * Vec2::from(self.size) / (Vec2::from(self.half) * depth);
        Some(at).filter(|at| at.is_finite() && depth > 0.0)
    }

    /// World-space origins and unit directions of rays through the picture's points (`x`, `y`), in pixels from its upper left
    /// corner, and through the points of the lens that `u` and `v`, uniform in [0, 1), select. Without a lens the rays pass
    /// through the pinhole. `time` is in [0, 1] of the shutter interval.
    #[inline(always)]
    pub fn rays_through(&self, (x, y): (F, F), (u, v): (F, F), time: F) -> (V3, V3) {
        let pose = self.pose(time);
        let (origin, direction) = self.rays_from(&pose, x, y);
        match &self.lens {
            None => (origin, direction),
            Some(lens) => self.through_lens(&pose, lens, (origin, direction), lens.point(u, v)),
        }
    }

    /// Start and end of rays with these unit directions, in metres: between the clipping planes, which also cut what lies behind
    /// other surfaces. From 0 to infinity without planes.
    #[inline(always)]
    pub fn intervals(&self, direction: V3, time: F) -> (F, F) {
        match self.clip {
            None => (F::ZERO, F::splat(f32::INFINITY)),
            Some([near, far]) => {
                let per_depth = F::splat(-1.0) / direction.dot(self.pose(time).back);
                (F::splat(near) * per_depth, F::splat(far) * per_depth)
            }
        }
    }

    #[inline(always)]
    fn pose(&self, time: F) -> CameraPose {
        match &self.motion {
            None => {
                let m = &self.to_world.matrix3;
                let [right, up, back] = [m.x_axis, m.y_axis, m.z_axis].map(|axis| V3::splat(axis.into()));
                CameraPose { right, up, back, eye: V3::splat(self.to_world.translation.into()) }
            }
            Some(motion) => Self::moving_pose(motion, time),
        }
    }

    #[inline(never)]
    fn moving_pose(motion: &Motion, time: F) -> CameraPose {
        let at = time.to_array().map(|time| motion.at(time));
        let column = |of: fn(&Affine3A) -> Vec3A| V3::gather(eight(|lane| of(&at[lane]).into()));
        CameraPose {
            right: column(|m| m.matrix3.x_axis),
            up: column(|m| m.matrix3.y_axis),
            back: column(|m| m.matrix3.z_axis),
            eye: column(|m| m.translation),
        }
    }

    /// The ray from a point of the lens (metres right and up) to the point where the pinhole's ray meets the focal plane.
    #[inline(never)]
    fn through_lens(
        &self,
        pose: &CameraPose,
        lens: &Lens,
        (origin, direction): (V3, V3),
        (across, above): (F, F),
    ) -> (V3, V3) {
        let distance = F::splat(-lens.focus) / direction.dot(pose.back);
        let offset = pose.right * across + pose.up * above;
        let toward = direction * distance - offset;
        (origin + offset, toward.normalize_or(direction))
    }

    /// World-space origins and unit directions of pinhole rays through the picture's points (`x`, `y`), in pixels from its
    /// upper left corner. `time` is in [0, 1] of the shutter interval.
    #[inline(always)]
    pub fn rays(&self, x: F, y: F, time: F) -> (V3, V3) {
        self.rays_from(&self.pose(time), x, y)
    }

    #[inline(always)]
    fn rays_from(&self, pose: &CameraPose, x: F, y: F) -> (V3, V3) {
        let &CameraPose { right, up, back, eye } = pose;
        let sx = x.mul_add(F::splat(2.0 / self.size[0]), F::splat(-1.0)) * F::splat(self.half[0]);
        let sy = y.mul_add(F::splat(-2.0 / self.size[1]), F::ONE) * F::splat(self.half[1]);
        let across = right * sx + up * sy;
        match self.kind {
            Kind::Perspective => (eye, (across - back).normalize_or(back)),
            Kind::Orthographic => (eye + across, (V3::ZERO - back).normalize_or(back)),
            Kind::Panorama => Self::panorama_ray(pose, sx, sy),
        }
    }

    /// The ray at a longitude and a latitude in radians. Those of pixels' filters that reach beyond a pole or a side are on the
    /// other side of it.
    #[inline(never)]
    fn panorama_ray(&CameraPose { right, up, back, eye }: &CameraPose, longitude: F, latitude: F) -> (V3, V3) {
        let ((s, c), (rise, flat)) = (longitude.sin_cos(), latitude.sin_cos());
        let direction = right * (s * flat) + up * rise - back * (c * flat);
        (eye, direction.normalize_or(back))
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
            let camera = Camera {
                name: String::new(),
                projection,
                aspect: None,
                to_world,
                motion: None,
                adjacent_frames: None,
                framing: None,
                clip: None,
            };
            let rays = CameraRays::new(&camera, 320, 200);
            let (to_camera, to_picture) = rays.matrices();
            let [to_camera, to_picture] = [to_camera, to_picture.unwrap()].map(|m| Mat4::from_cols_array(&m));
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

    #[test]
    fn a_panorama_has_the_directions_of_an_environment_map_and_projects_them_back() {
        let (eye, width, height) = (Vec3::new(1.0, -2.0, 3.0), 64.0, 30.0);
        let rays = CameraRays::new(&Camera::panorama(eye), 64, 30);
        assert!(rays.matrices().1.is_none());
        for (x, y) in [(32.0, 15.0), (16.0, 15.0), (0.5, 0.5), (63.5, 29.5), (10.25, 20.0), (50.0, 3.0)] {
            let (origin, direction) = rays.rays(F::splat(x), F::splat(y), F::ZERO);
            let (origin, d) = (origin.lane(0), direction.lane(0));
            assert_eq!(origin, eye);
            assert!((d.length() - 1.0).abs() < 1e-6);
            // The formula of environment maps (`Environment`).
            let u = 0.5 + d.z.atan2(d.x) / TAU;
            let v = d.y.acos() / PI;
            assert!((u - x / width).abs() < 1e-5 && (v - y / height).abs() < 1e-5, "{x} {y}: {d} {u} {v}");
            let back = rays.project(None, eye + d * 7.0).unwrap();
            assert!((back - Vec2::new(x - 0.5 * width, 0.5 * height - y)).length() < 1e-3, "{back}");
        }
        // Across the seam the way is short.
        let by = rays.displacement(Vec2::new(31.0, 0.0), Vec2::new(-31.0, 1.0));
        assert!((by - Vec2::new(2.0, 1.0)).length() < 1e-5, "{by}");
        // A filter that reaches beyond the zenith sees what is behind it.
        let over = rays.rays(F::splat(20.0), F::splat(-0.5), F::ZERO).1.lane(0);
        let behind = rays.rays(F::splat(52.0), F::splat(0.5), F::ZERO).1.lane(0);
        assert!((over - behind).length() < 1e-5, "{over} {behind}");
    }
}
