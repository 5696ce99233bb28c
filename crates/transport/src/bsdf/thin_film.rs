//! KHR_materials_iridescence: the Fresnel term of a thin film on a base (Belcour and Barla 2017, *A Practical Extension to
//! Microfacet Theory for the Modeling of Varying Iridescence*), with the simplifications of the extension: Schlick's
//! approximation at both interfaces, no polarization, two orders of interference.

use std::f32::consts::PI;

use super::schlick::{normal_incidence, schlick_weight};
use crate::lanes::{F, V3};

/// Upper limit of the base's reflectance: at 1 its index of refraction would be infinite.
const MAX_REFLECTANCE: f32 = 0.9999;

/// A term of a CIE colour matching function in Fourier space: `amplitude` · cos(`position` · phase) · exp(−`variance` ·
/// phase²). `amplitude` is the appendix's val · √(2π · var) / 1.0685e-7.
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
        // The limit keeps the exponential a normal number; e⁻⁸⁰ is invisible.
        let fading = (phase * phase * F::splat(-self.variance)).fast_max(F::splat(-80.0)).exp();
        F::splat(self.amplitude) * (F::splat(self.position) * phase).cos() * fading
    }
}

/// Linear RGB reflectance, in [0, 1], of a film of index `ior` ≥ 1 and `thickness` in nanometres on a base whose reflectance
/// at normal incidence, without the film, is `base`. `cos` is the cosine between the normal and the direction outside.
#[inline(never)]
pub fn reflectance(cos: F, base: V3, ior: F, thickness: F) -> V3 {
    let inside = (F::ONE - (F::ONE - cos * cos) / (ior * ior)).fast_max(F::ZERO).sqrt();
    let r12 = schlick(normal_incidence(ior), cos);
    let t121 = F::ONE - r12;
    // 2π times the optical path difference in metres.
    let phase = F::splat(4.0 * PI * 1e-9) * ior * thickness * inside;
    let first = sensitivity(phase);
    let second = sensitivity(phase + phase);
    let channel = |base: F, first: F, second: F| {
        let root = base.fast_min(F::splat(MAX_REFLECTANCE)).sqrt();
        let base_ior = (F::ONE + root) / (F::ONE - root);
        let r23 = schlick(normal_incidence(base_ior / ior), inside);
        let r123 = (r12 * r23).fast_min(F::splat(MAX_REFLECTANCE));
        let around = r123.sqrt();
        let rs = t121 * t121 * r23 / (F::ONE - r123);
        let order = (rs - t121) * around;
        // Each order shifts the phase by π at the outer interface, and by another π where the base has a lower index than
        // the film; the two cancel.
        let flips = base_ior.simd_lt(ior).select(F::ONE, -F::ONE);
        let two = F::splat(2.0);
        let sum = r12 + rs + order * two * flips * first + order * around * two * second;
        sum.fast_max(F::ZERO).fast_min(F::ONE)
    };
    V3 {
        x: channel(base.x, first.x, second.x),
        y: channel(base.y, first.y, second.y),
        z: channel(base.z, first.z, second.z),
    }
}

#[inline(always)]
fn schlick(f0: F, cos: F) -> F {
    (F::ONE - f0).mul_add(schlick_weight(cos), f0)
}

/// Response of linear Rec. 709 RGB to a phase: XYZ by the colour matching functions, converted.
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
