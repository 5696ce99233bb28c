//! `--glass-shadows manifold`: light through bodies of smooth glass by refraction, against closed forms and paths.

use std::f64::consts::FRAC_1_PI;
use std::sync::Arc;

use bismar::integrator::manifold::share_behind_glass;
use bismar::rays::Backend;
use bismar::render::{Balance, GlassShadows, Guiding, Integrator, RenderSettings, transport};
use bismar::scene::{Material, Mesh, PunctualKind, Scene, build};
use glam::{DVec3, Vec3};

use crate::closed_forms::{BALANCES, settings};
use crate::glass::fresnel;
use crate::helpers::stage::{Stage, area_light, closed_box, glass, glass_hall, lambert, look, rectangle};
use crate::helpers::statistics::z_limit;
use crate::thin_walls::{LIGHT, floor_under, pane, punctual};

fn manifold() -> RenderSettings {
    RenderSettings { glass_shadows: GlassShadows::Manifold, ..settings() }
}

/// Direct light by every balance and backend; all must agree with `expected`.
fn agrees(scene: Scene, expected: f64) {
    let scene = Arc::new(scene);
    for backend in [Backend::Embree, Backend::Obvhs] {
        let stage = Stage::new(scene.clone(), backend);
        for balance in BALANCES {
            let settings = RenderSettings { balance, integrator: Integrator::Direct, ..manifold() };
            let mean = stage.mean_green(&settings, 60);
            // Rays begin 16 roundings of the floor's size above it, 2e-4 m, which walks keep.
            let error = mean.standard_error().max(2e-4 * expected);
            let z = (mean.mean - expected) / error;
            assert!(
                z.abs() < z_limit(2 * BALANCES.len()),
                "{backend:?} {balance:?}: {} ± {} for {expected}, z = {z}",
                mean.mean,
                mean.standard_error()
            );
        }
    }
}

/// A slab of glass over the floor of [`floor_under`], above its camera: thickness, index, absorption.
const SLAB: (f64, f64, f64) = (0.4, 1.5, 0.8);

fn slab() -> Scene {
    let mut scene = floor_under(0, &pane());
    let (thickness, ior, absorption) = SLAB;
    let material = Material { absorption: Vec3::splat(absorption as f32), ..glass(ior as f32, 0.0) };
    let high = Vec3::new(50.0, 0.6 + thickness as f32, 50.0);
    closed_box(&mut scene, Vec3::new(-50.0, 0.6, -50.0), high, material);
    scene
}

/// What the slab leaves of light at an angle in air.
fn left(theta: f64) -> f64 {
    let (thickness, ior, absorption) = SLAB;
    let inside = (1.0 - (theta.sin() / ior).powi(2)).sqrt();
    (1.0 - fresnel(ior, theta)).powi(2) * (-absorption * thickness / inside).exp()
}

/// The angle in air at which the origin sees a point at height `y` and distance `r` from its axis through the slab, and the
/// irradiance from a source of intensity 1 there: energy of dω = 2π sin θ dθ falls on a ring 2π r dr.
fn refracted(y: f64, r: f64) -> (f64, f64) {
    let (thickness, ior, _) = SLAB;
    let reach = |theta: f64| (y - thickness) * theta.tan() + thickness * (theta.sin() / ior).asin().tan();
    let (mut low, mut high) = (0.0f64, 1.57f64);
    for _ in 0..80 {
        let middle = 0.5 * (low + high);
        if reach(middle) < r { low = middle } else { high = middle }
    }
    let step = 1e-5;
    let derivative = (reach(low + step) - reach(low - step)) / (2.0 * step);
    (low, left(low) * low.sin() / (r * derivative))
}

#[test]
fn a_point_light_is_seen_through_a_slab_as_snell_and_fresnel_say() {
    let position = Vec3::new(0.7, 1.9, -0.4);
    let r = f64::from(position.x.hypot(position.z));
    let mut scene = slab();
    scene.lights.push(punctual(PunctualKind::Point, 3.0, position, Vec3::NEG_Y));
    agrees(scene, 0.5 * FRAC_1_PI * 3.0 * refracted(1.9, r).1);
    // Straight shadows are off by more than the test allows.
    let straight = f64::from(position.y / position.length().powi(3)) * left((r / 1.9).atan());
    assert!((straight / refracted(1.9, r).1 - 1.0).abs() > 0.05);
}

#[test]
fn a_sun_through_a_slab_is_what_it_leaves() {
    let mut scene = slab();
    let from = Vec3::new(0.5, 1.0, -0.3).normalize();
    scene.lights.push(punctual(PunctualKind::Directional, 3.0, Vec3::ZERO, -from));
    agrees(scene, 0.5 * FRAC_1_PI * 3.0 * f64::from(from.y) * left(f64::from(from.y).acos()));
}

#[test]
fn an_area_light_through_a_slab_is_the_sum_of_its_points() {
    const N: usize = 300;
    let ([x0, x1], [z0, z1], y) = LIGHT;
    let at = |low: f64, high: f64, k: usize| low + (k as f64 + 0.5) * (high - low) / N as f64;
    let point = |i: usize| {
        let p = DVec3::new(at(x0, x1, i % N), 0.0, at(z0, z1, i / N));
        let (theta, irradiance) = refracted(y, p.length());
        theta.cos() * irradiance
    };
    let irradiance = (0..N * N).map(point).sum::<f64>() * (x1 - x0) * (z1 - z0) / (N * N) as f64;
    let mut scene = slab();
    rectangle(&mut scene, y as f32, [x0 as f32, x1 as f32], [z0 as f32, z1 as f32], false, area_light(10.0));
    agrees(scene, 0.5 * FRAC_1_PI * 10.0 * irradiance);
}

/// A sphere with the normals of a sphere; the inner side of a wall points inward.
fn add_round(scene: &mut Scene, radius: f32, center: Vec3, inward: bool, material: Material) {
    let shape = build::sphere(radius.into(), 24).translated(center.as_dvec3());
    let positions: Vec<_> = shape.positions.iter().map(|p| p.as_vec3()).collect();
    let sign = if inward { -1.0 } else { 1.0 };
    let normals = positions.iter().map(|p| ((*p - center) * (sign / radius)).to_array()).collect();
    let triangles = shape.triangles.iter().map(|&[a, b, c]| if inward { [a, c, b] } else { [a, b, c] }).collect();
    let mut mesh = Mesh::new(positions.iter().map(|p| p.to_array()).collect(), triangles);
    mesh.normals = Some(normals);
    scene.add(mesh, material);
}

/// The lamp of [`globe`] relative to its centre, and its radius.
const OFF_CENTER: Vec3 = Vec3::new(0.05, 0.0, 0.05);
const LAMP_RADIUS: f32 = 0.15;

/// A lamp in a globe with a thick wall over a floor: an emitting ball, or a point light.
fn globe(lamp: Option<PunctualKind>) -> Scene {
    let mut scene = Scene::default();
    rectangle(&mut scene, 0.0, [-3.0, 3.0], [-3.0, 3.0], true, lambert(0.5));
    let center = Vec3::new(0.1, 0.8, -0.2);
    let material = Material { absorption: Vec3::splat(0.5), ..glass(1.5, 0.0) };
    add_round(&mut scene, 0.5, center, false, material.clone());
    add_round(&mut scene, 0.35, center, true, material);
    match lamp {
        Some(kind) => scene.lights.push(punctual(kind, 2.0, center + OFF_CENTER, Vec3::NEG_Y)),
        None => add_round(&mut scene, LAMP_RADIUS, center + OFF_CENTER, false, area_light(5.0)),
    }
    look(&mut scene, Vec3::new(0.0, 2.0, 3.0), Vec3::new(0.8, 0.0, 0.4), 0.2);
    scene
}

/// [`globe`] with a ball and a point light. The bodies have smooth normals: of the images in the facets of flat-shaded ones,
/// rounding decides which one a walk finds.
pub fn lamp_in_globe() -> Arc<Scene> {
    let mut scene = globe(None);
    scene.lights = globe(Some(PunctualKind::Point)).lights;
    scene.lights[0].position.y += 2.0 * LAMP_RADIUS / 1.7;
    Arc::new(scene)
}

#[test]
fn walks_and_paths_share_the_light_of_a_lamp_in_a_globe() {
    let stage = Stage::new(Arc::new(globe(None)), Backend::Embree);
    let size = RenderSettings { width: 6, height: 4, max_depth: 5, ..settings() };
    let off = stage.mean_green(&RenderSettings { spp: Some(128), seed: 70_000, ..size.clone() }, 300);
    let cases =
        BALANCES.map(|balance| (balance, Guiding::Off)).into_iter().chain([(Balance::Progressive, Guiding::On)]);
    for (balance, guiding) in cases {
        let glass_shadows = GlassShadows::Manifold;
        let mean = stage.mean_green(&RenderSettings { balance, guiding, glass_shadows, ..size.clone() }, 60);
        // The lobes of smooth boundaries are neglected: 0.5 % at each of two.
        let error = mean.standard_error().hypot(off.standard_error()).max(0.002 * off.mean);
        let z = (mean.mean - off.mean) / error;
        assert!(z.abs() < z_limit(BALANCES.len() + 1), "{balance:?}: {} for {}, z = {z}", mean.mean, off.mean);
    }
}

#[test]
fn a_point_light_in_a_globe_is_a_small_lamp_in_it() {
    // Light leaves the globe by refraction; what is reflected within is 8 % at most.
    let mean = |kind, glass_shadows| {
        let stage = Stage::new(Arc::new(globe(kind)), Backend::Embree);
        stage.mean_green(&RenderSettings { width: 6, height: 4, glass_shadows, ..settings() }, 40)
    };
    let point = mean(Some(PunctualKind::Point), GlassShadows::Manifold);
    // A ball of radiance 5 has the intensity 5 π r².
    let ball = mean(None, GlassShadows::Manifold);
    let intensity = 5.0 * std::f64::consts::PI * f64::from(LAMP_RADIUS).powi(2);
    let ratio = (point.mean / 2.0) / (ball.mean / intensity);
    assert!((0.85..1.03).contains(&ratio), "{ratio}");
    assert!(point.standard_error() < 0.02 * point.mean, "{} ± {}", point.mean, point.standard_error());
}

#[test]
fn a_sun_behind_a_solid_pane_has_little_variance() {
    let mut scene = slab();
    scene.lights.push(punctual(PunctualKind::Directional, 3.0, Vec3::ZERO, Vec3::new(-0.5, -1.0, 0.3).normalize()));
    let stage = Stage::new(Arc::new(scene), Backend::Embree);
    // Without walks, 60 pictures may find no light at all.
    let variance = |glass_shadows| {
        let mean = stage.mean_green(&RenderSettings { glass_shadows, ..settings() }, 60);
        if mean.mean > 0.0 { (mean.standard_error() / mean.mean).powi(2) } else { f64::INFINITY }
    };
    let (walks, paths) = (variance(GlassShadows::Manifold), variance(GlassShadows::Off));
    assert!(walks < 1e-3 * paths, "{walks} with, {paths} without");
}

#[test]
fn a_pilot_sees_where_lamps_stand_behind_glass() {
    let share = |scene: Arc<Scene>| {
        let stage = Stage::new(scene, Backend::Embree);
        let size = [12, 8];
        let settings = RenderSettings { width: size[0], height: size[1], ..settings() };
        share_behind_glass(&transport(&stage.scene, &settings), size)
    };
    // Of the ball, half of the points face away.
    for (lamp, least) in [(None, 0.3), (Some(PunctualKind::Point), 0.8)] {
        let share = share(Arc::new(globe(lamp)));
        assert!(share > least, "{share}");
    }
    // No smooth body; none before the light.
    assert_eq!(share(glass_hall()), 0.0);
    let mut scene = globe(Some(PunctualKind::Point));
    scene.lights[0].position = Vec3::new(0.0, 3.0, 3.0);
    assert!(share(Arc::new(scene)) < 0.1);
}

#[test]
fn scenes_without_smooth_bodies_keep_their_bits() {
    let stage = Stage::new(glass_hall(), Backend::Embree);
    let green = |glass_shadows| stage.green(&RenderSettings { width: 16, height: 12, glass_shadows, ..settings() });
    assert_eq!(green(GlassShadows::Off), green(GlassShadows::Manifold));
}
