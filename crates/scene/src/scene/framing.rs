//! The view that fits all of a scene: the default of those that have no camera.

use std::f64::consts::FRAC_PI_2;

use glam::{Affine3A, DVec3, Mat3A, Vec3A};

use super::{Camera, Projection};

/// Where the eye is, seen from the scene's middle: in front, right and a little above.
const FROM: DVec3 = DVec3::new(0.55, 0.35, 1.0);
/// Vertical field in radians.
const YFOV: f64 = 0.7;
/// How much wider than the scene the view is.
const MARGIN: f64 = 1.05;
/// Slopes of the view's sides that extremes are kept for, on either side.
const SLOPES: usize = 16;
/// Left, right, top and bottom by slope, and what is nearest.
const DIRECTIONS: usize = 4 * SLOPES + 1;

/// The outermost points of a scene as the default view sees them: enough to fit that view to any picture's aspect.
#[derive(Debug, Clone)]
pub struct Framing {
    directions: [DVec3; DIRECTIONS],
    /// How far along each direction the scene reaches, and where.
    extremes: [(f64, DVec3); DIRECTIONS],
}

/// To the right, up, and toward the eye.
fn axes() -> [DVec3; 3] {
    let z = FROM.normalize();
    let x = DVec3::Y.cross(z).normalize();
    [x, z.cross(x), z]
}

impl Default for Framing {
    fn default() -> Self {
        let [x, y, z] = axes();
        let side = |k: usize| {
            let slope = ((k / 4) as f64 + 0.5) * FRAC_PI_2 / SLOPES as f64;
            [x, -x, y, -y][k % 4] * slope.cos() + z * slope.sin()
        };
        let directions = std::array::from_fn(|k| if k < 4 * SLOPES { side(k) } else { z });
        Self { directions, extremes: [(f64::NEG_INFINITY, DVec3::ZERO); DIRECTIONS] }
    }
}

impl Framing {
    /// What the view is called.
    pub const NAME: &str = "framed";

    /// Takes a point in.
    pub fn include(&mut self, p: DVec3) {
        for (direction, extreme) in self.directions.iter().zip(&mut self.extremes) {
            let along = direction.dot(p);
            if along > extreme.0 {
                *extreme = (along, p);
            }
        }
    }

    /// The camera from whose picture of this aspect (width over height) nothing is cut off, as near as can be: what is
    /// projected lies in the middle of it.
    pub fn camera(&self, aspect: f64) -> Camera {
        let axes @ [x, y, z] = axes();
        let seen = self.extremes.iter().filter(|(along, _)| along.is_finite());
        let mut points: Vec<_> = seen.map(|(_, p)| DVec3::from(axes.map(|axis| axis.dot(*p)))).collect();
        if points.is_empty() {
            points.extend([DVec3::ONE, DVec3::NEG_ONE]);
        }
        let high = (0.5 * YFOV).tan() / MARGIN;
        // A point at p is inside the upper plane of an eye at e if p.y - e.y <= slope * (e.z - p.z), and so for the others.
        let reach = |slope: f64, along: &dyn Fn(DVec3) -> f64| {
            points.iter().map(|p| along(*p) + slope * p.z).fold(f64::NEG_INFINITY, f64::max)
        };
        let far_enough = |slope: f64, along: &dyn Fn(DVec3) -> f64| {
            0.5 * (reach(slope, along) + reach(slope, &|p| -along(p))) / slope
        };
        let (far, tall) = (far_enough(high * aspect, &|p| p.x), far_enough(high, &|p| p.y));
        let near = reach(0.0, &|p| p.z);
        let size = points.iter().map(|p| p.abs().max_element()).fold(0.0, f64::max);
        // A point has no extent: a metre from it is as good as any place.
        let distance = if far.max(tall) > near + 1e-6 * size { far.max(tall) } else { near + 1.0 };
        // What is projected reaches as far to either side: the eye's place falls by halves.
        let centred = |along: &dyn Fn(DVec3) -> f64| {
            let (mut low, mut high) = (-reach(0.0, &|p| -along(p)), reach(0.0, along));
            for _ in 0..60 {
                let eye = 0.5 * (low + high);
                let shown = points.iter().map(|p| (along(*p) - eye) / (distance - p.z));
                let (least, most) = shown.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), s| (a.min(s), b.max(s)));
                if least + most > 0.0 { low = eye } else { high = eye }
            }
            0.5 * (low + high)
        };
        let eye = x * centred(&|p| p.x) + y * centred(&|p| p.y) + z * distance;
        let column = |v: DVec3| Vec3A::from(v.as_vec3());
        Camera {
            motion: None,
            adjacent_frames: None,
            name: Self::NAME.into(),
            projection: Projection::Perspective { yfov: YFOV as f32 },
            aspect: None,
            to_world: Affine3A { matrix3: Mat3A::from_cols(column(x), column(y), column(z)), translation: column(eye) },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    #[test]
    fn every_aspect_sees_all_of_it_touches_two_edges_and_is_centred() {
        // A ball and a pole beside it, far from the origin.
        let mut points: Vec<DVec3> = (0..2000)
            .map(|i| {
                let (turn, height) = (f64::from(i) * 2.4, 1.0 - f64::from(i) / 1000.0);
                let radius = (1.0 - height * height).sqrt();
                DVec3::new(100.0 + radius * turn.cos(), height, -20.0 + radius * turn.sin())
            })
            .collect();
        points.push(DVec3::new(101.0, 4.0, -20.0));
        let mut framing = Framing::default();
        points.iter().for_each(|p| framing.include(*p));
        for aspect in [0.1, 0.5, 1.0, 16.0 / 9.0, 4.0] {
            let camera = framing.camera(aspect);
            let Projection::Perspective { yfov } = camera.projection else { panic!("perspective wanted") };
            let to_camera = camera.to_world.inverse();
            let half = (0.5 * yfov).tan();
            let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
            for p in &points {
                let p = to_camera.transform_point3(p.as_vec3());
                assert!(p.z < 0.0);
                let at = Vec3::new(p.x / (-p.z * half * aspect as f32), p.y / (-p.z * half), 0.0);
                (low, high) = (low.min(at), high.max(at));
            }
            let most = high.max(-low).truncate();
            assert!(most.max_element() <= 1.0 && most.max_element() > 0.94, "{aspect}: {low} {high}");
            assert!((low + high).abs().max_element() < 0.005, "{aspect}: {low} {high}");
        }
    }

    #[test]
    fn nothing_and_a_point_have_a_view_too() {
        assert!(Framing::default().camera(1.0).to_world.is_finite());
        let mut point = Framing::default();
        point.include(DVec3::new(5.0, 6.0, 7.0));
        let seen = point.camera(2.0).to_world.inverse().transform_point3(Vec3::new(5.0, 6.0, 7.0));
        assert!((seen - Vec3::NEG_Z).length() < 1e-4, "{seen}");
    }
}
