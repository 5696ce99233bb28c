//! Camera rays.

use std::f32::consts::{PI, TAU};
use std::sync::Arc;

use glam::{Affine3A, Mat3, Mat4, Vec2, Vec3, Vec3A, Vec4};

use crate::lanes::{F, V3, eight};
use crate::scene::calibration::{Distortion, NODES, STEPS, Undistortion};
use crate::scene::{Calibration, Camera, Motion, Projection};

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
    /// The principal point in halves of the picture, from its upper left corner: 1 in the middle.
    middle: [f32; 2],
    size: [f32; 2],
    kind: Kind,
    lens: Option<Lens>,
    /// [`Camera::clip`].
    clip: Option<[f32; 2]>,
}

#[derive(Debug, Clone)]
enum Kind {
    Perspective,
    Orthographic,
    Panorama,
    Distorted(Arc<Distorted>),
}

/// What a camera with distortion needs for its rays.
#[derive(Debug)]
struct Distorted {
    calibration: Calibration,
    distortion: Distortion<F>,
    inverse: Undistortion,
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
    /// A calibrated camera shows the same at every size.
    pub fn new(camera: &Camera, width: u32, height: u32) -> Self {
        let aspect = width as f32 / height as f32;
        let calibration = match camera.projection {
            Projection::Calibrated(of) => Some(of.scaled(width, height)),
            _ => None,
        };
        let (half_height, kind) = match camera.projection {
            Projection::Perspective { yfov } => ((0.5 * yfov).tan(), Kind::Perspective),
            Projection::Orthographic { ymag, .. } => (ymag, Kind::Orthographic),
            Projection::Panorama => (0.5 * PI, Kind::Panorama),
            Projection::Calibrated(of) => ((0.5 * of.h / of.fl_y) as f32, Kind::Perspective),
        };
        let half_width = match calibration {
            Some(of) => (0.5 * of.w / of.fl_x) as f32,
            None if matches!(kind, Kind::Panorama) => PI,
            None => half_height * aspect,
        };
        let distorted = calibration.filter(|of| !of.is_linear()).map(|calibration| {
            let distortion = calibration.distortion().map(|x| F::splat(x as f32));
            Kind::Distorted(Arc::new(Distorted { calibration, distortion, inverse: calibration.undistortion().0 }))
        });
        Self {
            to_world: camera.to_world,
            motion: camera.motion.clone(),
            adjacent_frames: camera.adjacent_frames,
            half: [half_width, half_height],
            middle: calibration.map_or([1.0; 2], |of| [2.0 * of.cx / of.w, 2.0 * of.cy / of.h].map(|x| x as f32)),
            size: [width as f32, height as f32],
            kind: distorted.unwrap_or(kind),
            lens: None,
            clip: camera.clip,
        }
    }

    /// Replaces the pinhole by a thin lens.
    pub fn with_lens(self, lens: Option<Lens>) -> Self {
        Self { lens, ..self }
    }

    /// The matrices of OpenEXR's `worldToCamera` and `worldToNDC`, row-major for row vectors. Camera space: x right, y up, z
    /// along the view. NDC, after division by w: x and y from 0 in the upper left to 1 in the lower right corner; `None` for
    /// panoramas and lenses with distortion, which no matrix projects.
    pub fn matrices(&self) -> ([f32; 16], Option<[f32; 16]>) {
        let m = &self.to_world.matrix3;
        let [right, up, forward] = [m.x_axis, m.y_axis, -m.z_axis].map(Vec3::from);
        let eye = Vec3::from(self.to_world.translation);
        let to_camera = Mat4::from_mat3(Mat3::from_cols(right, up, forward).transpose()) * Mat4::from_translation(-eye);
        // The columns are the images of x, y, z and 1 in camera space.
        let [x, y] = self.half.map(|half| 0.5 / half);
        let [across, down] = self.middle.map(|middle| 0.5 * middle);
        let (centre, one) = (Vec4::new(across, down, 0.0, 0.0), Vec4::new(0.0, 0.0, 0.0, 1.0));
        let (along, constant) = match self.kind {
            Kind::Perspective => (centre + Vec4::Z + one, -Vec4::Z),
            Kind::Orthographic => (Vec4::Z, centre + one),
            Kind::Panorama | Kind::Distorted(_) => return (to_camera.to_cols_array(), None),
        };
        let to_picture = Mat4::from_cols(Vec4::X * x, Vec4::Y * -y, along, constant) * to_camera;
        // A matrix for column vectors, column by column, is the one for row vectors, row by row.
        (to_camera.to_cols_array(), Some(to_picture.to_cols_array()))
    }

    /// Difference of two projected points ([`Self::project`]), pixels to the right and up: the shorter way around a panorama.
    pub(crate) fn displacement(&self, from: Vec2, to: Vec2) -> Vec2 {
        let mut by = to - from;
        if matches!(self.kind, Kind::Panorama) {
            by.x -= self.size[0] * (by.x / self.size[0]).round();
        }
        by
    }

    /// Projects a world-space point into the picture: pixels to the right and up from the centre. The camera-to-world transform
    /// is `to_world`, or that of the frame itself. `None` for points behind the camera.
    pub(crate) fn project(&self, to_world: Option<Affine3A>, p: Vec3) -> Option<Vec2> {
        let p = to_world.unwrap_or(self.to_world).inverse().transform_point3(p);
        let (at, depth) = match &self.kind {
            Kind::Distorted(lens) => return lens.project(p),
            Kind::Perspective => (Vec2::new(p.x, p.y), -p.z),
            Kind::Orthographic => (Vec2::new(p.x, p.y), 1.0),
            Kind::Panorama => (Vec2::new(p.x.atan2(-p.z), p.y.atan2(p.x.hypot(p.z))), 1.0),
        };
        let at = at * 0.5 * Vec2::from(self.size) / (Vec2::from(self.half) * depth);
        let at = at + 0.5 * Vec2::from(self.size) * Vec2::new(self.middle[0] - 1.0, 1.0 - self.middle[1]);
        Some(at).filter(|at| at.is_finite() && depth > 0.0)
    }

    /// World-space origins and unit directions of rays through the picture's points (`x`, `y`), in pixels from its upper left
    /// corner, and through the points of the lens that `u` and `v`, uniform in [0, 1), select. Without a lens the rays pass
    /// through the pinhole. `time` is in [0, 1] of the shutter interval.
    #[inline(always)]
    pub(crate) fn rays_through(&self, (x, y): (F, F), (u, v): (F, F), time: F) -> (V3, V3) {
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
        let sx = x.mul_add(F::splat(2.0 / self.size[0]), F::splat(-self.middle[0])) * F::splat(self.half[0]);
        let sy = y.mul_add(F::splat(-2.0 / self.size[1]), F::splat(self.middle[1])) * F::splat(self.half[1]);
        let across = right * sx + up * sy;
        match &self.kind {
            Kind::Perspective => (eye, (across - back).normalize_or(back)),
            Kind::Orthographic => (eye + across, (V3::ZERO - back).normalize_or(back)),
            Kind::Panorama => Self::panorama_ray(pose, sx, sy),
            Kind::Distorted(lens) => (eye, lens.direction(pose, sx, F::ZERO - sy)),
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

impl Distorted {
    /// Unit directions through points of the plane at distance 1, to the right and down: interpolated between the nodes of the
    /// inverse, then by as many steps of Newton's method for all rays, so that a ray's bits do not depend on its neighbours.
    #[inline(never)]
    fn direction(&self, &CameraPose { right, up, back, .. }: &CameraPose, x: F, y: F) -> V3 {
        let [low, high] = self.inverse.corners;
        let cells = (NODES - 1) as f32;
        let along = |at: F, axis: usize| {
            let at = at.fast_max(F::splat(low[axis] as f32)).fast_min(F::splat(high[axis] as f32));
            let per_unit = f64::from(cells) / (high[axis] - low[axis]);
            let place = (at - F::splat(low[axis] as f32)) * F::splat(per_unit as f32);
            let cell = place.floor().fast_max(F::ZERO).fast_min(F::splat(cells - 1.0));
            (at, cell, place - cell)
        };
        let ((x, column, u), (y, row, v)) = (along(x, 0), along(y, 1));
        let first = row.mul_add(F::splat(NODES as f32), column).to_array().map(|first| first as usize);
        let node = |offset: usize| {
            let at = eight(|lane| self.inverse.nodes.get(first[lane] + offset).copied().unwrap_or_default());
            [0, 1].map(|axis| F::from(eight(|lane| at[lane][axis])))
        };
        let mix = |a: [F; 2], b: [F; 2], t: F| [a[0] + (b[0] - a[0]) * t, a[1] + (b[1] - a[1]) * t];
        let mut at = mix(mix(node(0), node(1), u), mix(node(NODES), node(NODES + 1), u), v);
        for _ in 0..STEPS {
            at = self.distortion.step(at, [x, y]);
        }
        let [across, down] = at;
        let direction = if self.calibration.fisheye {
            let angle = across.mul_add(across, down * down).sqrt();
            let (s, c) = angle.sin_cos();
            let share = angle.simd_gt(F::splat(1e-6)).select(s / angle, F::ONE);
            (right * across - up * down) * share - back * c
        } else {
            right * across - up * down - back
        };
        direction.normalize_or(V3::ZERO - back)
    }

    /// [`CameraRays::project`] of a point in camera space.
    fn project(&self, p: Vec3) -> Option<Vec2> {
        let of = &self.calibration;
        let [x, y, z] = [p.x, -p.y, -p.z].map(f64::from);
        let across = x.hypot(y);
        let per_metre = if of.fisheye && across > 0.0 { across.atan2(z) / across } else { 1.0 / z };
        let ([u, v], _) = of.distortion().at([x * per_metre, y * per_metre]);
        let at = Vec2::new((of.fl_x * u + of.cx - 0.5 * of.w) as f32, (0.5 * of.h - of.cy - of.fl_y * v) as f32);
        Some(at).filter(|at| at.is_finite() && (of.fisheye || z > 0.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lanes::LANES;
    use crate::scene::PlacedCamera;

    #[test]
    fn matrices_take_points_on_a_pixels_ray_back_to_the_pixel() {
        let pose = Mat3::from_rotation_y(0.7) * Mat3::from_rotation_x(-0.4) * Mat3::from_rotation_z(0.2);
        let to_world = Affine3A::from_mat3_translation(pose, Vec3::new(1.0, -2.0, 3.0));
        for projection in [Projection::Perspective { yfov: 0.8 }, Projection::Orthographic { xmag: 2.0, ymag: 1.5 }] {
            let camera = Camera { projection, to_world, ..Camera::panorama(Vec3::ZERO) };
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

    /// Cameras, points of OpenCV's camera space in metres, and where `cv2.projectPoints` and `cv2.fisheye.projectPoints` of
    /// OpenCV 5 put them, from the middle of the upper left pixel. The angles from the axis are up to 60 degrees.
    #[test]
    fn rays_of_calibrated_cameras_go_where_opencv_projects_from() {
        let cameras = [
            (
                "pinhole:1920:1080:840:862:971.8:533.3:0.5:0.06:0.002:0.8:0.14:0.006:0.0006:-0.0004",
                vec![
                    ([0.0, 0.0, 3.0], [971.3000, 532.8000]),
                    ([-1.1914, -0.4336, 2.7189], [624.6167, 403.4628]),
                    ([0.4229, 1.5782, 2.516], [1097.8231, 1018.0924]),
                    ([1.8121, -0.6595, 2.2981], [1530.5548, 324.2086]),
                    ([-1.9583, 0.7128, 2.158], [351.3865, 764.7168]),
                    ([-2.5751, -0.2253, 1.5226], [48.5219, 451.5277]),
                    ([2.2917, -1.2185, 1.5045], [1790.0256, 87.0750]),
                ],
            ),
            (
                "pinhole:1920:1080:1100:1092:942.2:551.7:-0.28:0.09:-0.012:0:0:0:-0.0008:0.0005",
                vec![
                    ([0.0, 0.0, 3.0], [941.7000, 551.2000]),
                    ([-1.1914, -0.4336, 2.7189], [487.2521, 386.7772]),
                    ([1.8121, -0.6595, 2.2981], [1674.6059, 285.9292]),
                    ([-1.9583, 0.7128, 2.158], [137.6770, 841.0979]),
                ],
            ),
            (
                "fisheye:1920:1080:520:523:955.5:546:0.03:-0.008:0.004:-0.0004:0:0:0:0",
                vec![
                    ([0.0, 0.0, 3.0], [955.0000, 545.5000]),
                    ([-1.1914, -0.4336, 2.7189], [740.6259, 467.0303]),
                    ([0.4229, 1.5782, 2.516], [1033.2328, 839.1374]),
                    ([1.8121, -0.6595, 2.2981], [1300.6340, 418.9834]),
                    ([-1.9583, 0.7128, 2.158], [573.8646, 685.0295]),
                    ([-2.5751, -0.2253, 1.5226], [402.2362, 496.8587]),
                    ([2.2917, -1.2185, 1.5045], [1448.3960, 281.6472]),
                ],
            ),
        ];
        for (text, points) in cameras {
            let placed = format!("1,0,0,0,0,1,0,0,0,0,1,0,0,0,0,1,{text},a").parse::<PlacedCamera>().unwrap();
            let rays = CameraRays::new(&placed.camera(1.0).unwrap(), 1920, 1080);
            assert!(rays.matrices().1.is_none());
            let ray = |x: f64, y: f64| rays.rays(F::splat(x as f32), F::splat(y as f32), F::ZERO).1.lane(3);
            let pixel = |p: Vec3| rays.project(None, p).map(|at| [at.x + 960.0, 540.0 - at.y].map(f64::from)).unwrap();
            for ([x, y, z], [u, v]) in points {
                let (u, v) = (u + 0.5, v + 0.5);
                let seen = pixel(Vec3::new(x, -y, -z));
                assert!((seen[0] - u).hypot(seen[1] - v) < 1e-3, "{text}: {seen:?} {u} {v}");
                let (to, d) = (Vec3::new(x, -y, -z).normalize(), ray(u, v));
                // A hundredth of a pixel where there are most in an angle.
                assert!(to.distance(d) * 4.0 * 1100.0 < 0.01, "{text}: {to} {d}");
            }
            for (x, y) in (0..=80).flat_map(|x| (0..=45).map(move |y| (24.0 * f64::from(x), 24.0 * f64::from(y)))) {
                let seen = pixel(ray(x, y) * 7.0);
                assert!((seen[0] - x).hypot(seen[1] - y) < 5e-3, "{text}: {x} {y} {seen:?}");
            }
        }
    }

    #[test]
    fn a_calibrated_camera_without_distortion_is_a_shifted_pinhole_with_a_matrix() {
        let text = "0,0,1,2,0,1,0,-1,-1,0,0,3,0,0,0,1,pinhole:320:200:150:170:130:120.5:0:0:0:0:0:0:0:0,a";
        let rays = CameraRays::new(&text.parse::<PlacedCamera>().unwrap().camera(1.0).unwrap(), 640, 400);
        let matrix = Mat4::from_cols_array(&rays.matrices().1.unwrap());
        for (x, y) in [(0.0, 0.0), (640.0, 400.0), (260.0, 241.0), (31.0, 370.0)] {
            let (origin, direction) = rays.rays(F::splat(x), F::splat(y), F::ZERO);
            let [origin, d] = [origin.lane(0), direction.lane(0)];
            // The matrix turns the camera's axes: right is -z, back is +x.
            let (across, down) = ((x / 2.0 - 130.0) / 150.0, (y / 2.0 - 120.5) / 170.0);
            assert!(d.distance(Vec3::new(-1.0, -down, -across).normalize()) < 1e-6, "{d}");
            let at = matrix.project_point3(origin + d * 5.0);
            assert!((at.x - x / 640.0).abs() < 1e-5 && (at.y - y / 400.0).abs() < 1e-5, "{at}");
            let seen = rays.project(None, origin + d * 5.0).unwrap();
            assert!((seen - Vec2::new(x - 320.0, 200.0 - y)).length() < 1e-3, "{seen}");
        }
    }
}
