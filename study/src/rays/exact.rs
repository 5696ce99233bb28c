//! A ray and a triangle in double precision, with bounds on what single precision may get wrong.

use bismar::rays::{HitBatch, MISS, RayBatch};
use bismar::scene::Scene;
use glam::{DAffine3, DMat3, DVec3};

/// Rounding of one single-precision operation.
const ULP: f64 = f32::EPSILON as f64 / 2.0;

/// Operations that a bound allows for, one after the other: the subtraction, the cross product (3), the dot product
/// (5) and the division of Möller–Trumbore make 10, and transforming a ray to object space by an inverse that was
/// computed in single precision 10 more; twice that for their second-order terms and Embree's approximate reciprocal.
const OPERATIONS: f64 = 40.0;

#[derive(Debug, Clone, Copy)]
pub struct ExactRay {
    origin: DVec3,
    direction: DVec3,
    pub tnear: f64,
    pub tfar: f64,
}

impl ExactRay {
    pub fn new(rays: &RayBatch, i: usize) -> Self {
        Self {
            origin: rays.origin(i).as_dvec3(),
            direction: rays.direction(i).as_dvec3(),
            tnear: rays.tnear[i].into(),
            tfar: rays.tfar[i].into(),
        }
    }
}

/// A backend's answer for a ray.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hit {
    pub id: [u32; 3],
    /// Distance and the weights of the second and third vertex.
    pub at: [f32; 3],
}

impl Hit {
    /// Hit `i`; `None` for a miss.
    pub fn new(hits: &HitBatch, i: usize) -> Option<Self> {
        let id = [hits.instance[i], hits.mesh[i], hits.prim[i]];
        (hits.prim[i] != MISS).then(|| Self { id, at: [hits.t[i], hits.u[i], hits.v[i]] })
    }
}

/// Intersection of a ray with a triangle's plane.
#[derive(Debug, Clone, Copy)]
pub struct Plane {
    pub t: f64,
    /// Weights of the three corners.
    pub weights: [f64; 3],
    /// Bound on the rounding of the distance.
    pub t_error: f64,
    /// Bound on the rounding of a weight.
    pub weight_error: f64,
}

impl Plane {
    /// Smallest of the weights: negative outside of the triangle.
    pub fn inside(&self) -> f64 {
        self.weights.into_iter().fold(f64::INFINITY, f64::min)
    }

    /// Whether the ray is within rounding of an edge.
    pub(crate) fn at_edge(&self) -> bool {
        self.inside() <= self.weight_error
    }

    /// Whether the intersection is within rounding of either end of the ray's interval.
    pub(crate) fn at_end(&self, ray: &ExactRay) -> bool {
        self.t <= ray.tnear + self.t_error || self.t >= ray.tfar - self.t_error
    }

    /// Whether within rounding a hit is possible, and a backend's hit is the exact one.
    pub(crate) fn explains(&self, hit: &Hit, ray: &ExactRay) -> bool {
        let (e, te) = (self.weight_error, self.t_error);
        let possible = self.inside() >= -e && self.t >= ray.tnear - te && self.t <= ray.tfar + te;
        let [t, u, v] = hit.at.map(f64::from);
        let [_, exact_u, exact_v] = self.weights;
        possible && (t - self.t).abs() <= te && (u - exact_u).abs() <= e && (v - exact_v).abs() <= e
    }
}

/// Intersects a ray with a triangle's plane; `None` if they are parallel.
pub fn meet(scene: &Scene, ray: &ExactRay, [instance, mesh, prim]: [u32; 3]) -> Option<Plane> {
    let (to_object, condition) = match &scene.instances[instance as usize].transform {
        None => (DAffine3::IDENTITY, 1.0),
        Some(transform) => {
            let to_world = DAffine3::from_cols_array(&transform.to_cols_array().map(f64::from));
            let norm = |matrix: DMat3| matrix.to_cols_array().iter().map(|x| x * x).sum::<f64>().sqrt();
            let to_object = to_world.inverse();
            (to_object, norm(to_world.matrix3) * norm(to_object.matrix3))
        }
    };
    let data = &scene.meshes[mesh as usize];
    let corner = |i: u32| DVec3::from(data.positions[i as usize].map(f64::from));
    let [a, b, c] = data.indices[prim as usize].map(corner);
    let o = to_object.transform_point3(ray.origin);
    let d = to_object.transform_vector3(ray.direction);
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
    // Lengths that the single-precision arithmetic runs over.
    let far = o.length() + a.length() + to_object.translation.length();
    let edge = e1.length().max(e2.length());
    let steps = OPERATIONS * ULP * condition;
    // The determinant's own relative error belongs to it, too.
    let det_error = steps * edge * edge * d.length() / det.abs();
    let weight_error = steps * far * d.length() * edge / det.abs() + det_error * (1.0 + u.abs() + v.abs());
    let t_error = steps * far * edge * edge / det.abs() + det_error * t.abs();
    Some(Plane { t, weights: [1.0 - u - v, u, v], t_error, weight_error })
}
