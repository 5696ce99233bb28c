//! KHR_materials_sheen: the fuzz of cloth, after Estevez and Kulla 2017, *Production Friendly Microfacet Sheen BRDF*, over
//! the layers beneath, which get what its directional albedo leaves.

use std::f32::consts::{FRAC_1_PI, PI};
use std::sync::LazyLock;

use super::{Directions, Draw, Eight, Frames, Lobe, Response, parameters::lobe};
use crate::lanes::{F, V3, eight};
use crate::sampling::warp;

lobe! {
    /// Reflection by fibres that stand up.
    Sheen {
        /// Colour; above 0 where there is any.
        color: Vector,
        /// Perceptual roughness, ≥ [`MIN_ROUGHNESS`].
        roughness: Scalar,
    }
}

/// Smoother fibres are as these.
pub const MIN_ROUGHNESS: f32 = 0.1;

impl Lobe for Sheen<Eight> {
    #[inline(always)]
    fn present(&self) -> F {
        self.color.max_element().simd_gt(F::ZERO)
    }

    #[inline(always)]
    fn weight(&self, n: V3, wo: V3) -> (F, F) {
        let albedo = albedos(n.dot(wo), self.roughness);
        (self.color.luminance() * albedo, F::ONE - self.color.max_element() * albedo)
    }

    #[inline(always)]
    fn eval(&self, d: &Directions, light: F) -> Response {
        let pdf = (d.cos_i * F::splat(FRAC_1_PI)) & d.above;
        let brdf = brdf(d.n.dot(d.h), d.cos_o, d.cos_i, self.roughness);
        let value = self.color * ((brdf * d.cos_i * light) & d.above);
        // The albedo is the same both ways.
        let albedo = albedos(d.cos_o, self.roughness).fast_max(albedos(d.cos_i.abs(), self.roughness));
        Response { value, pdf, through: light * (F::ONE - self.color.max_element() * albedo) }
    }

    #[inline(always)]
    fn draw(&self, Frames { t, b, n }: &Frames, wo: V3, [_, u, v]: [F; 3]) -> Draw {
        let cosine = warp::cosine_hemispheres(u, v);
        let wi = *t * cosine.x + *b * cosine.y + *n * cosine.z;
        Draw { wi, h: (wo + wi).normalize_or(*n) }
    }
}

/// x to the power of y, for x in [0, 1] and y > 0.
#[inline(always)]
fn power(x: F, y: F) -> F {
    // Far below what is to be seen, where the exponential still is a number.
    (x.fast_max(F::splat(1e-6)).ln() * y).fast_max(F::splat(-80.0)).exp()
}

/// The BRDF of white fibres.
#[inline(always)]
fn brdf(cos_h: F, cos_o: F, cos_i: F, roughness: F) -> F {
    let one_over_alpha = F::ONE / (roughness * roughness);
    let sin = (F::ONE - cos_h * cos_h).fast_max(F::ZERO).sqrt();
    let density = (one_over_alpha + F::splat(2.0)) * power(sin, one_over_alpha) * F::splat(0.5 * FRAC_1_PI);
    let shadowing = F::ONE + lambda(cos_o, roughness) + lambda(cos_i, roughness);
    density / (shadowing * F::splat(4.0) * cos_o * cos_i)
}

/// Estevez and Kulla's fit of Λ.
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

/// Nodes of the albedo's table, along the cosine and along the roughness from [`MIN_ROUGHNESS`] to 1.
const NODES: usize = 33;

/// Directional albedo of white fibres by [roughness][cosine], at most 1: some milliseconds, if a scene has sheen.
static ALBEDO: LazyLock<[[f32; NODES]; NODES]> = LazyLock::new(|| {
    let step = |i: usize| i as f32 / (NODES - 1) as f32;
    std::array::from_fn(|i| {
        let roughness = MIN_ROUGHNESS + (1.0 - MIN_ROUGHNESS) * step(i);
        std::array::from_fn(|j| white_albedo(step(j).max(1e-3), roughness))
    })
});

/// By the midpoint rule in the light's angle and azimuth.
fn white_albedo(cos_o: f32, roughness: f32) -> f32 {
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

/// The table, between its nodes.
#[inline(always)]
fn albedos(cos: F, roughness: F) -> F {
    let last = (NODES - 1) as f32;
    let place = |x: f32| {
        let x = (x * last).clamp(0.0, last - 1e-3);
        (x as usize, x.fract())
    };
    let (cos, roughness) = (cos.to_array(), roughness.to_array());
    F::from(eight(|lane| {
        let (j, v) = place(cos[lane]);
        let (i, u) = place((roughness[lane] - MIN_ROUGHNESS) / (1.0 - MIN_ROUGHNESS));
        let row = |i: usize| ALBEDO[i][j] * (1.0 - v) + ALBEDO[i][j + 1] * v;
        row(i) * (1.0 - u) + row(i + 1) * u
    }))
}
