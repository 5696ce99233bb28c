//! The view that shows all of a scene: the default for scenes without a camera.

use std::f64::consts::FRAC_PI_2;

use glam::{Affine3A, DAffine3, DMat3, DVec3};

/// Direction from the scene to the eye: from the front, the right and slightly above.
const EYE_DIRECTION: DVec3 = DVec3::new(0.55, 0.35, 1.0);
/// Width of the view relative to the scene.
const MARGIN: f64 = 1.05;
/// Slopes of the view frustum's sides for which the outermost point is kept, per side.
const SLOPES: usize = 16;
/// Left, right, top and bottom for each slope, and the direction to the eye.
const DIRECTIONS: usize = 4 * SLOPES + 1;

/// The outermost points of a scene as the default view sees them: enough to fit that view to any aspect of a picture.
#[derive(Debug, Clone)]
pub struct Framing {
    /// Their x, y and z.
    directions: [[f64; DIRECTIONS]; 3],
    /// Largest distance along each direction, and the point at that distance.
    reached: [f64; DIRECTIONS],
    points: [DVec3; DIRECTIONS],
}

/// The view's axes in world space: right, up, toward the eye.
fn view_axes() -> [DVec3; 3] {
    let z = EYE_DIRECTION.normalize();
    let x = DVec3::Y.cross(z).normalize();
    [x, z.cross(x), z]
}

impl Default for Framing {
    fn default() -> Self {
        let [x, y, z] = view_axes();
        let side = |k: usize| {
            let slope = ((k / 4) as f64 + 0.5) * FRAC_PI_2 / SLOPES as f64;
            [x, -x, y, -y][k % 4] * slope.cos() + z * slope.sin()
        };
        let directions: [DVec3; DIRECTIONS] = std::array::from_fn(|k| if k < 4 * SLOPES { side(k) } else { z });
        let directions = [0, 1, 2].map(|axis| directions.map(|direction| direction[axis]));
        Self { directions, reached: [f64::NEG_INFINITY; DIRECTIONS], points: [DVec3::ZERO; DIRECTIONS] }
    }
}

impl Framing {
    /// Name of the view.
    pub const NAME: &str = "framed";
    /// Vertical field of view in radians.
    pub const YFOV: f64 = 0.7;

    /// Adds a point (world space) that the view must show.
    pub fn include(&mut self, p: DVec3) {
        let [x, y, z] = &self.directions;
        let (mut along, mut grows) = ([0.0; DIRECTIONS], false);
        for k in 0..DIRECTIONS {
            along[k] = x[k] * p.x + y[k] * p.y + z[k] * p.z;
            grows |= along[k] > self.reached[k];
        }
        if grows {
            for (k, along) in along.into_iter().enumerate() {
                if along > self.reached[k] {
                    (self.reached[k], self.points[k]) = (along, p);
                }
            }
        }
    }

    /// Adds points (world space) that lie near each other: at once if their box lies below what is reached.
    pub fn include_near(&mut self, points: &[DVec3]) {
        let low = points.iter().copied().fold(DVec3::INFINITY, DVec3::min);
        let high = points.iter().copied().fold(DVec3::NEG_INFINITY, DVec3::max);
        let (c, half, [x, y, z]) = (0.5 * (low + high), 0.5 * (high - low), &self.directions);
        let mut grows = false;
        for k in 0..DIRECTIONS {
            let centre = x[k] * c.x + y[k] * c.y + z[k] * c.z;
            let extent = x[k].abs() * half.x + y[k].abs() * half.y + z[k].abs() * half.z;
            grows |= centre + extent > self.reached[k];
        }
        if grows {
            points.iter().for_each(|p| self.include(*p));
        }
    }

    /// Camera to world of the nearest view whose picture of this aspect (width over height) shows every point; the
    /// projected points are centred.
    pub fn to_world(&self, aspect: f64) -> Affine3A {
        let axes @ [x, y, z] = view_axes();
        let seen = self.points.iter().zip(&self.reached).filter(|(_, along)| along.is_finite());
        let mut points: Vec<_> = seen.map(|(p, _)| DVec3::from(axes.map(|axis| axis.dot(*p)))).collect();
        if points.is_empty() {
            points.extend([DVec3::ONE, DVec3::NEG_ONE]);
        }
        let high = (0.5 * Self::YFOV).tan() / MARGIN;
        // A point p lies below the upper plane of an eye e if p.y - e.y <= slope * (e.z - p.z); the other planes alike.
        let reach = |slope: f64, along: &dyn Fn(DVec3) -> f64| {
            points.iter().map(|p| along(*p) + slope * p.z).fold(f64::NEG_INFINITY, f64::max)
        };
        let far_enough = |slope: f64, along: &dyn Fn(DVec3) -> f64| {
            0.5 * (reach(slope, along) + reach(slope, &|p| -along(p))) / slope
        };
        let (far, tall) = (far_enough(high * aspect, &|p| p.x), far_enough(high, &|p| p.y));
        let near = reach(0.0, &|p| p.z);
        let size = points.iter().map(|p| p.abs().max_element()).fold(0.0, f64::max);
        // A single point has no extent: the eye is placed one metre away.
        let distance = if far.max(tall) > near + 1e-6 * size { far.max(tall) } else { near + 1.0 };
        // Bisection for the eye position from which the projected points extend equally to both sides.
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
        DAffine3 { matrix3: DMat3::from_cols(x, y, z), translation: eye }.as_affine3a()
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
            let to_camera = framing.to_world(aspect).inverse();
            let half = (0.5 * Framing::YFOV as f32).tan();
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
        assert!(Framing::default().to_world(1.0).is_finite());
        let mut point = Framing::default();
        point.include(DVec3::new(5.0, 6.0, 7.0));
        let seen = point.to_world(2.0).inverse().transform_point3(Vec3::new(5.0, 6.0, 7.0));
        assert!((seen - Vec3::NEG_Z).length() < 1e-4, "{seen}");
    }
}
