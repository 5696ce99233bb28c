//! Brute-force ray tracing in double precision, with error bounds for single precision.

use bismar::rays::{HitBatch, MISS, RayBatch};
use bismar::scene::{Primitive, Scene};
use glam::{DAffine3, DVec3};

/// Rounding of one single-precision operation.
const ULP: f64 = f32::EPSILON as f64 / 2.0;

/// Number of sequential operations in a bound. Möller–Trumbore has 10: the subtraction, the cross product (3), the dot product
/// (5) and the division. Transforming a ray to object space by an inverse of single precision has 10 more. The sum is doubled
/// for second-order terms and Embree's approximate reciprocal.
const OPERATIONS: f64 = 40.0;

struct Triangle {
    primitive: Primitive,
    /// World to object.
    to_object: DAffine3,
    /// Largest growth of a rounding error through `to_object` and back.
    condition: f64,
    corners: [DVec3; 3],
    single_sided: bool,
}

/// Intersection with a triangle's plane, with error bounds.
struct PlaneHit {
    t: f64,
    /// Weights of the three corners.
    weights: [f64; 3],
    t_error: f64,
    weight_error: f64,
    is_back: bool,
}

pub struct Reference {
    triangles: Vec<Triangle>,
    /// Do backs of single-sided triangles count?
    backs: bool,
}

impl Reference {
    pub fn new(scene: &Scene, backs: bool) -> Self {
        let mut triangles = Vec::new();
        for (index, instance) in scene.instances.iter().enumerate() {
            let to_world: DAffine3 = match instance.transform {
                Some(transform) => DAffine3::from_cols_array(&transform.to_cols_array().map(f64::from)),
                None => DAffine3::IDENTITY,
            };
            let norm = |matrix: glam::DMat3| matrix.to_cols_array().iter().map(|x| x * x).sum::<f64>().sqrt();
            let to_object = to_world.inverse();
            let condition = match instance.transform {
                Some(_) => norm(to_world.matrix3) * norm(to_object.matrix3),
                None => 1.0,
            };
            for mesh in scene.objects[instance.object as usize].meshes.clone() {
                let data = &scene.meshes[mesh as usize];
                let single_sided = !scene.materials[data.material as usize].double_sided;
                for (prim, corners) in data.indices.iter().enumerate() {
                    let corners = corners.map(|v| DVec3::from(data.positions[v as usize].map(f64::from)));
                    let primitive = Primitive { instance: index as u32, mesh, prim: prim as u32 };
                    triangles.push(Triangle { primitive, to_object, condition, corners, single_sided });
                }
            }
        }
        Self { triangles, backs }
    }

    /// Panics if a hit cannot be the closest one within rounding. Returns the number of rays with a unique answer within
    /// rounding: that triangle, or a miss.
    pub fn check(&self, rays: &RayBatch, hits: &HitBatch) -> usize {
        assert_eq!(hits.len(), rays.len());
        let mut unique = 0;
        for at in 0..rays.len() {
            let vector = |of: &[Vec<f32>; 3]| DVec3::new(of[0][at].into(), of[1][at].into(), of[2][at].into());
            let (origin, direction) = (vector(&rays.origin), vector(&rays.direction));
            let (tnear, tfar) = (f64::from(rays.tnear[at]), f64::from(rays.tfar[at]));
            let (mut sure, mut possible) = (f64::INFINITY, Vec::new());
            let mut of_hit = None;
            for triangle in &self.triangles {
                let Some(plane) = triangle.meet(origin, direction) else { continue };
                if !self.backs && triangle.single_sided && plane.is_back {
                    continue;
                }
                let least = plane.weights.into_iter().fold(f64::INFINITY, f64::min);
                let (e, te) = (plane.weight_error, plane.t_error);
                if least > e && plane.t > tnear + te && plane.t < tfar - te {
                    sure = sure.min(plane.t + te);
                }
                if least >= -e && plane.t >= tnear - te && plane.t <= tfar + te {
                    possible.push(plane.t - te);
                }
                if triangle.primitive == hits.primitive(at) {
                    of_hit = Some((plane, least));
                }
            }
            let what = format!("ray {at} from {origin} to {direction} in {tnear}..{tfar}");
            if hits.prim[at] == MISS {
                assert_eq!(sure, f64::INFINITY, "{what} misses what it hits at {sure}");
                assert!(hits.t[at] == f32::INFINITY && hits.instance[at] == MISS && hits.mesh[at] == MISS);
                unique += usize::from(possible.is_empty());
                continue;
            }
            let (plane, least) = of_hit.expect("a triangle of the scene");
            let (t, u, v) = (f64::from(hits.t[at]), f64::from(hits.u[at]), f64::from(hits.v[at]));
            let (e, te) = (plane.weight_error, plane.t_error);
            assert!(least >= -e, "{what} is said to hit a triangle that it passes by {least}");
            assert!((t - plane.t).abs() <= te, "{what}: t {t} is not {} ± {te}", plane.t);
            assert!((u - plane.weights[1]).abs() <= e, "{what}: u {u} is not {} ± {e}", plane.weights[1]);
            assert!((v - plane.weights[2]).abs() <= e, "{what}: v {v} is not {} ± {e}", plane.weights[2]);
            assert!(plane.t - te <= sure, "{what} is said to hit at {t} but hits at {sure} before");
            assert!(t >= tnear && t <= tfar, "{what}: t {t}");
            assert!(hits.back[at] == plane.is_back || e > 1e-3, "{what}: the side");
            unique += usize::from(possible.iter().filter(|&&t| t <= sure).count() == 1);
        }
        unique
    }
}

impl Triangle {
    fn meet(&self, origin: DVec3, direction: DVec3) -> Option<PlaneHit> {
        let [a, b, c] = self.corners;
        let o = self.to_object.transform_point3(origin);
        let d = self.to_object.transform_vector3(direction);
        let (e1, e2) = (b - a, c - a);
        let normal = e1.cross(e2);
        let det = -normal.dot(d);
        if det == 0.0 {
            return None;
        }
        let s = o - a;
        // Cramer's rule for u e1 + v e2 − t d = s.
        let u = s.dot(d.cross(e2)) / det;
        let v = e1.dot(d.cross(s)) / det;
        let t = normal.dot(s) / det;
        // Lengths that occur in the single-precision computation.
        let far = o.length() + a.length() + self.to_object.translation.length();
        let edge = e1.length().max(e2.length());
        let steps = OPERATIONS * ULP * self.condition;
        // Relative error of the determinant.
        let det_error = steps * edge * edge * d.length() / det.abs();
        let weight_error = steps * far * d.length() * edge / det.abs() + det_error * (1.0 + u.abs() + v.abs());
        let t_error = steps * far * edge * edge / det.abs() + det_error * t.abs();
        Some(PlaneHit { t, weights: [1.0 - u - v, u, v], t_error, weight_error, is_back: det < 0.0 })
    }
}
