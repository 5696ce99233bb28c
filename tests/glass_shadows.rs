//! `--glass-shadows straight`: light through bodies of smooth glass, none of it twice.

use std::f64::consts::{FRAC_1_PI, PI};

use bismar::rays::Backend;
use bismar::render::{GlassShadows, Integrator, RenderSettings};
use bismar::scene::{Environment, Material, PunctualKind, Scene};
use glam::Vec3;

use crate::closed_forms::{agrees_with, floor_under_lamp, settings};
use crate::helpers::stage::{Stage, area_light, closed_box, glass, glass_hall, punctual, rectangle};
use crate::thin_walls::{LIGHT, floor_under, irradiance, left, pane};

/// Renders with every balance and backend, with straight shadows; all must agree with `expected`.
fn agrees(scene: Scene, expected: f64, integrator: Integrator) {
    let straight = RenderSettings { glass_shadows: GlassShadows::Straight, max_depth: 12, ..settings() };
    agrees_with(&straight, 150, scene, expected, &[integrator]);
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
    let point = Vec3::new(0.1, 1.4, 0.9);
    let lamp = 3.0 * f64::from(point.normalize().y / point.length_squared());
    for eye in [Vec3::new(0.0, 1.0, 3.0), Vec3::new(0.0, 0.008, 0.02)] {
        let (mut scene, visible) = floor_under_lamp(eye);
        scene.environment = Some(Environment::constant([2.0; 3]));
        scene.lights.push(punctual(PunctualKind::Point, 3.0, point, Vec3::NEG_Y));
        closed_box(&mut scene, Vec3::new(-0.5, 0.01, -0.5), Vec3::new(0.5, 0.6, 0.5), glass(1.0, 0.0));
        agrees(scene, 0.5 * FRAC_1_PI * (10.0 * visible + 2.0 * (PI - visible) + lamp), Integrator::Path);
    }
}

#[test]
fn scenes_without_smooth_bodies_keep_their_bits() {
    let stage = Stage::new(glass_hall(), Backend::Embree);
    let green = |glass_shadows| stage.green(&RenderSettings { width: 16, height: 12, glass_shadows, ..settings() });
    assert_eq!(green(GlassShadows::Off), green(GlassShadows::Straight));
}
