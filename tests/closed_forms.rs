//! Rendered radiance against closed forms: every balance, both backends. Replicas differ by seed; the z-tests' limit
//! keeps the false-alarm rate of the whole file's family at `statistics::FALSE_ALARM` a test.

use std::f64::consts::PI;
use std::sync::Arc;

use bismar::lanes::V3;
use bismar::light::{Density, EnvironmentSampler};
use bismar::rays::Backend;
use bismar::render::{Balance, Integrator, PixelFilter, RenderSettings};
use bismar::scene::{Environment, Material, PunctualKind, Scene};
use glam::{DVec3, Vec3};

use crate::helpers::stage::{
    Stage, add, add_sphere, area_light, closed_box, lambert, look, metal, punctual, rectangle, sphere,
};
use crate::helpers::statistics::z_limit;

pub const BALANCES: [Balance; 5] =
    [Balance::Progressive, Balance::SecondOrder, Balance::Half, Balance::Power, Balance::Max];
pub const REPLICAS: u32 = 300;

pub fn settings() -> RenderSettings {
    RenderSettings {
        width: 2,
        height: 2,
        spp: Some(32),
        seed: 1000,
        filter: PixelFilter::Box,
        ..RenderSettings::even()
    }
}

/// Renders with every balance, backend and these integrators; all must agree with `expected`.
pub fn agrees(scene: Scene, expected: f64, integrators: &[Integrator]) {
    agrees_with(&settings(), REPLICAS, scene, expected, integrators);
}

/// The same with other settings and so many replicas.
pub fn agrees_with(settings: &RenderSettings, replicas: u32, scene: Scene, expected: f64, integrators: &[Integrator]) {
    let scene = Arc::new(scene);
    let limit = z_limit(2 * BALANCES.len() * integrators.len());
    for backend in [Backend::Embree, Backend::Obvhs] {
        let stage = Stage::new(scene.clone(), backend);
        for &integrator in integrators {
            for balance in BALANCES {
                let mean = stage.mean_green(&RenderSettings { balance, integrator, ..settings.clone() }, replicas);
                let z = mean.z(expected);
                assert!(
                    z.abs() < limit,
                    "{backend:?} {integrator:?} {balance:?}: {} ± {} for {expected}, z = {z}",
                    mean.mean,
                    mean.standard_error()
                );
            }
        }
    }
}

pub const BOTH: [Integrator; 2] = [Integrator::Direct, Integrator::Path];

#[test]
fn white_diffuse_sphere_vanishes_in_a_white_furnace() {
    let mut scene = Scene { environment: Some(Environment::constant([1.0; 3])), ..Default::default() };
    add_sphere(&mut scene, 12, 1.0, Vec3::ZERO, lambert(1.0));
    look(&mut scene, Vec3::new(0.0, 0.5, 3.0), Vec3::ZERO, 0.3);
    agrees(scene, 1.0, &BOTH);
}

#[test]
fn white_metal_plate_vanishes_in_a_white_furnace() {
    // Rough at alpha = 0.01, where the single-scattering loss at this angle is of the order alpha², 1e-4: half of a
    // thousandth is allowed for it by placing the expectation at the lobe's own albedo, found by quadrature elsewhere.
    let mut scene = Scene { environment: Some(Environment::constant([1.0; 3])), ..Default::default() };
    rectangle(&mut scene, 0.0, [-5.0, 5.0], [-5.0, 5.0], true, metal(0.1));
    look(&mut scene, Vec3::new(0.0, 3.0, 1.0), Vec3::ZERO, 1e-3);
    let expected = plate_albedo(0.01, (1.0f64 / 10.0f64.sqrt()).atan());
    assert!((1.0 - expected).abs() < 1e-3, "{expected}");
    agrees(scene, expected, &BOTH);
}

/// Albedo of a white GGX metal with separable Smith masking, by quadrature over visible microfacet normals: the
/// mean of G₁(wi) over them (the VNDF weight), with tan θ_m = α √(u/(1 − u)) for D's own distribution re-weighted.
fn plate_albedo(alpha: f64, theta: f64) -> f64 {
    let wo = DVec3::new(theta.sin(), 0.0, theta.cos());
    let g1 = |w: DVec3| {
        let tan2 = (w.x * w.x + w.y * w.y) / (w.z * w.z);
        2.0 / (1.0 + (1.0 + alpha * alpha * tan2).sqrt())
    };
    let (mut sum, n) = (0.0, 1000);
    for i in 0..n {
        let u = (f64::from(i) + 0.5) / f64::from(n);
        let tan = alpha * (u / (1.0 - u)).sqrt();
        let cos = 1.0 / (1.0 + tan * tan).sqrt();
        let sin = tan * cos;
        for j in 0..n {
            let phi = 2.0 * PI * (f64::from(j) + 0.5) / f64::from(n);
            let m = DVec3::new(sin * phi.cos(), sin * phi.sin(), cos);
            let wi = 2.0 * wo.dot(m) * m - wo;
            if wi.z > 0.0 && wo.dot(m) > 0.0 {
                // D(m) cos θ_m is the density of m; the VNDF has G₁(wo)(wo·m)D/cos θ_o.
                sum += g1(wo) * wo.dot(m) / (wo.z * cos) * g1(wi);
            }
        }
    }
    sum / f64::from(n * n)
}

#[test]
fn constant_sky_over_a_diffuse_plane_gives_its_albedo() {
    let mut scene = Scene { environment: Some(Environment::constant([2.0; 3])), ..Default::default() };
    rectangle(&mut scene, 0.0, [-5.0, 5.0], [-5.0, 5.0], true, lambert(0.6));
    look(&mut scene, Vec3::new(0.0, 2.0, 2.0), Vec3::ZERO, 0.2);
    agrees(scene, 1.2, &BOTH);
}

#[test]
fn uneven_sky_over_a_diffuse_plane_gives_what_its_quadrature_says() {
    // A low sun, a bright half and a dim one: some is above the mean, and much below, on this side of the horizon.
    let (width, height) = (8u32, 4u32);
    let texel = |i: u32| match (i / width, i % width) {
        (1, 6) => [30.0; 3],
        (_, x) if x < 3 => [0.3; 3],
        _ => [1.5; 3],
    };
    let pixels = (0..width * height).map(texel).collect();
    let environment = Environment { name: "test".into(), width, height, pixels, rotation: 0.3, strength: 1.0 };
    let sampler = EnvironmentSampler::new(&environment).unwrap();
    let n = 1024;
    let mut irradiance = 0.0;
    for i in 0..n * n {
        // Uniform in cos² θ and φ: a mean of radiance by cosine.
        let [u, phi] = [i / n, i % n].map(|i| (f64::from(i) + 0.5) / f64::from(n));
        let (r, phi) = (u.sqrt(), 2.0 * PI * phi);
        let d = Vec3::new((r * phi.cos()) as f32, (1.0 - u).sqrt() as f32, (r * phi.sin()) as f32);
        let (radiance, _) = sampler.radiance_pdf(V3::splat(d), Density::Radiance);
        irradiance += PI * f64::from(radiance.lane(0).y) / f64::from(n * n);
    }
    let mut scene = Scene { environment: Some(environment), ..Default::default() };
    rectangle(&mut scene, 0.0, [-5.0, 5.0], [-5.0, 5.0], true, lambert(0.6));
    look(&mut scene, Vec3::new(0.0, 2.0, 2.0), Vec3::ZERO, 0.2);
    agrees(scene, 0.6 / PI * irradiance, &BOTH);
}

/// Irradiance at `p` with normal +y from a polygon of unit radiance, by Lambert's formula; all above the horizon.
pub fn polygon_irradiance(p: DVec3, corners: &[DVec3]) -> f64 {
    let n = corners.len();
    let mut sum = 0.0;
    for i in 0..n {
        let (a, b) = ((corners[i] - p).normalize(), (corners[(i + 1) % n] - p).normalize());
        let cross = a.cross(b);
        sum += a.dot(b).clamp(-1.0, 1.0).acos() * cross.normalize_or_zero().y;
    }
    0.5 * sum.abs()
}

/// A floor of albedo 0.5, of which `eye` sees the origin, under an area light of radiance 10; and the irradiance there
/// from one of radiance 1.
pub fn floor_under_lamp(eye: Vec3) -> (Scene, f64) {
    let mut scene = Scene::default();
    rectangle(&mut scene, 0.0, [-5.0, 5.0], [-5.0, 5.0], true, lambert(0.5));
    rectangle(&mut scene, 1.5, [-0.2, 1.0], [-0.7, 0.4], false, area_light(10.0));
    look(&mut scene, eye, Vec3::ZERO, 1e-3);
    let corners = [(-0.2, -0.7), (1.0, -0.7), (1.0, 0.4), (-0.2, 0.4)].map(|(x, z)| DVec3::new(x, 1.5, z));
    (scene, polygon_irradiance(DVec3::ZERO, &corners))
}

#[test]
fn rectangular_light_over_a_diffuse_plane() {
    let (scene, irradiance) = floor_under_lamp(Vec3::new(0.0, 1.0, 3.0));
    agrees(scene, 0.5 / PI * 10.0 * irradiance, &BOTH);
}

#[test]
fn a_sky_and_a_lamp_before_it_are_two_techniques_of_light_sampling() {
    let (mut scene, lamp) = floor_under_lamp(Vec3::new(0.0, 1.0, 3.0));
    scene.environment = Some(Environment::constant([2.0; 3]));
    let expected = 0.5 / PI * (10.0 * lamp + 2.0 * (PI - lamp));
    // A pilot, its pass, and a pass and a path after it.
    let long = RenderSettings { balance: Balance::Progressive, spp: Some(161), ..settings() };
    let mean = Stage::new(Arc::new(scene.clone()), Backend::Embree).mean_green(&long, REPLICAS);
    assert!(mean.z(expected).abs() < z_limit(1), "{} for {expected}, z = {}", mean.mean, mean.z(expected));
    agrees(scene, expected, &BOTH);
}

#[test]
fn spherical_light_over_a_diffuse_plane() {
    let (center, radius) = (Vec3::new(0.5, 2.0, -0.3), 0.4);
    let (points, indices) = sphere(24, radius, center);
    // The exact irradiance of the polyhedron: the sum over its triangles that face the point.
    let mut irradiance = 0.0;
    for t in &indices {
        let [a, b, c] = t.map(|i| Vec3::from_array(points[i as usize]).as_dvec3());
        if (b - a).cross(c - a).dot(-a) > 0.0 {
            irradiance += polygon_irradiance(DVec3::ZERO, &[a, b, c]);
        }
    }
    // It is the sphere's, π (r/d)² cos θ, but for the tessellation: 48 columns lose at most (π/48)² of the area.
    let d = center.as_dvec3().length();
    let of_sphere = PI * (f64::from(radius) / d).powi(2) * f64::from(center.y) / d;
    assert!((irradiance / of_sphere - 1.0).abs() < (PI / 48.0).powi(2) * 2.0, "{irradiance} {of_sphere}");

    let mut scene = Scene::default();
    rectangle(&mut scene, 0.0, [-5.0, 5.0], [-5.0, 5.0], true, lambert(0.5));
    add(&mut scene, points, indices, area_light(10.0));
    look(&mut scene, Vec3::new(0.0, 1.0, 3.0), Vec3::ZERO, 1e-3);
    agrees(scene, 0.5 / PI * 10.0 * irradiance, &BOTH);
}

fn under(kind: PunctualKind) -> Scene {
    let mut scene = Scene::default();
    rectangle(&mut scene, 0.0, [-5.0, 5.0], [-5.0, 5.0], true, lambert(0.5));
    let position = Vec3::new(1.0, 2.0, 0.0);
    // The spot's axis misses the origin by an angle whose cosine is 0.9.
    let toward = -position.normalize();
    let aside = Vec3::Z;
    let direction = toward * 0.9 + aside * (1.0f32 - 0.81).sqrt();
    scene.lights.push(punctual(kind, 30.0, position, direction));
    look(&mut scene, Vec3::new(0.0, 1.0, 3.0), Vec3::ZERO, 1e-4);
    scene
}

/// ρ/π · I cos θ/d² of the scene above.
fn point_radiance() -> f64 {
    0.5 / PI * 30.0 * (2.0 / 5.0f64.sqrt()) / 5.0
}

#[test]
fn point_light_over_a_diffuse_plane() {
    agrees(under(PunctualKind::Point), point_radiance(), &BOTH);
}

#[test]
fn a_lights_range_fades_it_and_ends_it() {
    // The light is √5 m away: 1 − (√5/3)⁴ of its light is left.
    for (range, left) in [(3.0, 1.0 - 25.0 / 81.0), (2.2, 0.0)] {
        let mut scene = under(PunctualKind::Point);
        scene.lights[0].range = range;
        agrees(scene, left * point_radiance(), &BOTH);
    }
}

#[test]
fn spot_light_fades_from_its_inner_to_its_outer_cone() {
    let cone = |inner: f32, outer: f32| PunctualKind::Spot { inner: inner.acos(), outer: outer.acos() };
    // Inside, halfway down the ramp in the cosine (a quarter, squared), outside.
    agrees(under(cone(0.85, 0.5)), point_radiance(), &[Integrator::Direct]);
    agrees(under(cone(0.95, 0.85)), 0.25 * point_radiance(), &[Integrator::Direct]);
    agrees(under(cone(0.99, 0.95)), 0.0, &[Integrator::Direct]);
}

#[test]
fn directional_light_over_a_diffuse_plane() {
    let mut scene = under(PunctualKind::Directional);
    scene.lights[0].direction = Vec3::new(0.6, -0.8, 0.0);
    agrees(scene, 0.5 / PI * 30.0 * 0.8, &BOTH);
}

#[test]
fn interreflection_between_two_plates_is_the_geometric_series() {
    // A point between two facing white-ish plates so large that what escapes is below the noise: each bounce keeps
    // ρ, light enters as emission of one plate. L = Le Σ ρ^k over the segments that the depth allows.
    let mut scene = Scene::default();
    // The inside of a cube of glowing walls: exactly closed.
    let glowing = Material { emissive: Vec3::ONE, double_sided: true, ..lambert(0.5) };
    closed_box(&mut scene, Vec3::NEG_ONE, Vec3::ONE, glowing);
    look(&mut scene, Vec3::new(0.1, 0.2, 0.3), Vec3::new(1.0, 0.3, -0.2), 0.5);
    let series = |segments: i32| (0..segments).map(|k| 0.5f64.powi(k)).sum::<f64>();
    // Direct: emission and one bounce. Path: eight segments, by default.
    agrees(scene.clone(), series(2), &[Integrator::Direct]);
    agrees(scene, series(8), &[Integrator::Path]);
}

#[test]
fn all_balances_and_backends_agree_on_a_glossy_scene_with_sky_lamp_and_indirect_light() {
    let mut scene = Scene::default();
    let mut pixels = vec![[0.4; 3]; 128];
    pixels[20] = [60.0, 55.0, 50.0];
    let pixels = pixels.into();
    scene.environment = Some(Environment { width: 16, height: 8, pixels, ..Environment::constant([0.4; 3]) });
    rectangle(&mut scene, 0.0, [-3.0, 3.0], [-3.0, 3.0], true, metal(0.5));
    rectangle(&mut scene, 1.5, [-0.4, 0.4], [-0.9, -0.3], false, area_light(6.0));
    add_sphere(&mut scene, 8, 0.4, Vec3::new(0.2, 0.4, 0.2), lambert(0.7));
    look(&mut scene, Vec3::new(0.0, 1.2, 3.0), Vec3::new(0.0, 0.2, 0.0), 0.5);
    let scene = Arc::new(scene);
    let reference = Stage::new(scene.clone(), Backend::Embree)
        .mean_green(&RenderSettings { balance: Balance::Half, seed: 900_000, spp: Some(128), ..settings() }, 1000);
    let short_pilot = (Balance::SecondOrder, Some(0.25));
    let balances: Vec<_> = BALANCES.iter().map(|&b| (b, None)).chain([short_pilot]).collect();
    let limit = z_limit(2 * balances.len());
    for backend in [Backend::Embree, Backend::Obvhs] {
        let stage = Stage::new(scene.clone(), backend);
        for &(balance, pilot) in &balances {
            let mean = stage.mean_green(&RenderSettings { balance, pilot, ..settings() }, 1000);
            let z = mean.z_to(&reference);
            assert!(
                z.abs() < limit,
                "{backend:?} {balance:?} {pilot:?}: {} for {}, z = {z}",
                mean.mean,
                reference.mean
            );
        }
    }
}
