//! KHR_materials_iridescence: the Fresnel term of a thin film on a base, after Belcour and Barla 2017, *A Practical Extension
//! to Microfacet Theory for the Modeling of Varying Iridescence*, simplified as the extension has it: Schlick's Fresnel at both
//! interfaces, no polarization, two orders of interference.

use std::f32::consts::PI;

use super::microfacet::schlick_weight;
use crate::lanes::{F, V3};

/// The base reflects less than all, or it would have no index of refraction.
const MOST: f32 = 0.9999;

/// A colour matching function in terms of the phase: `amplitude` · cos(`position` · phase) · exp(−`variance` · phase²). The
/// appendix's amplitude val · √(2π · var) / 1.0685e-7 is multiplied out.
struct Sensitivity {
    amplitude: f32,
    position: f32,
    variance: f32,
}

const X: [Sensitivity; 2] = [
    Sensitivity { amplitude: 0.846_590, position: 1.6810e6, variance: 4.3278e9 },
    Sensitivity { amplitude: 0.153_868, position: 2.2399e6, variance: 4.5282e9 },
];
const Y: Sensitivity = Sensitivity { amplitude: 1.000_222, position: 1.7953e6, variance: 9.3046e9 };
const Z: Sensitivity = Sensitivity { amplitude: 1.001_122, position: 2.2084e6, variance: 6.6121e9 };

impl Sensitivity {
    #[inline(always)]
    fn at(&self, phase: F) -> F {
        // Far below what is to be seen, where the exponential still is a number.
        let fading = (phase * phase * F::splat(-self.variance)).fast_max(F::splat(-80.0)).exp();
        F::splat(self.amplitude) * (F::splat(self.position) * phase).cos() * fading
    }
}

/// Reflectance in [0, 1] at cosine `cos` of the direction outside to the normal: of a film of index `ior` ≥ 1 and `thickness`
/// in nanometres on a base that by itself reflects `base` at normal incidence.
#[inline(never)]
pub fn reflectance(cos: F, base: V3, ior: F, thickness: F) -> V3 {
    let inside = (F::ONE - (F::ONE - cos * cos) / (ior * ior)).fast_max(F::ZERO).sqrt();
    let r12 = schlick(normal(ior), cos);
    let t121 = F::ONE - r12;
    // 2π times the difference of the optical paths, in metres.
    let phase = F::splat(4.0 * PI * 1e-9) * ior * thickness * inside;
    let first = sensitivity(phase);
    let second = sensitivity(phase + phase);
    let channel = |base: F, first: F, second: F| {
        let root = base.fast_min(F::splat(MOST)).sqrt();
        let base_ior = (F::ONE + root) / (F::ONE - root);
        let r23 = schlick(normal(base_ior / ior), inside);
        let r123 = (r12 * r23).fast_min(F::splat(MOST));
        let around = r123.sqrt();
        let rs = t121 * t121 * r23 / (F::ONE - r123);
        let order = (rs - t121) * around;
        // Light that goes through the film changes its sign at the outer surface, once an order, and at a base that is
        // thinner than the film: not at all where both do.
        let flips = base_ior.simd_lt(ior).select(F::ONE, -F::ONE);
        let two = F::splat(2.0);
        let all = r12 + rs + order * two * flips * first + order * around * two * second;
        all.fast_max(F::ZERO).fast_min(F::ONE)
    };
    V3 {
        x: channel(base.x, first.x, second.x),
        y: channel(base.y, first.y, second.y),
        z: channel(base.z, first.z, second.z),
    }
}

/// Reflectance at normal incidence where the index of refraction grows `ratio` times.
#[inline(always)]
fn normal(ratio: F) -> F {
    let root = (ratio - F::ONE) / (ratio + F::ONE);
    root * root
}

#[inline(always)]
fn schlick(f0: F, cos: F) -> F {
    (F::ONE - f0).mul_add(schlick_weight(cos), f0)
}

/// Of linear Rec. 709 RGB.
#[inline(always)]
fn sensitivity(phase: F) -> V3 {
    let (x, y, z) = (X[0].at(phase) + X[1].at(phase), Y.at(phase), Z.at(phase));
    let row = |a: f32, b: f32, c: f32| F::splat(a) * x + F::splat(b) * y + F::splat(c) * z;
    V3 {
        x: row(3.240_454_2, -1.537_138_5, -0.498_531_4),
        y: row(-0.969_266, 1.876_010_8, 0.041_556),
        z: row(0.055_643_4, -0.204_025_9, 1.057_225_2),
    }
}
