//! Transmission through surfaces against closed forms and quadrature, for every balance method and both backends.

use std::sync::Arc;

use bismar::bsdf::{Bsdf, Lobe, Parameters, Surface};
use bismar::integrator::surface::dispersion;
use bismar::lanes::{LANES, V3};
use bismar::rays::Backend;
use bismar::render::{Balance, GlassShadows, Integrator, RenderSettings};
use bismar::scene::{Environment, Material, Scene};
use glam::{DVec3, Vec3};

use crate::closed_forms::{BALANCES, agrees, floor_under_lamp, polygon_irradiance, settings};
use crate::helpers::stage::{Stage, add_sphere, area_light, closed_box, glass, glass_hall, lambert, look, rectangle};
use crate::helpers::statistics::z_limit;

const PATH: [Integrator; 1] = [Integrator::Path];

fn under_sky(radiance: f32) -> Scene {
    Scene { environment: Some(Environment::constant([radiance; 3])), ..Default::default() }
}

/// Reflectance of a dielectric for unpolarized light, by Fresnel's two formulas.
pub fn fresnel(eta: f64, theta: f64) -> f64 {
    let (cos, inside) = (theta.cos(), (1.0 - (theta.sin() / eta).powi(2)).sqrt());
    let s = (cos - eta * inside) / (cos + eta * inside);
    let p = (eta * cos - inside) / (eta * cos + inside);
    0.5 * (s * s + p * p)
}

#[test]
fn a_ball_of_clear_glass_vanishes_in_a_white_furnace() {
    let mut scene = under_sky(1.0);
    add_sphere(&mut scene, 12, 1.0, Vec3::ZERO, glass(1.5, 0.0));
    look(&mut scene, Vec3::new(0.0, 0.5, 3.0), Vec3::ZERO, 0.3);
    agrees(scene, 1.0, &PATH);
}

#[test]
fn index_one_is_invisible() {
    // A floor under an environment and an area light, seen and lit through a box: shadow rays are all occluded.
    let (mut scene, lamp) = floor_under_lamp(Vec3::new(0.0, 1.0, 3.0));
    scene.environment = Some(Environment::constant([2.0; 3]));
    let expected = 0.5 / std::f64::consts::PI * (10.0 * lamp + 2.0 * (std::f64::consts::PI - lamp));
    for roughness in [0.0, 0.7] {
        let mut scene = scene.clone();
        closed_box(&mut scene, Vec3::new(-0.5, 0.01, -0.5), Vec3::new(0.5, 0.6, 0.5), glass(1.0, roughness));
        agrees(scene, expected, &PATH);
    }
}

#[test]
fn a_slab_follows_beer_and_lambert() {
    // At normal and at oblique incidence; index 1, so that nothing is reflected or refracted.
    for (eye, cos) in [(Vec3::new(0.0, 3.0, 0.0), 1.0f64), (Vec3::new(0.0, 3.0, 3.0), 0.5f64.sqrt())] {
        let mut scene = under_sky(1.0);
        let medium = Material { absorption: Vec3::splat(2.5), ..glass(1.0, 0.0) };
        closed_box(&mut scene, Vec3::new(-1.0, -0.4, -1.0), Vec3::new(1.0, 0.0, 1.0), medium);
        look(&mut scene, eye, Vec3::ZERO, 1e-3);
        let expected = (-2.5 * 0.4 / cos).exp();
        // The result is deterministic up to ray offsets (16 roundings of the box) and the smallest refraction, an index of
        // 1.0001.
        let mean = Stage::new(Arc::new(scene), Backend::Embree).mean_green(&settings(), 2).mean;
        assert!((mean / expected - 1.0).abs() < 3e-4, "{mean} for {expected}");
    }
}

#[test]
fn a_slab_reflects_to_and_fro() {
    let mut scene = under_sky(1.0);
    let medium = Material { absorption: Vec3::splat(1.5), ..glass(1.6, 0.0) };
    closed_box(&mut scene, Vec3::new(-9.0, -0.4, -9.0), Vec3::new(9.0, 0.0, 9.0), medium);
    look(&mut scene, Vec3::new(0.0, 3.0, 1e-3), Vec3::ZERO, 1e-3);
    let (f, t) = (fresnel(1.6, 0.0), (-1.5f64 * 0.4).exp());
    let series = (1.0 - f).powi(2) / (1.0 - f * f * t * t);
    agrees(scene, f + series * f * t * t + series * t, &PATH);
}

#[test]
fn bounces_at_smooth_bodies_are_not_counted() {
    // Light passes six boundaries. Of the paths that are reflected in between, hardly one has more than 24 such bounces.
    let mut scene = under_sky(1.0);
    for i in 0..3 {
        let y = i as f32;
        closed_box(&mut scene, Vec3::new(-9.0, y, -9.0), Vec3::new(9.0, y + 0.5, 9.0), glass(1.5, 0.0));
    }
    look(&mut scene, Vec3::new(0.0, 9.0, 0.5), Vec3::ZERO, 1e-3);
    let stage = Stage::new(Arc::new(scene), Backend::Embree);
    for max_depth in [2, 3, 8] {
        let mean = stage.mean_green(&RenderSettings { max_depth, ..settings() }, 20);
        // Without roulette a path of the furnace is 1 or was cut.
        assert!(mean.mean > 0.98 && mean.mean < 1.001, "{max_depth}: {}", mean.mean);
    }
    // A path that is nothing but emission does not scatter.
    assert!(stage.mean_green(&RenderSettings { max_depth: 1, ..settings() }, 2).mean == 0.0);
    // Other bounces count in the same scene: the sky on a matt floor behind the glass is direct light.
    let lit = |max_depth| {
        let mut scene = under_sky(1.0);
        closed_box(&mut scene, Vec3::new(-9.0, 2.0, -9.0), Vec3::new(9.0, 2.5, 9.0), glass(1.5, 0.0));
        rectangle(&mut scene, 0.0, [-1.0, 1.0], [-1.0, 1.0], true, lambert(0.5));
        rectangle(&mut scene, 0.5, [-1.0, 1.0], [-1.0, 1.0], false, lambert(0.5));
        look(&mut scene, Vec3::new(0.0, 9.0, 0.5), Vec3::new(1.2, 0.0, 0.0), 1e-3);
        Stage::new(Arc::new(scene), Backend::Embree).mean_green(&RenderSettings { max_depth, ..settings() }, 20).mean
    };
    assert!(lit(2) > 0.0 && lit(2) <= lit(3));
}

#[test]
fn a_thin_wall_reflects_and_tints() {
    let mut scene = under_sky(1.0);
    let base_color = Vec3::splat(0.3).extend(1.0);
    let wall = Material { bounds_medium: false, base_color, ..glass(1.5, 0.0) };
    rectangle(&mut scene, 0.0, [-9.0, 9.0], [-9.0, 9.0], true, wall);
    look(&mut scene, Vec3::new(0.0, 3.0, 5.0), Vec3::ZERO, 1e-3);
    let f = fresnel(1.5, (5.0f64 / 3.0).atan());
    agrees(scene, f + (1.0 - f) * 0.3, &PATH);
}

/// Radiance through a surface at y = 0 from an area light of radiance 1 below it, seen from `eye`: quadrature of the BSDF over
/// the light's area, with absorption along the way.
fn radiance_through(surface: &Surface, absorption: f64, eye: Vec3, [low, high]: [f32; 2], y: f32) -> f64 {
    const N: usize = 400;
    let bsdf = Bsdf::gather([&surface.bsdf(); LANES]);
    let (n, wo) = (V3::splat(Vec3::Y), V3::splat(eye.normalize()));
    let step = (high - low) / N as f32;
    let mut sum = 0.0;
    for i in 0..N * N {
        let at = |k: usize| low + (k as f32 + 0.5) * step;
        let p = Vec3::new(at(i % N), y, at(i / N));
        let wi = p.normalize();
        let value = f64::from(bsdf.eval_pdf(n, wo, V3::splat(wi)).0.lane(0).y);
        let distance = f64::from(p.length());
        sum += value * f64::from(-wi.y) / (distance * distance) * (-absorption * distance).exp();
    }
    sum * f64::from(step * step)
}

#[test]
fn both_techniques_find_an_area_light_behind_rough_glass() {
    let eye = Vec3::new(0.0, 3.0, 1.5);
    for (bounds_medium, absorption) in [(false, 0.0), (true, 0.0), (true, 0.8)] {
        let mut scene = Scene::default();
        let absorption3 = Vec3::splat(absorption as f32);
        let material = Material { bounds_medium, absorption: absorption3, ..glass(1.5, 0.7) };
        rectangle(&mut scene, 0.0, [-9.0, 9.0], [-9.0, 9.0], true, material);
        rectangle(&mut scene, -1.2, [-0.7, 0.3], [-0.7, 0.3], true, area_light(10.0));
        look(&mut scene, eye, Vec3::ZERO, 1e-4);
        let surface = Surface { roughness: 0.7, transmission: 1.0, bounds_medium, ..Surface::default() };
        let expected = 10.0 * radiance_through(&surface, absorption, eye, [-0.7, 0.3], -1.2);
        assert!(expected > 0.1, "{expected}");
        agrees(scene, expected, &[Integrator::Direct]);
    }
}

#[test]
fn an_area_light_shines_through_a_leaf() {
    let eye = Vec3::new(0.0, 3.0, 1.5);
    let mut scene = Scene::default();
    let diffuse_transmission_color = Vec3::splat(0.5);
    let leaf = Material { diffuse_transmission: 0.6, diffuse_transmission_color, ..lambert(0.5) };
    rectangle(&mut scene, 0.0, [-9.0, 9.0], [-9.0, 9.0], true, leaf);
    rectangle(&mut scene, -1.2, [-0.7, 0.3], [-0.7, 0.3], true, area_light(10.0));
    look(&mut scene, eye, Vec3::ZERO, 1e-4);
    let corners = [(-0.7, -0.7), (0.3, -0.7), (0.3, 0.3), (-0.7, 0.3)].map(|(x, z)| DVec3::new(x, -1.2, z));
    agrees(scene, 0.6 * 0.5 / std::f64::consts::PI * 10.0 * polygon_irradiance(DVec3::ZERO, &corners), &PATH);
}

#[test]
fn a_coat_dims_what_shines_beneath_it() {
    let mut scene = Scene::default();
    rectangle(&mut scene, 0.0, [-5.0, 5.0], [-5.0, 5.0], true, lambert(0.5));
    rectangle(&mut scene, 0.8, [-1.5, 2.0], [-1.7, 1.4], false, Material { clearcoat: 0.9, ..area_light(10.0) });
    look(&mut scene, Vec3::new(0.0, 0.5, 3.0), Vec3::ZERO, 1e-3);
    // Quadrature over the area light.
    const N: usize = 1000;
    let mut sum = 0.0;
    for i in 0..N * N {
        let at = |low: f64, high: f64, k: usize| low + (k as f64 + 0.5) * (high - low) / N as f64;
        let p = DVec3::new(at(-1.5, 2.0, i % N), 0.8, at(-1.7, 1.4, i / N));
        let cos = 0.8 / p.length();
        sum += cos * cos / p.length_squared() * (1.0 - 0.9 * (0.04 + 0.96 * (1.0 - cos).powi(5)));
    }
    let irradiance = 10.0 * sum * (3.5 * 3.1) / (N * N) as f64;
    agrees(scene, 0.5 / std::f64::consts::PI * irradiance, &[Integrator::Direct]);
}

#[test]
fn each_color_is_bent_by_its_own_index() {
    // A dispersive ball over a striped area light, against the same ball with each channel's index. It is rough, so that light
    // samples contribute too.
    let ball = |ior: f32, dispersion: f32| {
        let mut scene = under_sky(0.1);
        let absorption = Vec3::new(0.1, 0.4, 0.2);
        add_sphere(&mut scene, 8, 1.0, Vec3::ZERO, Material { dispersion, absorption, ..glass(ior, 0.3) });
        rectangle(&mut scene, -2.5, [-1.5, -0.3], [-2.0, 2.0], true, area_light(4.0));
        look(&mut scene, Vec3::new(1.5, 3.0, 0.5), Vec3::ZERO, 0.5);
        Stage::new(Arc::new(scene), Backend::Embree)
    };
    let settings = RenderSettings { width: 8, height: 6, max_depth: 12, ..settings() };
    let together = ball(1.5, 8.0);
    for channel in 0..3 {
        let ior = [1.4, 1.5, 1.6][channel];
        assert!((dispersion::index(1.5, 8.0, channel) - ior).abs() < 1e-6);
        let alone = ball(ior, 0.0);
        let mean = |stage: &Stage, seed, replicas| {
            stage.mean_channel(&RenderSettings { seed, ..settings.clone() }, replicas, channel)
        };
        let (one, all) = (mean(&alone, 0, 60), mean(&together, 5000, 120));
        let z = one.z_to(&all);
        assert!(z.abs() < z_limit(3), "{channel}: {} alone, {} together, z = {z}", one.mean, all.mean);
        // The test distinguishes the indices.
        let other = mean(&ball(1.5 + 0.1 * (channel as f32 - 1.0) + 0.1, 0.0), 0, 60);
        assert!((other.mean - one.mean).abs() > 5.0 * one.standard_error().hypot(all.standard_error()), "{channel}");
    }
}

#[test]
fn all_balances_agree_on_a_hall_with_glass() {
    let scene = glass_hall();
    let stage = Stage::new(scene, Backend::Embree);
    let settings = RenderSettings { width: 8, height: 6, max_depth: 10, ..settings() };
    let reference = stage
        .mean_green(&RenderSettings { balance: Balance::Half, seed: 900_000, spp: Some(128), ..settings.clone() }, 100);
    for balance in BALANCES {
        let mean = stage.mean_green(&RenderSettings { balance, ..settings.clone() }, 200);
        let z = mean.z_to(&reference);
        assert!(z.abs() < z_limit(BALANCES.len()), "{balance:?}: {} for {}, z = {z}", mean.mean, reference.mean);
    }
}

#[test]
fn nothing_is_infinite_or_undefined_however_deep() {
    // Nested media of many indices and roughnesses, one of them around the camera, some of them emissive.
    let mut scene = under_sky(1.0);
    let around = Material { absorption: Vec3::splat(0.01), ..glass(1.33, 0.1) };
    add_sphere(&mut scene, 5, 8.0, Vec3::ZERO, around);
    for (i, ior) in (0..).zip([0.0, 1.0, 1.000_01, 1.5, 2.4, 50.0]) {
        for (j, roughness) in (0..).zip([0.0, 0.1, 1.0]) {
            let center = Vec3::new(0.8 * i as f32 - 2.0, 0.7 * j as f32 - 0.7, 0.0);
            for radius in [0.6, 0.3] {
                let emissive = Vec3::splat(f32::from(u8::from(i == 3)));
                let absorption = Vec3::new(0.0, 1e30, 1.0);
                add_sphere(&mut scene, 4, radius, center, Material { emissive, absorption, ..glass(ior, roughness) });
            }
        }
    }
    look(&mut scene, Vec3::new(0.0, 0.0, 5.0), Vec3::ZERO, 0.9);
    let stage = Stage::new(Arc::new(scene), Backend::Embree);
    for balance in BALANCES {
        for glass_shadows in GlassShadows::ALL {
            let settings =
                RenderSettings { width: 24, height: 16, balance, max_depth: 64, glass_shadows, ..settings() };
            let pixels = stage.green(&settings);
            assert!(pixels.iter().all(|p| p.is_finite()) && pixels.iter().sum::<f64>() > 0.0);
        }
    }
}
