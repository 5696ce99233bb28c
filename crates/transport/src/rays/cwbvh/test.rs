//! Ray-triangle tests without back-face culling.

use obvhs::ray::Ray;
use obvhs::rt_triangle::RtTriangle;

/// Returns (t, u, v) of a hit; u and v are the barycentric weights of the second and third vertex.
pub(super) trait IntersectionTest {
    fn intersect(triangle: &RtTriangle, ray: &Ray) -> Option<(f32, f32, f32)>;
}

/// Embree's Möller–Trumbore test; t in (`tmin`, `tmax`].
pub(super) struct EmbreeTest;

impl IntersectionTest for EmbreeTest {
    #[inline(always)]
    fn intersect(triangle: &RtTriangle, ray: &Ray) -> Option<(f32, f32, f32)> {
        // RtTriangle has e1 = v0 − v1, e2 = v2 − v0, ng = e1 × e2.
        let to_vertex = triangle.v0 - ray.origin;
        let moment = ray.direction.cross(to_vertex);
        let determinant = triangle.ng.dot(ray.direction);
        let (size, sign) = (determinant.abs(), 1.0_f32.copysign(determinant));
        let u = moment.dot(triangle.e2) * sign;
        let v = moment.dot(triangle.e1) * sign;
        // Written so that NaN is a miss.
        if !(determinant != 0.0 && u >= 0.0 && v >= 0.0 && u + v <= size) {
            return None;
        }
        let t = triangle.ng.dot(to_vertex) * sign;
        if !(size * ray.tmin < t && t <= size * ray.tmax) {
            return None;
        }
        Some((t / size, u / size, v / size))
    }
}

/// The test of obvhs; t in [`tmin`, `tmax`].
pub(super) struct ObvhsTest;

impl IntersectionTest for ObvhsTest {
    #[inline(always)]
    fn intersect(triangle: &RtTriangle, ray: &Ray) -> Option<(f32, f32, f32)> {
        let t = triangle.intersect(ray);
        if t == f32::INFINITY {
            return None;
        }
        let weights = triangle.compute_barycentric(ray);
        Some((t, weights.x, weights.y))
    }
}
