//! Shading normals that are consistent with the geometric normal.
//!
//! Interpolated and mapped normals may send the mirror direction of `wo` below the surface, which renders as black rims on
//! smooth bumps. Such a normal is bent toward the geometric normal until the mirror direction is just above the surface
//! (Keller et al. 2017, *The Iray Light Transport Simulation and Rendering System*, appendix A.3).

use crate::lanes::{F, V3, sign};

/// Lowest cosine between `wo` and the shading normal.
pub(crate) const MIN_COS: f32 = 1e-3;
/// Lowest cosine between the mirror direction and the geometric normal, except where `wo` itself is lower.
const MIN_MIRROR_COS: f32 = 0.01;

/// Geometric and shading normals of any length, as unit vectors on the side of `wo`; the second is [`consistent`].
#[inline(always)]
pub fn facing(ng: V3, ns: V3, wo: V3) -> (V3, V3) {
    let ng = ng.normalize_or(wo);
    // ±1: the side of wo relative to the winding.
    let side = sign(ng.dot(wo));
    let ng = ng * side;
    let ns = ns.normalize_or(ng * side) * side;
    (ng, consistent(ng, ns, wo))
}

/// `ns`, bent where that is necessary. All vectors are unit and in world space; `ng` is on the side of `wo`. Normals that need no
/// bending keep their bits.
#[inline(always)]
pub fn consistent(ng: V3, ns: V3, wo: V3) -> V3 {
    let (cos_g, cos_s, height) = (ng.dot(wo), ns.dot(wo), ng.dot(ns));
    let min_mirror = (cos_g * F::splat(0.9)).fast_min(F::splat(MIN_MIRROR_COS));
    let below = (F::splat(2.0) * cos_s * height - cos_g).simd_lt(min_mirror);
    let ns = if below.any() { V3::select(below, bent(ng, ns - ng * height, wo, cos_g, min_mirror), ns) } else { ns };
    // Rounding may leave a grazing wo below the horizon of the normal.
    let cos = ns.dot(wo);
    let low = F::splat(MIN_COS);
    let tilted = (ns + wo * (low - cos)).normalize_or(ng);
    V3::select(cos.simd_lt(low), tilted, ns)
}

/// Mask of the lanes where `ns` is no result of bending for `wo`, and need not be bent, by a margin that is larger than rounding.
#[inline(always)]
pub fn is_clear(ng: V3, ns: V3, wo: V3) -> F {
    let (cos_g, cos_s, height) = (ng.dot(wo), ns.dot(wo), ng.dot(ns));
    let min_mirror = (cos_g * F::splat(0.9)).fast_min(F::splat(MIN_MIRROR_COS));
    let mirror = F::splat(2.0) * cos_s * height - cos_g;
    cos_s.simd_gt(F::splat(2.0 * MIN_COS)) & mirror.simd_gt(min_mirror + cos_g * F::splat(0.01))
}

/// The normal in the plane of `ng` and `tangent` whose mirror direction has the cosine `min_mirror` to `ng`.
///
/// With the angles φ of the normal and δ of `wo`'s projection onto the plane from `ng`, that cosine is l cos(2φ − δ), where l is
/// the length of the projection.
#[inline(never)]
fn bent(ng: V3, tangent: V3, wo: V3, cos_g: F, min_mirror: F) -> V3 {
    let x = tangent.normalize_or(V3::ZERO);
    let side = x.dot(wo);
    let length2 = side.mul_add(side, cos_g * cos_g).fast_max(F::splat(f32::MIN_POSITIVE));
    let root = (length2 - min_mirror * min_mirror).fast_max(F::ZERO).sqrt();
    let cos_2phi = ((cos_g * min_mirror - side * root) / length2).fast_max(F::splat(-1.0)).fast_min(F::ONE);
    let half = |x: F| (F::splat(0.5) * x).sqrt();
    (x * half(F::ONE - cos_2phi) + ng * half(F::ONE + cos_2phi)).normalize_or(ng)
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;

    /// Unit vectors all over the sphere.
    fn directions() -> impl Iterator<Item = Vec3> {
        (0..400).map(|i| {
            let (z, phi) = (1.0 - (i as f32 + 0.5) / 200.0, 2.4 * i as f32);
            Vec3::new((1.0 - z * z).sqrt() * phi.cos(), (1.0 - z * z).sqrt() * phi.sin(), z)
        })
    }

    #[test]
    fn bent_normals_mirror_the_view_above_the_surface_and_others_keep_their_bits() {
        let ng = Vec3::Z;
        let mut bent = 0;
        for wo in directions().filter(|wo| wo.z > 0.0) {
            for ns in directions() {
                let result = consistent(V3::splat(ng), V3::splat(ns), V3::splat(wo)).lane(5);
                let mirror = |n: Vec3| 2.0 * n.dot(wo) * n.z - wo.z;
                let least = (0.9 * wo.z).min(MIN_MIRROR_COS);
                assert!((result.length() - 1.0).abs() < 1e-5 && result.dot(wo) > 0.0, "{wo} {ns}: {result}");
                if mirror(ns) >= least {
                    // A normal that faces away from `wo` is tilted.
                    assert!(result == ns || ns.dot(wo) < MIN_COS, "{wo} {ns}: {result}");
                    continue;
                }
                bent += 1;
                // To rounding, just above; and between the two normals.
                assert!((mirror(result) - least).abs() < 1e-4 + 2.0 * MIN_COS, "{wo} {ns}: {}", mirror(result));
                assert!(result.z >= ns.z - 1e-4, "{wo} {ns}: {result}");
            }
        }
        assert!(bent > 10_000, "{bent}");
    }
}
