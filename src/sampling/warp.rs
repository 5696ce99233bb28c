//! Warps from the unit square to the domains that a renderer needs, measure-preserving up to the stated density.

use std::f32::consts::{FRAC_PI_2, FRAC_PI_4, PI};

use glam::{Vec2, Vec3};

/// Uniform on the unit disk, density 1/π; concentric (Shirley and Chiu 1997).
#[inline]
pub fn disk(u: f32, v: f32) -> Vec2 {
    let x = 2.0 * u - 1.0;
    let y = 2.0 * v - 1.0;
    if x == 0.0 && y == 0.0 {
        return Vec2::ZERO;
    }
    let (r, phi) = if x.abs() > y.abs() { (x, FRAC_PI_4 * (y / x)) } else { (y, FRAC_PI_2 - FRAC_PI_4 * (x / y)) };
    let (sin, cos) = phi.sin_cos();
    Vec2::new(r * cos, r * sin)
}

/// On the upper hemisphere (z ≥ 0), density cos θ/π in solid angle.
#[inline]
pub fn cosine_hemisphere(u: f32, v: f32) -> Vec3 {
    let d = disk(u, v);
    Vec3::new(d.x, d.y, (1.0 - d.length_squared()).max(0.0).sqrt())
}

/// Uniform on the unit sphere, density 1/4π.
#[inline]
pub fn sphere(u: f32, v: f32) -> Vec3 {
    let z = 1.0 - 2.0 * u;
    let r = (1.0 - z * z).max(0.0).sqrt();
    let (sin, cos) = (2.0 * PI * v).sin_cos();
    Vec3::new(r * cos, r * sin, z)
}

/// Uniform barycentric weights of a triangle's second and third vertex (Heitz 2019, *A Low-Distortion Map Between
/// Triangle and Square*).
#[inline]
pub fn triangle(mut u: f32, mut v: f32) -> (f32, f32) {
    if v > u {
        u *= 0.5;
        v -= u;
    } else {
        v *= 0.5;
        u -= v;
    }
    (u, v)
}

/// A number in [0, 1) with density proportional to the linear function from `a` at 0 to `b` at 1, both ≥ 0 and not
/// both 0.
#[inline]
pub fn linear(u: f32, a: f32, b: f32) -> f32 {
    let x = u * (a + b) / (a + (a * a + u * (b * b - a * a)).max(0.0).sqrt());
    if x.is_finite() { x.min(ONE_MINUS) } else { u }
}

/// The largest number below 1.
pub const ONE_MINUS: f32 = 1.0 - f32::EPSILON / 2.0;

/// An orthonormal frame around the unit vector `n` (Duff et al. 2017, *Building an Orthonormal Basis, Revisited*).
#[inline]
pub fn frame(n: Vec3) -> (Vec3, Vec3) {
    let sign = 1.0f32.copysign(n.z);
    let a = -1.0 / (sign + n.z);
    let b = n.x * n.y * a;
    (Vec3::new(1.0 + sign * n.x * n.x * a, sign * b, -sign * n.x), Vec3::new(b, sign + n.y * n.y * a, -n.y))
}
