//! Warps from the unit square to the domains of a renderer, with their densities.

use std::f32::consts::PI;

use glam::Vec3;

use crate::lanes::{F, V3, sign};

/// Sine and cosine of 2π·`turns`, for `turns` in [0, 1], to about 1e-7.
#[inline(always)]
pub(crate) fn sin_cos_turns(turns: F) -> (F, F) {
    // Reduce to an eighth turn on either side of a multiple of a quarter turn, where short Taylor series are accurate.
    let quarter = (turns * F::splat(4.0)).round();
    let x = (turns - quarter * F::splat(0.25)) * F::splat(2.0 * PI);
    let x2 = x * x;
    let sin = x * x2
        .mul_add(F::splat(2.755_731_9e-6), F::splat(-1.984_127e-4))
        .mul_add(x2, F::splat(8.333_333e-3))
        .mul_add(x2, F::splat(-1.666_666_7e-1))
        .mul_add(x2, F::ONE);
    let cos = x2
        .mul_add(F::splat(2.480_158_7e-5), F::splat(-1.388_888_9e-3))
        .mul_add(x2, F::splat(4.166_666_7e-2))
        .mul_add(x2, F::splat(-0.5))
        .mul_add(x2, F::ONE);
    // Quarters 1 and 3 swap sine and cosine, 2 and 3 negate the sine, 1 and 2 the cosine.
    let odd = quarter.simd_eq(F::ONE) | quarter.simd_eq(F::splat(3.0));
    let sin_sign = quarter.simd_eq(F::splat(2.0)) | quarter.simd_eq(F::splat(3.0));
    let cos_sign = quarter.simd_eq(F::ONE) | quarter.simd_eq(F::splat(2.0));
    let minus = F::splat(-0.0);
    (odd.select(cos, sin) ^ (sin_sign & minus), odd.select(sin, cos) ^ (cos_sign & minus))
}

/// Directions on the upper hemisphere (z ≥ 0) with density cos θ/π per solid angle: the concentric map from the square to
/// the disk (Shirley and Chiu 1997, *A Low Distortion Map Between Disk and Square*), projected up to the hemisphere.
#[inline(always)]
pub fn cosine_hemispheres(u: F, v: F) -> V3 {
    let x = u.mul_sub(F::splat(2.0), F::ONE);
    let y = v.mul_sub(F::splat(2.0), F::ONE);
    let wide = x.abs().simd_gt(y.abs());
    let r = wide.select(x, y);
    let ratio = wide.select(y, x) / r;
    // An eighth of a turn times the ratio, from the x axis or back from the y axis.
    let eighth = ratio * F::splat(0.125);
    let turns = wide.select(eighth, F::splat(0.25) - eighth);
    // A negative r rotates the map by half a turn. `sin_cos_turns` takes turns in [0, 1].
    let (s, c) = sin_cos_turns(turns.simd_lt(F::ZERO).select(turns + F::ONE, turns));
    let center = r.simd_eq(F::ZERO);
    let (dx, dy) = (center.select(F::ZERO, r * c), center.select(F::ZERO, r * s));
    let z = (F::ONE - dx.mul_add(dx, dy * dy)).fast_max(F::ZERO).sqrt();
    V3 { x: dx, y: dy, z }
}

/// Uniform directions on the unit sphere, density 1/(4π) per solid angle.
#[inline]
pub fn sphere(u: f32, v: f32) -> Vec3 {
    let z = 1.0 - 2.0 * u;
    let r = (1.0 - z * z).max(0.0).sqrt();
    let (sin, cos) = (2.0 * PI * v).sin_cos();
    Vec3::new(r * cos, r * sin, z)
}

/// Uniform barycentric weights of a triangle's second and third vertex (Heitz 2019, *A Low-Distortion Map Between
/// Triangle and Square*).
#[inline(always)]
pub fn triangles(u: F, v: F) -> (F, F) {
    let half = u.fast_min(v) * F::splat(0.5);
    let upper = v.simd_gt(u);
    (upper.select(half, u - half), upper.select(v - half, half))
}

/// Numbers in [0, 1) with density proportional to the linear function from `a` ≥ 0 at 0 to `b` ≥ 0 at 1; uniform where both
/// are 0.
#[inline(always)]
pub fn linear(u: F, a: F, b: F) -> F {
    let root = u.mul_add(b.mul_sub(b, a * a), a * a).fast_max(F::ZERO).sqrt();
    let x = u * (a + b) / (a + root);
    x.is_finite().select(x.fast_min(F::splat(ONE_MINUS_EPSILON)), u)
}

/// The largest number below 1.
pub(crate) const ONE_MINUS_EPSILON: f32 = 1.0 - f32::EPSILON / 2.0;

/// Two unit vectors that form an orthonormal basis with the unit vector `n` (Duff et al. 2017, *Building an Orthonormal Basis, Revisited*).
#[inline]
pub fn frame(n: Vec3) -> (Vec3, Vec3) {
    let sign = 1.0f32.copysign(n.z);
    let a = -1.0 / (sign + n.z);
    let b = n.x * n.y * a;
    (Vec3::new(1.0 + sign * n.x * n.x * a, sign * b, -sign * n.x), Vec3::new(b, sign + n.y * n.y * a, -n.y))
}

/// [`frame`] of eight lanes.
#[inline(always)]
pub fn frames(n: V3) -> (V3, V3) {
    let sign = sign(n.z);
    let a = -(F::ONE / (sign + n.z));
    let b = n.x * n.y * a;
    let t = V3 { x: (sign * n.x * n.x).mul_add(a, F::ONE), y: sign * b, z: -(sign * n.x) };
    (t, V3 { x: b, y: (n.y * n.y).mul_add(a, sign), z: -n.y })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sine_and_cosine_are_good_to_rounding_all_the_way_round() {
        for i in 0..=100_000 {
            let turns = i as f32 / 100_000.0;
            let (s, c) = sin_cos_turns(F::splat(turns));
            let (es, ec) = (2.0 * std::f64::consts::PI * f64::from(turns)).sin_cos();
            // The series' next terms at an eighth of a turn are below 2e-9 and 4e-8; the rest is rounding.
            assert!((f64::from(s.as_array()[0]) - es).abs() < 4e-7, "{turns}");
            assert!((f64::from(c.as_array()[0]) - ec).abs() < 4e-7, "{turns}");
        }
    }
}
