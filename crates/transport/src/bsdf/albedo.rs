//! Directional albedos of single-scattering GGX lobes, and the compensation of the energy that they lose.
//!
//! The value of a lobe is multiplied by 1 + F̄ (1 − E)/E, where E is the albedo for a Fresnel reflectance of 1 and F̄ the mean
//! Fresnel reflectance (Turquin 2019, *Practical Multiple Scattering Compensation for Microfacet Models*, equation 15, with
//! the mean Fresnel term of Kulla and Conty 2017, *Revisiting Physically Based Shading at Imageworks*). The factor depends on
//! `wo` alone, so that sampling and pdfs stay as they are. A compensated lobe is not reciprocal.

use std::sync::{LazyLock, OnceLock};

use super::schlick::schlick_weight;
use super::{ggx, refraction};
use crate::lanes::{F, LANES, NUMBERS, U, V3, eight};

/// Cells of a table along each axis. Nodes are uniform in the square root of the cosine and in the perceptual roughness.
const CELLS: usize = 32;
/// Quadrature points per node along each axis of the unit square.
const STEPS: usize = 32;
/// Smallest albedo that the loss is divided by.
const MIN_ALBEDO: f32 = 0.05;

/// The values of two functions at the four corners of a cell, ordered by roughness, then by cosine.
#[repr(align(32))]
#[derive(Clone, Copy)]
struct Cell([f32; 8]);

/// Cells by [roughness][cosine].
type Table = Box<[Cell]>;

static REFLECTION: LazyLock<Table> = LazyLock::new(|| table(integrate_reflection));

/// The directional albedo of eight GGX lobes, split by Schlick's term: f0 `normal` + f90 `grazing`.
#[derive(Clone, Copy)]
pub struct Albedo {
    normal: F,
    grazing: F,
}

/// The albedo of GGX reflection at cosines `cos` of `wo`. Its error is below 0.01.
#[inline(always)]
pub(crate) fn ggx(cos: F, alpha: F) -> Albedo {
    let [normal, grazing] = look_up(&REFLECTION, cos, alpha);
    Albedo { normal, grazing }
}

impl Albedo {
    /// (1 − E)/E.
    #[inline(always)]
    pub fn loss(&self) -> F {
        loss(self.normal + self.grazing)
    }

    /// The compensated albedo of a dielectric layer with these reflectances at normal and grazing incidence, in [0, 1].
    #[inline(always)]
    pub fn layer(&self, f0: F, f90: F) -> F {
        let single = f0.mul_add(self.normal, f90 * self.grazing);
        (single * mean_schlick(f0, f90).mul_add(self.loss(), F::ONE)).fast_min(F::ONE)
    }
}

#[inline(always)]
fn loss(albedo: F) -> F {
    (F::ONE - albedo).fast_max(F::ZERO) / albedo.fast_max(F::splat(MIN_ALBEDO))
}

/// The cosine-weighted hemispherical mean of Schlick's Fresnel term.
#[inline(always)]
pub(crate) fn mean_schlick(f0: F, f90: F) -> F {
    (f90 - f0).mul_add(F::splat(1.0 / 21.0), f0)
}

/// [`mean_schlick`] of each channel.
#[inline(always)]
pub(crate) fn mean_fresnel(f0: V3, f90: F) -> V3 {
    V3 { x: mean_schlick(f0.x, f90), y: mean_schlick(f0.y, f90), z: mean_schlick(f0.z, f90) }
}

/// The colour F̄ of a mixture of metal and dielectric that is one lobe with the mean Fresnel term `mean`: each part adds its own
/// mean squared. `dielectric` is the dielectric's mean.
#[inline(always)]
pub(crate) fn mixture_color(mean: V3, metallic: F, dielectric: F) -> V3 {
    let rest = (F::ONE - metallic) * dielectric;
    let tiny = F::splat(1e-6);
    let color = |mean: F| {
        let metal = (mean - rest).fast_max(F::ZERO);
        (metal * metal / metallic.fast_max(tiny) + rest * dielectric) / mean.fast_max(tiny)
    };
    V3 { x: color(mean.x), y: color(mean.y), z: color(mean.z) }
}

/// The colour F̄ of a boundary: what it reflects, and what it transmits in the colour `tint`.
#[inline(always)]
pub(crate) fn boundary_color(f0: V3, f90: F, tint: V3) -> V3 {
    let reflected = mean_fresnel(f0, f90);
    reflected + tint * (F::ONE - reflected.max_element())
}

/// 1 + `color` · `loss` where `compensation` is 1, and 1 where it is 0.
#[inline(always)]
pub fn gain(color: V3, loss: F, compensation: F) -> V3 {
    let scale = loss * compensation;
    V3 { x: color.x.mul_add(scale, F::ONE), y: color.y.mul_add(scale, F::ONE), z: color.z.mul_add(scale, F::ONE) }
}

/// Bilinear interpolation of the two functions of a table.
#[inline(always)]
fn look_up(table: &[Cell], cos: F, alpha: F) -> [F; 2] {
    let position = |x: F| {
        let x = (x.fast_max(F::ZERO).sqrt() * F::splat(CELLS as f32)).fast_min(F::splat(CELLS as f32 - 1e-3));
        let cell = x.floor();
        (cell, x - cell)
    };
    let ((row, u), (column, v)) = (position(alpha), position(cos));
    let index = row.mul_add(F::splat(CELLS as f32), column).to_array();
    let corners = F::transpose(eight(|lane| F::from(table[index[lane] as usize].0)));
    let between = |a: F, b: F, t: F| t.mul_add(b - a, a);
    let function =
        |i: usize| between(between(corners[i], corners[i + 1], v), between(corners[i + 2], corners[i + 3], v), u);
    [function(0), function(4)]
}

/// Tabulates two functions of a cosine and α; takes some milliseconds.
fn table(functions: impl Fn(f32, f32) -> [f32; 2]) -> Table {
    let nodes = CELLS + 1;
    let parameter = |i: usize| (i as f32 / CELLS as f32).powi(2);
    let node = |i: usize| functions(parameter(i % nodes).max(1e-4), parameter(i / nodes).max(ggx::MIN_ALPHA));
    let values: Vec<_> = (0..nodes * nodes).map(node).collect();
    let cell = |i: usize| {
        let first = i / CELLS * nodes + i % CELLS;
        let corners = [first, first + 1, first + nodes, first + nodes + 1].map(|node| values[node]);
        Cell(std::array::from_fn(|k| corners[k % 4][k / 4]))
    };
    (0..CELLS * CELLS).map(cell).collect()
}

/// `wo` and stratified visible microfacet normals, eight at a time.
fn microfacets(cos: f32, alpha: f32) -> impl Iterator<Item = (V3, V3)> {
    let wo = V3::splat(glam::Vec3::new((1.0 - cos * cos).max(0.0).sqrt(), 0.0, cos));
    (0..STEPS * STEPS / LANES).map(move |i| {
        let number = (U::splat((i * LANES) as u32) + U::from(NUMBERS)).to_array();
        let midpoint = |n: u32| (n as f32 + 0.5) / STEPS as f32;
        let u = F::from(eight(|lane| midpoint(number[lane] % STEPS as u32)));
        let v = F::from(eight(|lane| midpoint(number[lane] / STEPS as u32)));
        (wo, ggx::sample_visible_normal(wo, [F::splat(alpha); 2], u, v))
    })
}

fn mean(sum: F) -> f32 {
    sum.to_array().iter().sum::<f32>() / (STEPS * STEPS) as f32
}

/// ∫ G₂/G₁ over visible normals: times 1 − Schlick's weight, and times the weight.
fn integrate_reflection(cos: f32, alpha: f32) -> [f32; 2] {
    let alpha2 = F::splat(alpha * alpha);
    let masking = ggx::masking(F::splat(cos), alpha2);
    let mut sums = [F::ZERO; 2];
    for (wo, h) in microfacets(cos, alpha) {
        let wo_h = wo.dot(h);
        let wi = h * (F::splat(2.0) * wo_h) - wo;
        let shadowing = wi.z.simd_gt(F::ZERO) & ggx::shadowing(masking, ggx::masking(wi.z, alpha2));
        let grazing = schlick_weight(wo_h);
        sums = [sums[0] + shadowing * (F::ONE - grazing), sums[1] + shadowing * grazing];
    }
    sums.map(mean)
}

/// Tables of [`BOUNDARY`], uniform in (η − 1)/(η + 1).
const INDICES: usize = 17;
/// Largest |η − 1|/(η + 1) of the tables, for η = 3.
const MAX_CONTRAST: f32 = 0.5;

/// Albedos of dielectric boundaries by the relative index of refraction, each made when it is first needed: all of them take a
/// quarter of a second, and a scene of one glass needs four.
static BOUNDARY: [OnceLock<Table>; INDICES] = [const { OnceLock::new() }; INDICES];

fn boundary(i: usize) -> &'static Table {
    BOUNDARY[i].get_or_init(|| {
        let contrast = MAX_CONTRAST * (2.0 * i as f32 / (INDICES - 1) as f32 - 1.0);
        let eta = (1.0 + contrast) / (1.0 - contrast);
        table(|cos, alpha| [integrate_boundary(cos, alpha, eta), 0.0])
    })
}

/// (1 − E)/E of dielectric boundaries that reflect and refract; in lanes of the mask `thin`, of thin walls, where transmission
/// mirrors reflection. `eta`: index of refraction beyond the surface over that on the side of `wo`.
#[inline(never)]
pub(crate) fn boundary_loss(cos: F, alpha: F, eta: F, thin: F) -> F {
    let thin_loss = ggx(cos, alpha).loss();
    if thin.all() {
        return thin_loss;
    }
    let last = F::splat((INDICES - 1) as f32);
    let index = (eta - F::ONE) / (eta + F::ONE) * F::splat(0.5 / MAX_CONTRAST) + F::splat(0.5);
    let index = (index * last).fast_max(F::ZERO).fast_min(last - F::splat(1e-3)).to_array();
    let (cos, alpha) = (cos.to_array(), alpha.to_array());
    let albedo = F::from(eight(|lane| {
        let at = |i: usize| look_up(boundary(i), F::splat(cos[lane]), F::splat(alpha[lane]))[0].to_array()[0];
        let (i, t) = (index[lane] as usize, index[lane].fract());
        at(i) * (1.0 - t) + at(i + 1) * t
    }));
    thin.select(thin_loss, loss(albedo))
}

fn integrate_boundary(cos: f32, alpha: f32, eta: f32) -> f32 {
    let (alpha2, eta) = (F::splat(alpha * alpha), F::splat(eta));
    let masking = ggx::masking(F::splat(cos), alpha2);
    let n = V3::splat(glam::Vec3::Z);
    let mut sum = F::ZERO;
    for (wo, h) in microfacets(cos, alpha) {
        let fresnel = refraction::reflectance(wo.dot(h), eta);
        for (reflects, weight) in [(F::ONE.simd_gt(F::ZERO), fresnel), (F::ZERO, F::ONE - fresnel)] {
            let wi = refraction::reflect_or_refract(n, wo, h, eta, F::ZERO, reflects).wi;
            let valid = wi.length_squared().simd_gt(F::ZERO);
            sum += valid & (weight * ggx::shadowing(masking, ggx::masking(wi.z.abs(), alpha2)));
        }
    }
    mean(sum)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn interpolated_albedos_are_the_integrals_to_a_hundredth_and_at_grazing_angles_to_three() {
        for i in 0..40 {
            for j in 0..40 {
                let (cos, alpha) =
                    (((i as f32 + 0.37) / 40.0).powi(2), ((j as f32 + 0.61) / 40.0).powi(2).max(ggx::MIN_ALPHA));
                let [normal, grazing] = integrate_reflection(cos, alpha);
                let albedo = ggx(F::splat(cos), F::splat(alpha));
                let errors = [albedo.normal - F::splat(normal), albedo.grazing - F::splat(grazing)];
                let errors = errors.map(|error| error.to_array()[3].abs());
                // The part that Fresnel's rise adds at grazing angles is steep there.
                let most = if cos < 0.03 { 0.03 } else { 0.01 };
                assert!(errors[0] < 0.01 && errors[1] < most, "{cos} {alpha}: {errors:?}");
            }
        }
    }
}
