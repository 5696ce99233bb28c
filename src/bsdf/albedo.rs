//! The directional albedo of single-scattering GGX reflection, and the energy that light gains back which bounces between
//! microfacets more than once.
//!
//! A lobe's value is multiplied by 1 + F̄ (1 − E)/E, where E is the albedo with a Fresnel reflectance of 1 and F̄ the mean
//! Fresnel reflectance: E. Turquin 2019, *Practical multiple scattering compensation for microfacet models*, equation 15,
//! with Fresnel's mean for its colour as in Kulla and Conty 2017, *Revisiting Physically Based Shading at Imageworks*. The
//! factor depends on the viewing direction alone, so sampling and pdfs stay; a compensated lobe is not reciprocal.

use std::sync::LazyLock;

use super::{ggx, microfacet::schlick_weight, refraction};
use crate::lanes::{F, LANES, NUMBERS, U, V3, eight};

/// Cells of the table along each axis. The nodes are even in the root of the cosine and in the perceptual roughness.
const CELLS: usize = 32;
/// Points of the unit square per node, along each axis.
const STEPS: usize = 32;

/// The four corners of a cell: values of the first function, then of the second. Corners are ordered by roughness, then by
/// cosine.
#[repr(align(32))]
#[derive(Clone, Copy)]
struct Cell([f32; 8]);

/// Cells by [roughness][cosine].
static REFLECTION: LazyLock<Box<[Cell]>> = LazyLock::new(|| table(reflection));

/// E = A + B at eight cosines between view and normal and eight α, where the albedo with Schlick's Fresnel term from f₀ to
/// f₉₀ is f₀ A + f₉₀ B. Accurate to 0.01.
#[inline(always)]
pub fn split_sum(cos: F, alpha: F) -> [F; 2] {
    look_up(&REFLECTION, cos, alpha)
}

/// (1 − E)/E for [`split_sum`]'s result.
#[inline(always)]
pub fn lost([a, b]: [F; 2]) -> F {
    let albedo = a + b;
    (F::ONE - albedo).fast_max(F::ZERO) / albedo.fast_max(F::splat(0.05))
}

/// The mean of Schlick's Fresnel term over the hemisphere, weighted by the cosine.
#[inline(always)]
pub fn mean_fresnel(f0: V3, f90: F) -> V3 {
    let mean = |f0: F| (f90 - f0).mul_add(F::splat(1.0 / 21.0), f0);
    V3 { x: mean(f0.x), y: mean(f0.y), z: mean(f0.z) }
}

/// 1 + `color` · `lost` where `on` is 1, else 1.
#[inline(always)]
pub fn gain(color: V3, lost: F, on: F) -> V3 {
    let scale = lost * on;
    V3 { x: color.x.mul_add(scale, F::ONE), y: color.y.mul_add(scale, F::ONE), z: color.z.mul_add(scale, F::ONE) }
}

/// The compensated albedo of a dielectric layer whose Fresnel term goes from `f0` to `f90`, in [0, 1]: what the lobes beneath do
/// not get.
#[inline(always)]
pub fn layer([a, b]: [F; 2], lost: F, [f0, f90]: [F; 2]) -> F {
    let mean = (f90 - f0).mul_add(F::splat(1.0 / 21.0), f0);
    (f0.mul_add(a, f90 * b) * mean.mul_add(lost, F::ONE)).fast_min(F::ONE)
}

#[inline(always)]
fn look_up(table: &[Cell], cos: F, alpha: F) -> [F; 2] {
    let place = |x: F| {
        let x = (x.fast_max(F::ZERO).sqrt() * F::splat(CELLS as f32)).fast_min(F::splat(CELLS as f32 - 1e-3));
        let cell = x.floor();
        (cell, x - cell)
    };
    let ((row, u), (column, v)) = (place(alpha), place(cos));
    let index = row.mul_add(F::splat(CELLS as f32), column).to_array();
    let corners = F::transpose(eight(|lane| F::from(table[index[lane] as usize].0)));
    let between = |a: F, b: F, t: F| t.mul_add(b - a, a);
    [0, 4].map(|i| {
        between(between(corners[i], corners[i + 1], v), between(corners[i + 2], corners[i + 3], v), u)
    })
}

/// The table of a pair of functions of cosine and α: some milliseconds.
fn table(of: impl Fn(f32, f32) -> [f32; 2]) -> Box<[Cell]> {
    let nodes = CELLS + 1;
    let step = |i: usize| (i as f32 / CELLS as f32).powi(2);
    let node = |i: usize| of(step(i % nodes).max(1e-4), step(i / nodes).max(ggx::MIN_ALPHA));
    let values: Vec<_> = (0..nodes * nodes).map(node).collect();
    let cell = |i: usize| {
        let at = i / CELLS * nodes + i % CELLS;
        let corners = [at, at + 1, at + nodes, at + nodes + 1].map(|node| values[node]);
        Cell(std::array::from_fn(|k| corners[k % 4][k / 4]))
    };
    (0..CELLS * CELLS).map(cell).collect()
}

/// Visible microfacet normals of a surface with roughness `alpha`, seen at cosine `cos`: eight at a time.
fn microfacets(cos: f32, alpha: f32) -> impl Iterator<Item = (V3, V3)> {
    let wo = V3::splat(glam::Vec3::new((1.0 - cos * cos).max(0.0).sqrt(), 0.0, cos));
    (0..STEPS * STEPS / LANES).map(move |i| {
        let number = U::splat((i * LANES) as u32) + U::from(NUMBERS);
        let of = |n: u32| (n as f32 + 0.5) / STEPS as f32;
        let u = F::from(eight(|lane| of(number.as_array()[lane] % STEPS as u32)));
        let v = F::from(eight(|lane| of(number.as_array()[lane] / STEPS as u32)));
        (wo, ggx::sample_visible_normal(wo, [F::splat(alpha); 2], u, v))
    })
}

/// Means over the microfacets of [`microfacets`].
fn means(sums: [F; 2]) -> [f32; 2] {
    sums.map(|sum| sum.to_array().iter().sum::<f32>() / (STEPS * STEPS) as f32)
}

fn reflection(cos: f32, alpha: f32) -> [f32; 2] {
    let alpha2 = F::splat(alpha * alpha);
    let mut sums = [F::ZERO; 2];
    for (wo, h) in microfacets(cos, alpha) {
        let wo_h = wo.dot(h);
        let wi = h * (F::splat(2.0) * wo_h) - wo;
        let seen = wi.z.simd_gt(F::ZERO) & ggx::shadowing(F::splat(cos), wi.z, alpha2);
        let grazing = schlick_weight(wo_h);
        sums = [sums[0] + seen * (F::ONE - grazing), sums[1] + seen * grazing];
    }
    means(sums)
}

/// Tables for boundaries that transmit, even in (η − 1)/(η + 1).
const INDICES: usize = 17;
/// The largest |η − 1|/(η + 1) of the tables: an index of 3.
const LARGEST_INDEX: f32 = 0.5;

static TRANSMISSION: LazyLock<Vec<Box<[Cell]>>> = LazyLock::new(|| {
    let eta = |i: usize| {
        let x = LARGEST_INDEX * (2.0 * i as f32 / (INDICES - 1) as f32 - 1.0);
        (1.0 + x) / (1.0 - x)
    };
    (0..INDICES).map(|i| table(|cos, alpha| [glass(cos, alpha, eta(i)), 0.0])).collect()
});

/// (1 − E)/E of a dielectric boundary that reflects and transmits all light, at eight cosines between view and normal; `eta`:
/// index of refraction beyond the surface over that on the side of the viewer.
pub fn lost_by_glass(cos: F, alpha: F, eta: F) -> F {
    let x = (eta - F::ONE) / (eta + F::ONE) * F::splat(0.5 / LARGEST_INDEX) + F::splat(0.5);
    let x = (x * F::splat((INDICES - 1) as f32)).fast_max(F::ZERO).fast_min(F::splat((INDICES - 1) as f32 - 1e-3));
    let x = x.to_array();
    let (cos, alpha) = (cos.to_array(), alpha.to_array());
    let albedo = F::from(eight(|lane| {
        let at = |i: usize| look_up(&TRANSMISSION[i], F::splat(cos[lane]), F::splat(alpha[lane]))[0].to_array()[0];
        let (i, t) = (x[lane] as usize, x[lane].fract());
        at(i) * (1.0 - t) + at(i + 1) * t
    }));
    (F::ONE - albedo).fast_max(F::ZERO) / albedo.fast_max(F::splat(0.05))
}

/// [`lost_by_glass`], and in lanes of `thin`, where light is transmitted as if it were reflected, [`lost`].
#[inline(never)]
pub fn lost_by_boundary(cos: F, alpha: F, eta: F, thin: F) -> F {
    let solid = if thin.all() { F::ZERO } else { lost_by_glass(cos, alpha, eta) };
    thin.select(lost(split_sum(cos, alpha)), solid)
}

/// The colour of what multiple scattering adds to a mix of metal and dielectric, as one Fresnel term whose mean is `mean`: each
/// adds its own mean squared. `metal`: share of metal; `dielectric`: the dielectric's mean.
#[inline(always)]
pub fn mixed_color(mean: V3, metal: F, dielectric: F) -> V3 {
    let rest = (F::ONE - metal) * dielectric;
    let tiny = F::splat(1e-6);
    let of = |mean: F| {
        let metallic = (mean - rest).fast_max(F::ZERO);
        (metallic * metallic / metal.fast_max(tiny) + rest * dielectric) / mean.fast_max(tiny)
    };
    V3 { x: of(mean.x), y: of(mean.y), z: of(mean.z) }
}

/// The mean share of light that a boundary reflects and, in the colour `tint`, transmits.
#[inline(always)]
pub fn mean_boundary(f0: V3, f90: F, tint: V3) -> V3 {
    let reflected = mean_fresnel(f0, f90);
    let passed = F::ONE - reflected.max_element();
    reflected + tint * passed
}

fn glass(cos: f32, alpha: f32, eta: f32) -> f32 {
    let (alpha2, eta) = (F::splat(alpha * alpha), F::splat(eta));
    let n = V3::splat(glam::Vec3::Z);
    let mut sum = F::ZERO;
    for (wo, h) in microfacets(cos, alpha) {
        let fresnel = refraction::reflectance(wo.dot(h), eta);
        for (reflects, weight) in [(F::ONE.simd_gt(F::ZERO), fresnel), (F::ZERO, F::ONE - fresnel)] {
            let wi = refraction::follow(n, wo, h, eta, F::ZERO, reflects).wi;
            let there = wi.length_squared().simd_gt(F::ZERO);
            sum += there & (weight * ggx::shadowing(F::splat(cos), wi.z.abs(), alpha2));
        }
    }
    means([sum, F::ZERO])[0]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tables_are_the_integrals_to_a_hundredth() {
        let mut worst = [0.0f32; 2];
        for i in 0..40 {
            for j in 0..40 {
                let (cos, alpha) = (((i as f32 + 0.37) / 40.0).powi(2), ((j as f32 + 0.61) / 40.0).powi(2));
                let [a, b] = reflection(cos, alpha);
                let [x, y] = split_sum(F::splat(cos), F::splat(alpha)).map(|f| f.to_array()[3]);
                worst[0] = worst[0].max((x + y) / (a + b) - 1.0).max(1.0 - (x + y) / (a + b));
                worst[1] = worst[1].max((b - y).abs());
            }
        }
        assert!(worst[0] < 0.01 && worst[1] < 0.01, "{worst:?}");
    }
}
