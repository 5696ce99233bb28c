//! Lights with a size, spheres and discs: closed forms, and one mean for all balances.

use std::f64::consts::PI;
use std::sync::Arc;

use bismar::rays::Backend;
use bismar::render::{Balance, Integrator, RenderSettings};
use bismar::scene::{PunctualKind, Scene};
use glam::{DVec3, Vec3};

use crate::closed_forms::{BALANCES, BOTH, REPLICAS, settings};
use crate::helpers::stage::{Stage, lambert, look, metal, punctual, rectangle};
use crate::helpers::statistics::z_limit;

/// What 32-bit floats round of an estimate whose samples all agree.
const ROUNDING: f64 = 5e-6;

/// Renders with every balance, backend and integrator; all must agree with `expected`.
fn agrees(name: &str, scene: Scene, expected: f64) {
    let scene = Arc::new(scene);
    let limit = z_limit(2 * BALANCES.len() * BOTH.len());
    for backend in [Backend::Embree, Backend::Obvhs] {
        let stage = Stage::new(scene.clone(), backend);
        for (integrator, balance) in BOTH.iter().flat_map(|&one| BALANCES.map(|balance| (one, balance))) {
            let mean = stage.mean_green(&RenderSettings { balance, integrator, ..settings() }, REPLICAS);
            let error = mean.standard_error().hypot(ROUNDING * expected);
            let z = (mean.mean - expected) / error;
            let what = format!("{name}, {backend:?} {integrator:?} {balance:?}");
            assert!(z.abs() < limit, "{what}: {} ± {error} for {expected}, z = {z}", mean.mean);
        }
    }
}

/// A diffuse floor under one light of 30 cd or lux, seen from above the light.
fn under(kind: PunctualKind, size: f32, direction: Vec3) -> Scene {
    let mut scene = Scene::default();
    rectangle(&mut scene, 0.0, [-5.0, 5.0], [-5.0, 5.0], true, lambert(0.5));
    scene.lights.push(punctual(kind, 30.0, POSITION, direction));
    scene.lights[0].size = size;
    look(&mut scene, Vec3::new(0.0, 1.0, 3.0), Vec3::ZERO, 1e-4);
    scene
}

const POSITION: Vec3 = Vec3::new(1.0, 2.0, 0.0);

/// Radiance of the floor for an irradiance.
fn reflected(irradiance: f64) -> f64 {
    0.5 / PI * irradiance
}

/// Irradiance at the origin by a cone of radiance 1 around `axis`, by midpoints.
fn cone_irradiance(axis: DVec3, half_angle: f64) -> f64 {
    let (n, (x, y)) = (2000, axis.any_orthonormal_pair());
    let midpoint = |i: i32| (f64::from(i) + 0.5) / f64::from(n);
    let ring = |i: i32| {
        let cos = 1.0 - midpoint(i) * (1.0 - half_angle.cos());
        let sin = (1.0 - cos * cos).sqrt();
        let toward = |phi: f64| axis * cos + (x * phi.cos() + y * phi.sin()) * sin;
        (0..n).map(|j| toward(2.0 * PI * midpoint(j)).y.max(0.0)).sum::<f64>()
    };
    (0..n).map(ring).sum::<f64>() * 2.0 * PI * (1.0 - half_angle.cos()) / f64::from(n * n)
}

#[test]
fn a_sphere_above_the_horizon_has_the_irradiance_of_a_point() {
    let expected = reflected(30.0 * (2.0 / 5.0f64.sqrt()) / 5.0);
    for radius in [1e-30, 1e-9, 1e-3, 0.1, 1.0, 1.99] {
        agrees(&format!("radius {radius}"), under(PunctualKind::Point, radius, Vec3::NEG_Y), expected);
    }
    // The cosine of the angle with the spot's axis is 0.9: a quarter is left halfway down the ramp, at the centre.
    let direction = -POSITION.normalize() * 0.9 + Vec3::Z * (1.0f32 - 0.81).sqrt();
    let spot = PunctualKind::Spot { inner: 0.95f32.acos(), outer: 0.85f32.acos() };
    let mut scene = under(spot, 0.3, direction);
    agrees("spot", scene.clone(), 0.25 * expected);
    scene.lights[0].range = 3.0;
    agrees("range", scene, 0.25 * (1.0 - 25.0 / 81.0) * expected);
}

#[test]
fn a_sphere_that_the_floor_cuts_or_is_inside_of_has_the_radiance_of_its_surface() {
    let (axis, distance) = (POSITION.as_dvec3().normalize(), POSITION.as_dvec3().length());
    let radiance = |radius: f64| 30.0 / (PI * radius * radius);
    let cut = cone_irradiance(axis, (2.1 / distance).asin());
    agrees("cut", under(PunctualKind::Point, 2.1, Vec3::NEG_Y), reflected(radiance(2.1) * cut));
    for radius in [2.3f32, 40.0, 1e9] {
        let inside = reflected(radiance(radius.into()) * PI);
        agrees(&format!("inside {radius}"), under(PunctualKind::Point, radius, Vec3::NEG_Y), inside);
    }
}

#[test]
fn a_disc_has_the_irradiance_of_a_directional_light() {
    for degrees in [0.0, 1e-20, 0.53, 30.0, 100.0, 180.0f32] {
        let half = 0.5 * degrees.to_radians();
        // Beyond 106 degrees the horizon cuts it; half of the sphere has (1 + cos)/2 of it above.
        let expected = if degrees == 180.0 { 30.0 * 0.5 * (1.0 + 0.8) } else { 30.0 * 0.8 };
        let scene = under(PunctualKind::Directional, half, Vec3::new(0.6, -0.8, 0.0));
        agrees(&format!("{degrees} degrees"), scene, reflected(expected));
    }
}

#[test]
fn mirrors_show_a_light_with_a_size_and_the_camera_does_not() {
    let scene = |toward: Vec3| {
        let mut scene = Scene::default();
        rectangle(&mut scene, 0.0, [-5.0, 5.0], [-5.0, 5.0], true, metal(0.0));
        scene.lights.push(punctual(PunctualKind::Point, 30.0, Vec3::new(0.0, 2.0, -2.0), Vec3::NEG_Y));
        scene.lights[0].size = 0.5;
        look(&mut scene, Vec3::new(0.0, 2.0, 2.0), toward, 1e-3);
        Stage::new(Arc::new(scene), Backend::Embree)
    };
    let (mirror, camera) = (scene(Vec3::ZERO), scene(Vec3::new(0.0, 2.0, -2.0)));
    let radiance = 30.0 / (PI * 0.25);
    for balance in Balance::all() {
        let settings = RenderSettings { balance: *balance, integrator: Integrator::Direct, ..settings() };
        assert_eq!(camera.mean_green(&settings, 2).mean, 0.0);
        // One in a hundred reflections of the smoothest metal is far from the mirror's direction.
        let seen = mirror.mean_green(&settings, 20).mean / radiance;
        assert!((0.97..=1.01).contains(&seen), "{balance:?}: {seen}");
    }
}
