//! KHR_materials_sheen: the microfacet sheen BRDF of Estevez and Kulla 2017 (*Production Friendly Microfacet Sheen BRDF*).
//! The layers beneath are scaled by one less its directional albedo.

use std::f32::consts::{FRAC_1_PI, PI};
use std::sync::LazyLock;

use super::lobe::{Directions, Lobe, Response};
use super::parameters::{Eight, lobe};
use crate::lanes::{F, V3, eight};

lobe! {
    /// Reflection by fibres that stand on the surface (cloth).
    Sheen {
        /// Sheen colour, linear RGB; zero where there is no sheen.
        color: Vector,
        /// Perceptual roughness, ≥ [`MIN_ROUGHNESS`].
        roughness: Scalar,
    }
}

/// Smallest perceptual roughness; lower values are raised to it.
pub const MIN_ROUGHNESS: f32 = 0.1;

impl Lobe for Sheen<Eight> {
    #[inline(always)]
    fn present(&self) -> F {
        self.color.max_element().simd_gt(F::ZERO)
    }

    #[inline(always)]
    fn weight(&self, n: V3, wo: V3) -> (F, F) {
        let albedo = directional_albedo(n.dot(wo), self.roughness);
        (self.color.luminance() * albedo, F::ONE - self.color.max_element() * albedo)
    }

    #[inline(always)]
    fn eval(&self, d: &Directions, light: F) -> Response {
        let pdf = (d.cos_i * F::splat(FRAC_1_PI)) & d.above;
        let brdf = brdf(d.n.dot(d.h), d.cos_o, d.cos_i, self.roughness);
        let value = self.color * ((brdf * d.cos_i * light) & d.above);
        // The larger of both albedos keeps the layering reciprocal.
        let albedo =
            directional_albedo(d.cos_o, self.roughness).fast_max(directional_albedo(d.cos_i.abs(), self.roughness));
        Response { value, pdf, transmittance: light * (F::ONE - self.color.max_element() * albedo) }
    }
}

/// x^y for x in [0, 1] and y > 0.
#[inline(always)]
fn power(x: F, y: F) -> F {
    // The limits keep the exponential a normal number; e⁻⁸⁰ is invisible.
    (x.fast_max(F::splat(1e-6)).ln() * y).fast_max(F::splat(-80.0)).exp()
}

/// The BRDF for a white sheen colour, without the cosine.
#[inline(always)]
fn brdf(cos_h: F, cos_o: F, cos_i: F, roughness: F) -> F {
    let one_over_alpha = F::ONE / (roughness * roughness);
    let sin = (F::ONE - cos_h * cos_h).fast_max(F::ZERO).sqrt();
    let density = (one_over_alpha + F::splat(2.0)) * power(sin, one_over_alpha) * F::splat(0.5 * FRAC_1_PI);
    let shadowing = F::ONE + lambda(cos_o, roughness) + lambda(cos_i, roughness);
    density / (shadowing * F::splat(4.0) * cos_o * cos_i)
}

/// The fit of Λ of Estevez and Kulla.
#[inline(always)]
fn lambda(cos: F, roughness: F) -> F {
    let smooth = F::ONE - roughness * roughness;
    let smooth = smooth * smooth;
    let fit = |rough: f32, even: f32| F::splat(even - rough).mul_add(smooth, F::splat(rough));
    let (a, b) = (fit(21.5473, 25.3245), fit(3.82987, 3.32435));
    let (c, d, e) = (fit(0.19823, 0.16801), fit(-1.97760, -1.27393), fit(-4.32054, -4.85967));
    let log = |x: F| a / b.mul_add(power(x, c), F::ONE) + d * x + e;
    let steep = cos.simd_lt(F::splat(0.5));
    let mirrored = steep.select(cos, F::ONE - cos);
    let log_here = log(mirrored.fast_max(F::ZERO));
    steep.select(log_here, F::splat(2.0) * log(F::splat(0.5)) - log_here).exp()
}

/// Nodes of the albedo table along the cosine (0 to 1) and along the roughness ([`MIN_ROUGHNESS`] to 1).
const NODES: usize = 33;

/// Directional albedo of white sheen by [roughness][cosine], at most 1. Computed on first use, in some milliseconds.
static ALBEDO: LazyLock<[[f32; NODES]; NODES]> = LazyLock::new(|| {
    let step = |i: usize| i as f32 / (NODES - 1) as f32;
    std::array::from_fn(|i| {
        let roughness = MIN_ROUGHNESS + (1.0 - MIN_ROUGHNESS) * step(i);
        std::array::from_fn(|j| integrate_white_albedo(step(j).max(1e-3), roughness))
    })
});

/// Directional albedo of white sheen by the midpoint rule over polar angle and azimuth of `wi`.
fn integrate_white_albedo(cos_o: f32, roughness: f32) -> f32 {
    const STEPS: usize = 32;
    let (sin_o, roughness) = ((1.0 - cos_o * cos_o).sqrt(), F::splat(roughness));
    let mut sum = 0.0;
    for i in 0..STEPS {
        let theta = 0.5 * PI * (i as f32 + 0.5) / STEPS as f32;
        let (sin_i, cos_i) = theta.sin_cos();
        for j in (0..STEPS).step_by(8) {
            let between = F::from(eight(|lane| {
                let phi = PI * ((j + lane) as f32 + 0.5) / STEPS as f32;
                sin_o * sin_i * phi.cos() + cos_o * cos_i
            }));
            // |wo + wi|² = 2 + 2 wo·wi.
            let length = (F::splat(2.0) + F::splat(2.0) * between).sqrt();
            let cos_h = F::splat(cos_o + cos_i) / length;
            let f = brdf(cos_h, F::splat(cos_o), F::splat(cos_i), roughness);
            sum += f.to_array().iter().sum::<f32>() * cos_i * sin_i;
        }
    }
    let step = 0.5 * PI / STEPS as f32 * (2.0 * PI / STEPS as f32);
    (sum * step).min(1.0)
}

/// Directional albedo of white sheen, interpolated bilinearly in the table.
#[inline(always)]
fn directional_albedo(cos: F, roughness: F) -> F {
    let last = (NODES - 1) as f32;
    let node = |x: f32| {
        let x = (x * last).clamp(0.0, last - 1e-3);
        (x as usize, x.fract())
    };
    let (cos, roughness) = (cos.to_array(), roughness.to_array());
    F::from(eight(|lane| {
        let (j, v) = node(cos[lane]);
        let (i, u) = node((roughness[lane] - MIN_ROUGHNESS) / (1.0 - MIN_ROUGHNESS));
        let row = |i: usize| ALBEDO[i][j] * (1.0 - v) + ALBEDO[i][j + 1] * v;
        row(i) * (1.0 - u) + row(i + 1) * u
    }))
}
