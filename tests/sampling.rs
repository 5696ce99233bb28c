//! Draws in one dimension, of a few outcomes and of warped squares follow their densities: chi-square tests.

use std::f64::consts::PI;

use bismar::lanes::F;
use bismar::light::punctual;
use bismar::sampling::{Discrete, FilterSampler, PixelFilter, warp};
use bismar::scene::{PunctualKind, PunctualLight};
use glam::{Vec3, vec3};

use crate::helpers::random::Random;
use crate::helpers::stage;
use crate::helpers::statistics::{chi_square, chi_square_directions};

/// Tests in this file, for the level of each.
const TESTS: usize = 17;
const SAMPLES: usize = 400_000;

/// Are numbers from `draw` in [`low`, `high`) distributed by `density`, which need not be normalized?
fn chi_square_line(name: &str, [low, high]: [f64; 2], mut draw: impl FnMut() -> f64, density: impl Fn(f64) -> f64) {
    const CELLS: usize = 128;
    const FINE: usize = 64;
    let width = (high - low) / CELLS as f64;
    let mass = |cell: usize| -> f64 {
        let at = |i: usize| low + (cell as f64 + (i as f64 + 0.5) / FINE as f64) * width;
        (0..FINE).map(|i| density(at(i))).sum()
    };
    let masses: Vec<f64> = (0..CELLS).map(mass).collect();
    let total: f64 = masses.iter().sum();
    let expected: Vec<f64> = masses.iter().map(|mass| mass / total * SAMPLES as f64).collect();
    let mut observed = vec![0; CELLS];
    for _ in 0..SAMPLES {
        let x = draw();
        assert!((low..=high).contains(&x), "{name}: {x}");
        observed[(((x - low) / width) as usize).min(CELLS - 1)] += 1;
    }
    chi_square(name, TESTS, &observed, &expected, |i| i.to_string());
}

#[test]
fn filter_offsets_follow_the_filter_along_both_axes() {
    let gaussian = |x: f64| (-2.0 * x * x).exp();
    let window = |x: f64| {
        let t = 2.0 * PI * (x / 3.0 + 0.5);
        0.35875 - 0.48829 * t.cos() + 0.14128 * (2.0 * t).cos() - 0.01168 * (3.0 * t).cos()
    };
    type Density<'a> = &'a dyn Fn(f64) -> f64;
    let filters: [(PixelFilter, f64, Density); 3] = [
        (PixelFilter::Box, 0.5, &|_| 1.0),
        (PixelFilter::Gaussian, 1.5, &gaussian),
        (PixelFilter::BlackmanHarris, 1.5, &window),
    ];
    for (k, (filter, radius, density)) in filters.into_iter().enumerate() {
        let sampler = FilterSampler::new(filter);
        for axis in 0..2 {
            let mut random = Random(100 + 2 * k as u64 + axis as u64);
            let draw = || f64::from(sampler.offsets(F::splat(random.f32())).as_array()[axis]);
            chi_square_line(&format!("{filter:?}, axis {axis}"), [-radius, radius], draw, density);
        }
    }
}

#[test]
fn linear_warps_follow_the_line() {
    for (k, (a, b)) in [(1.0, 1.0), (0.0, 1.0), (1.0, 0.0), (0.3, 2.0), (5.0, 0.01)].into_iter().enumerate() {
        let mut random = Random(200 + k as u64);
        let draw =
            || f64::from(warp::linear(F::splat(random.f32()), F::splat(a as f32), F::splat(b as f32)).as_array()[5]);
        chi_square_line(&format!("from {a} to {b}"), [0.0, 1.0], draw, |x| a + (b - a) * x);
    }
}

#[test]
fn points_of_a_triangle_are_uniform() {
    const SIDE: usize = 24;
    let mut random = Random(300);
    let (mut observed, mut expected) = (vec![0; SIDE * SIDE], vec![0.0; SIDE * SIDE]);
    for _ in 0..SAMPLES {
        let (b1, b2) = warp::triangles(F::splat(random.f32()), F::splat(random.f32()));
        let (b1, b2) = (b1.as_array()[2], b2.as_array()[2]);
        assert!(b1 >= 0.0 && b2 >= 0.0 && b1 + b2 <= 1.0 + f32::EPSILON, "{b1} {b2}");
        let cell = |b: f32| ((b * SIDE as f32) as usize).min(SIDE - 1);
        observed[cell(b1) * SIDE + cell(b2)] += 1;
    }
    for i in 0..SIDE {
        for j in 0..SIDE - i {
            // Cells on the diagonal lie half inside.
            let inside = if i + j == SIDE - 1 { 0.5 } else { 1.0 };
            expected[i * SIDE + j] = inside * 2.0 / (SIDE * SIDE) as f64 * SAMPLES as f64;
        }
    }
    chi_square("triangle", TESTS, &observed, &expected, |i| format!("({}, {})", i / SIDE, i % SIDE));
}

#[test]
fn directions_of_the_sphere_and_the_hemisphere_follow_their_densities() {
    let mut random = Random(400);
    let sphere = || Some(warp::sphere(random.f32(), random.f32()));
    chi_square_directions("sphere", TESTS, (SAMPLES, 8), sphere, |_| 0.25 / PI);
    let cosine =
        || Some(warp::cosine_hemispheres(F::splat(random.f32()), F::splat(random.f32())).lane(6)).filter(|w| w.z > 0.0);
    chi_square_directions("cosine", TESTS, (SAMPLES, 8), cosine, |w| f64::from(w.z.max(0.0)) / PI);
}

#[test]
fn discrete_choices_and_their_left_over_numbers_follow_the_weights() {
    let mut random = Random(500);
    // Over nine powers of two, some zero.
    let weights: Vec<f32> =
        (0..1000).map(|i| if i % 7 == 0 { 0.0 } else { (9.0 * random.f32()).exp2() * random.f32() }).collect();
    let table = Discrete::new(weights.iter().copied()).unwrap();
    let total: f64 = weights.iter().map(|&w| f64::from(w)).sum();
    assert!((table.total() / total - 1.0).abs() < 1e-12);
    let expected: Vec<f64> = weights.iter().map(|&w| f64::from(w) / total * SAMPLES as f64).collect();
    let sum: f64 = (0..weights.len() as u32).map(|i| f64::from(table.pmf(i))).sum();
    assert!((sum - 1.0).abs() < 1e-6, "the probabilities add up to {sum}");
    let mut observed = vec![0; weights.len()];
    for _ in 0..SAMPLES {
        observed[table.sample(random.f32()).0 as usize] += 1;
    }
    chi_square("outcomes", TESTS, &observed, &expected, |i| i.to_string());
    // What is left of the number is uniform again, where an outcome is wide enough to leave some bits.
    let wide = Discrete::new([1.0, 3.0, 2.0, 0.5].into_iter()).unwrap();
    chi_square_line("left over", [0.0, 1.0], || f64::from(wide.sample(random.f32()).1), |_| 1.0);
}

#[test]
fn punctual_lights_are_chosen_by_what_they_bring() {
    let light = |kind, intensity: Vec3, position: Vec3| PunctualLight {
        intensity,
        ..stage::punctual(kind, 1.0, position, -Vec3::Y)
    };
    let spot = PunctualKind::Spot { inner: 0.2, outer: 0.9 };
    let lights = [
        light(PunctualKind::Point, vec3(2.0, 1.0, 0.5), vec3(0.0, 2.0, 0.0)),
        light(PunctualKind::Point, vec3(0.0, 40.0, 0.0), vec3(9.0, 1.0, 3.0)),
        light(PunctualKind::Directional, Vec3::splat(0.3), Vec3::ZERO),
        light(spot, Vec3::splat(8.0), vec3(1.0, 2.5, 0.0)),
        // The point is outside this one's cone.
        light(spot, Vec3::splat(90.0), vec3(5.0, 0.5, 0.0)),
    ];
    // Irradiance at the origin by KHR_lights_punctual's formulas.
    let cos = 2.5 / f64::hypot(1.0, 2.5);
    let fade = ((cos - 0.9_f64.cos()) / (0.2_f64.cos() - 0.9_f64.cos())).clamp(0.0, 1.0).powi(2);
    let brings = [
        vec3(2.0, 1.0, 0.5) / 4.0,
        vec3(0.0, 40.0, 0.0) / 91.0,
        Vec3::splat(0.3),
        Vec3::splat(8.0 / 7.25 * fade as f32),
        Vec3::ZERO,
    ];
    let weight = |e: &Vec3| f64::from(e.dot(vec3(0.2126, 0.7152, 0.0722)));
    let total: f64 = brings.iter().map(weight).sum();
    let expected: Vec<f64> = brings.iter().map(|e| weight(e) / total * SAMPLES as f64).collect();
    let distances = [2.0, 91_f32.sqrt(), f32::INFINITY, 7.25_f32.sqrt()];
    let mut observed = vec![0; lights.len()];
    let mut random = Random(600);
    for _ in 0..SAMPLES {
        let chosen = punctual::choose(&lights, Vec3::ZERO, random.f32(), 0.0).unwrap();
        let which = distances.iter().position(|&d| d == chosen.distance || (d - chosen.distance).abs() < 1e-4).unwrap();
        observed[which] += 1;
        // What the choice carries is its light over its probability: the mean over choices is the sum of all lights.
        let carried = chosen.irradiance * (weight(&brings[which]) / total) as f32;
        assert!((carried - brings[which]).length() < 1e-5 * brings[which].length(), "{which}: {carried}");
    }
    chi_square("punctual lights", TESTS, &observed, &expected, |i| i.to_string());
}
