//! The BSDF's promises: samples follow the pdf, values are reciprocal, white surfaces lose nothing.

use std::f32::consts::FRAC_1_PI;

use bismar::bsdf::{Bsdf, Layered, Microfacet, Parameters, Surface};
use bismar::lanes::{F, LANES, V3};
use glam::Vec3;

use crate::helpers::random::Random;
use crate::helpers::statistics::{Mean, chi_square_directions, direction, z_limit};

/// f cos θ_i and pdf in the local frame, where the normal is +z.
fn eval_pdf(bsdf: &Bsdf, wo: Vec3, wi: Vec3) -> (Vec3, f32) {
    let (value, pdf) = Bsdf::gather([bsdf; LANES]).eval_pdf(V3::splat(Vec3::Z), V3::splat(wo), V3::splat(wi));
    (value.lane(0), pdf.as_array()[0])
}

struct Sample {
    wi: Vec3,
    value: Vec3,
    pdf: f32,
}

/// A sample in the local frame, from the last lane; `None` for a failed one.
fn sample(bsdf: &Bsdf, wo: Vec3, lobe: f32, u: f32, v: f32) -> Option<Sample> {
    let numbers = [lobe, u, v].map(F::splat);
    let s = Bsdf::gather([bsdf; LANES]).sample(V3::splat(Vec3::Z), V3::splat(wo), numbers);
    let pdf = s.pdf.as_array()[7];
    (pdf > 0.0).then(|| Sample { wi: s.wi.lane(7), value: s.value.lane(7), pdf })
}

fn surface(metallic: f32, roughness: f32) -> Surface {
    Surface {
        base_color: Vec3::new(0.8, 0.5, 0.3),
        metallic,
        roughness,
        specular: 1.0,
        specular_color: Vec3::ONE,
        ior: 1.5,
    }
}

/// Pure Lambert, dielectrics, a mix, metals; roughness from narrow to full.
fn surfaces() -> Vec<(String, Surface)> {
    let mut all = vec![("lambert".to_string(), Surface { specular: 0.0, ..surface(0.0, 1.0) })];
    for metallic in [0.0, 0.4, 1.0] {
        for roughness in [0.35, 0.6, 1.0] {
            all.push((format!("metallic {metallic} roughness {roughness}"), surface(metallic, roughness)));
        }
    }
    let tinted = Surface { specular: 0.7, specular_color: Vec3::new(1.0, 0.2, 3.0), ior: 1.8, ..surface(0.2, 0.5) };
    all.push(("tinted specular".to_string(), tinted));
    all
}

const ANGLES: [f64; 4] = [0.05, 0.7, 1.2, 1.5];

#[test]
fn samples_follow_the_pdf() {
    let surfaces = surfaces();
    let tests = surfaces.len() * ANGLES.len();
    let mut random = Random(1);
    for (name, s) in &surfaces {
        let bsdf = s.bsdf();
        for theta in ANGLES {
            let wo = direction(theta, 0.6);
            chi_square_directions(
                &format!("{name}, θ = {theta}"),
                tests,
                (200_000, 12),
                || sample(&bsdf, wo, random.f32(), random.f32(), random.f32()).map(|s| s.wi),
                |wi| f64::from(eval_pdf(&bsdf, wo, wi).1),
            );
        }
    }
}

#[test]
fn samples_of_three_layers_follow_the_pdf() {
    // A coat over dielectric, metal and a mix: only tests compose it.
    let coat = Microfacet { f0: Vec3::splat(0.3), f90: 1.0, layer0: 0.3, layer90: 1.0, alpha: 0.15 };
    let mut random = Random(9);
    for metallic in [0.0, 0.4, 1.0] {
        let layers = Layered { top: coat, base: surface(metallic, 0.8).bsdf() };
        let bsdf = Layered::gather([&layers; LANES]);
        for theta in ANGLES {
            let (n, wo) = (V3::splat(Vec3::Z), V3::splat(direction(theta, 0.6)));
            chi_square_directions(
                &format!("metallic {metallic} under a coat, θ = {theta}"),
                3 * ANGLES.len(),
                (200_000, 12),
                || {
                    let s = bsdf.sample(n, wo, [random.f32(), random.f32(), random.f32()].map(F::splat));
                    (s.pdf.as_array()[0] > 0.0).then(|| s.wi.lane(0))
                },
                |wi| f64::from(bsdf.eval_pdf(n, wo, V3::splat(wi)).1.as_array()[0]),
            );
        }
    }
}

#[test]
fn sampled_value_and_pdf_are_those_of_evaluation() {
    let mut random = Random(2);
    for (name, s) in surfaces() {
        let bsdf = s.bsdf();
        for theta in ANGLES {
            let wo = direction(theta, 0.6);
            for _ in 0..1000 {
                let Some(sample) = sample(&bsdf, wo, random.f32(), random.f32(), random.f32()) else { continue };
                let (value, pdf) = eval_pdf(&bsdf, wo, sample.wi);
                // The half vector is rebuilt from rounded directions: its error over the lobe's width, squared.
                let alpha = (s.roughness * s.roughness).max(1e-3);
                let tolerance = 64.0 * f32::EPSILON / (alpha * alpha) + 1e-4;
                assert!((pdf / sample.pdf - 1.0).abs() < tolerance, "{name} {theta}: {pdf} {}", sample.pdf);
                assert!((value - sample.value).length() <= tolerance * sample.value.length(), "{name} {theta}");
            }
        }
    }
}

#[test]
fn values_are_reciprocal() {
    let mut random = Random(3);
    for (name, s) in surfaces() {
        let bsdf = s.bsdf();
        for _ in 0..2000 {
            let mut draw = || direction(1.5 * f64::from(random.f32()), 6.0 * f64::from(random.f32()));
            let (a, b) = (draw(), draw());
            let forth = eval_pdf(&bsdf, a, b).0 / b.z;
            let back = eval_pdf(&bsdf, b, a).0 / a.z;
            assert!((forth - back).length() <= 1e-4 * forth.length(), "{name}: {forth} {back}");
        }
    }
}

/// Reflected share of uniform white light, by BSDF sampling.
fn albedo(bsdf: &Bsdf, wo: Vec3, samples: u32, random: &mut Random) -> Mean {
    let mut mean = Mean::default();
    for _ in 0..samples {
        let sample = sample(bsdf, wo, random.f32(), random.f32(), random.f32());
        mean.add(sample.map_or(0.0, |s| f64::from(s.value.y / s.pdf)));
    }
    mean
}

#[test]
fn white_lambert_in_a_white_furnace_returns_one() {
    let s = Surface { base_color: Vec3::ONE, specular: 0.0, ..surface(0.0, 1.0) };
    let bsdf = s.bsdf();
    for theta in ANGLES {
        let mean = albedo(&bsdf, direction(theta, 0.0), 1000, &mut Random(4));
        assert!(mean.z(1.0).abs() <= z_limit(ANGLES.len()), "{theta}: {}", mean.mean);
    }
}

#[test]
fn smooth_white_metal_in_a_white_furnace_returns_one() {
    // Single scattering conserves energy as roughness goes to zero: at alpha = 1e-3 the loss at θ is at most of the
    // order alpha² tan²θ, 3e-4 at the steepest angle here.
    let bsdf = Surface { base_color: Vec3::ONE, ..surface(1.0, 0.0) }.bsdf();
    for theta in [0.05, 0.7, 1.2, 1.5] {
        let mean = albedo(&bsdf, direction(theta, 0.0), 20_000, &mut Random(5));
        assert!((mean.mean - 1.0).abs() < 3e-4, "{theta}: {}", mean.mean);
    }
}

#[test]
fn no_metal_reflects_more_than_it_receives() {
    // White dielectrics do: see below.
    let mut random = Random(6);
    for roughness in [0.0, 0.3, 0.7, 1.0] {
        let bsdf = Surface { base_color: Vec3::ONE, ..surface(1.0, roughness) }.bsdf();
        for theta in ANGLES {
            let mean = albedo(&bsdf, direction(theta, 0.0), 20_000, &mut random);
            let excess = (mean.mean - 1.0) / mean.standard_error().max(1e-6);
            assert!(excess < z_limit(16), "{roughness} {theta}: {}", mean.mean);
        }
    }
}

#[test]
fn white_dielectrics_reflect_as_much_as_the_specified_model() {
    // More than they receive at grazing angles: the diffuse term is dimmed by the Fresnel term at the half vector, not by
    // what the layer reflects in all. Albedos by the midpoint rule in the light's cosine and azimuth, 500 x 500 points in
    // double precision, from the formulas of the specification's appendix B; refined, they change by less than 1e-3.
    let limit = z_limit(6);
    for (roughness, cos, expected) in [
        (0.2, 0.4, 1.067),
        (0.2, 0.2, 1.269),
        (0.2, 0.1, 1.425),
        (0.4, 0.4, 1.044),
        (0.4, 0.2, 1.123),
        (0.4, 0.1, 1.169),
    ] {
        let bsdf = Surface { base_color: Vec3::ONE, ..surface(0.0, roughness) }.bsdf();
        let mean = albedo(&bsdf, direction(f64::acos(cos), 0.0), 200_000, &mut Random(8));
        let error = (mean.mean - expected).abs();
        assert!(error < limit * mean.standard_error() + 1e-3, "{roughness} {cos}: {} not {expected}", mean.mean);
    }
}

#[test]
fn sampling_the_lobe_and_sampling_the_cosine_find_the_same_albedo() {
    // An independent estimate of the same integral, that never calls `sample`.
    let mut random = Random(7);
    let surfaces = surfaces();
    let limit = z_limit(surfaces.len() * ANGLES.len());
    for (name, s) in &surfaces {
        let bsdf = s.bsdf();
        for theta in ANGLES {
            let wo = direction(theta, 0.3);
            let by_lobe = albedo(&bsdf, wo, 100_000, &mut random);
            let mut by_cosine = Mean::default();
            for _ in 0..100_000 {
                let (u, v) = (F::splat(random.f32()), F::splat(random.f32()));
                let wi = bismar::sampling::warp::cosine_hemispheres(u, v).lane(0);
                by_cosine.add(if wi.z > 0.0 {
                    f64::from(eval_pdf(&bsdf, wo, wi).0.y / (wi.z * FRAC_1_PI))
                } else {
                    0.0
                });
            }
            let error = by_lobe.standard_error().hypot(by_cosine.standard_error()).max(1e-6);
            let z = (by_lobe.mean - by_cosine.mean) / error;
            assert!(z.abs() < limit, "{name} {theta}: {} {} z = {z}", by_lobe.mean, by_cosine.mean);
        }
    }
}
