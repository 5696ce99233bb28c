//! `--glass-shadows straight`: light through bodies of smooth glass, none of it twice.

use std::f64::consts::{FRAC_1_PI, PI};
use std::sync::Arc;

use bismar::rays::Backend;
use bismar::render::{GlassShadows, Integrator, RenderSettings};
use bismar::scene::{Environment, Material, PunctualKind, Scene};
use glam::{DVec3, Vec3};

use crate::closed_forms::{BALANCES, polygon_irradiance, settings};
use crate::helpers::stage::{Stage, area_light, closed_box, glass, lambert, look, punctual, rectangle};
use crate::helpers::statistics::z_limit;
use crate::thin_walls::{LIGHT, floor_under, irradiance, left, pane};

/// Renders with every balance and backend, with straight shadows; all must agree with `expected`.
fn agrees(scene: Scene, expected: f64, integrator: Integrator) {
    let scene = Arc::new(scene);
    for backend in [Backend::Embree, Backend::Obvhs] {
        let stage = Stage::new(scene.clone(), backend);
        for balance in BALANCES {
            let glass_shadows = GlassShadows::Straight;
            let settings = RenderSettings { balance, integrator, glass_shadows, max_depth: 12, ..settings() };
            let mean = stage.mean_green(&settings, 150);
            let z = mean.z(expected);
            let error = mean.standard_error();
            assert!(
                z.abs() < z_limit(2 * BALANCES.len()),
                "{backend:?} {balance:?}: {} ± {error} for {expected}, z = {z}",
                mean.mean
            );
        }
    }
}

/// A slab of glass over the floor of [`floor_under`], above its camera, 0.4 thick.
fn slab(ior: f32, absorption: f32) -> Scene {
    let mut scene = floor_under(0, &pane());
    let material = Material { absorption: Vec3::splat(absorption), ..glass(ior, 0.0) };
    closed_box(&mut scene, Vec3::new(-50.0, 0.6, -50.0), Vec3::new(50.0, 1.0, 50.0), material);
    scene
}

#[test]
fn shadow_rays_through_a_slab_are_dimmed_by_fresnel_and_absorption() {
    let position = Vec3::new(0.7, 1.9, -0.4);
    let (square, cos) = (f64::from(position.length_squared()), f64::from(position.normalize().y));
    let dimmed = |cos: f64| left(cos).powi(2) * (-0.8 * 0.4 / cos).exp();
    let mut scene = slab(1.5, 0.8);
    scene.lights.push(punctual(PunctualKind::Point, 3.0, position, Vec3::NEG_Y));
    agrees(scene, 0.5 * FRAC_1_PI * 3.0 * cos / square * dimmed(cos), Integrator::Direct);

    let ([x0, x1], [z0, z1], y) = LIGHT;
    let mut scene = slab(1.5, 0.8);
    rectangle(&mut scene, y as f32, [x0 as f32, x1 as f32], [z0 as f32, z1 as f32], false, area_light(10.0));
    agrees(scene, 0.5 * FRAC_1_PI * 10.0 * irradiance(dimmed), Integrator::Direct);

    let mut scene = slab(1.5, 0.8);
    scene.environment = Some(Environment::constant([2.0; 3]));
    let n = 100_000;
    let cos = |i: i32| (f64::from(i) + 0.5) / f64::from(n);
    let mean = (0..n).map(|i| 2.0 * cos(i) * dimmed(cos(i))).sum::<f64>() / f64::from(n);
    agrees(scene, 0.5 * 2.0 * mean, Integrator::Direct);
}

#[test]
fn no_light_through_index_one_counts_twice() {
    // Straight is what index 1 does, so all paths together must find the exact light. The floor is seen through the box, too.
    let corners = [(-0.2, -0.7), (1.0, -0.7), (1.0, 0.4), (-0.2, 0.4)].map(|(x, z)| DVec3::new(x, 1.5, z));
    let visible = polygon_irradiance(DVec3::ZERO, &corners);
    let point = Vec3::new(0.1, 1.4, 0.9);
    let lamp = 3.0 * f64::from(point.normalize().y / point.length_squared());
    let expected = 0.5 * FRAC_1_PI * (10.0 * visible + 2.0 * (PI - visible) + lamp);
    for eye in [Vec3::new(0.0, 1.0, 3.0), Vec3::new(0.0, 0.008, 0.02)] {
        let mut scene = Scene { environment: Some(Environment::constant([2.0; 3])), ..Default::default() };
        rectangle(&mut scene, 0.0, [-5.0, 5.0], [-5.0, 5.0], true, lambert(0.5));
        rectangle(&mut scene, 1.5, [-0.2, 1.0], [-0.7, 0.4], false, area_light(10.0));
        scene.lights.push(punctual(PunctualKind::Point, 3.0, point, Vec3::NEG_Y));
        closed_box(&mut scene, Vec3::new(-0.5, 0.01, -0.5), Vec3::new(0.5, 0.6, 0.5), glass(1.0, 0.0));
        look(&mut scene, eye, Vec3::ZERO, 1e-3);
        agrees(scene, expected, Integrator::Path);
    }
}

#[test]
fn scenes_without_smooth_bodies_keep_their_bits() {
    let stage = Stage::new(crate::helpers::stage::glass_hall(), Backend::Embree);
    let green = |glass_shadows| stage.green(&RenderSettings { width: 16, height: 12, glass_shadows, ..settings() });
    assert_eq!(green(GlassShadows::Off), green(GlassShadows::Straight));
}
