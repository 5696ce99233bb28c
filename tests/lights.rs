//! The lights' promises: samples follow the pdf, radiance along a sample is the light's own.

use bismar::lanes::{F, V3};
use bismar::light::{
    AreaLights, Density, EnvironmentSampler, LearnedLights, LightProposal, LightSampleContext, LightSampleRecord,
    LightSamples,
};
use bismar::scene::{Environment, Material, Primitive, Scene};
use glam::{Affine3A, Vec3};

use crate::helpers::random::Random;
use crate::helpers::stage::add;
use crate::helpers::statistics::{Mean, chi_square_directions, direction, z_limit};

struct Sample {
    wi: Vec3,
    radiance: Vec3,
    pdf: f32,
}

/// The third lane, `None` where the sample failed.
fn third(s: LightSamples) -> Option<Sample> {
    let pdf = s.pdf.as_array()[3];
    (pdf > 0.0).then(|| Sample { wi: s.wi.lane(3), radiance: s.radiance.lane(3), pdf })
}

const DENSITIES: [Density; 2] = [Density::Radiance, Density::Compensated];

fn sample_environment(sampler: &EnvironmentSampler, u: f32, v: f32, density: Density) -> Option<Sample> {
    let proposal = LightProposal { density, ..Default::default() };
    third(sampler.sample(&proposal, [F::ZERO, F::splat(u), F::splat(v)]))
}

fn radiance_pdf(sampler: &EnvironmentSampler, wi: Vec3, density: Density) -> (Vec3, f32) {
    let (radiance, pdf) = sampler.radiance_pdf(V3::splat(wi), density);
    (radiance.lane(3), pdf.as_array()[3])
}

/// At the origin, with normal `n`.
fn sample_lamps(
    lights: &AreaLights,
    scene: &Scene,
    n: Vec3,
    learned: Option<&LearnedLights>,
    numbers: [f32; 3],
) -> Option<Sample> {
    let proposal = LightProposal { learned, ..Default::default() };
    let (p, n) = (V3::splat(Vec3::ZERO), V3::splat(n));
    let context = LightSampleContext { scene, time: F::ZERO, p, origin_error: F::ZERO, n };
    third(lights.sample(&context, &proposal, numbers.map(F::splat)))
}

/// A small map with a sun, a black band and uneven colours.
fn map(rotation: f32) -> Environment {
    let (width, height) = (8, 5);
    let mut random = Random(9);
    let mut pixels: Vec<[f32; 3]> = (0..width * height).map(|_| [random.f32(), random.f32(), random.f32()]).collect();
    pixels[10] = [40.0, 30.0, 20.0];
    pixels[24..32].fill([0.0; 3]);
    Environment { name: "test".into(), width, height, pixels: pixels.into(), rotation, strength: 2.0 }
}

#[test]
fn environment_samples_follow_the_pdf() {
    for (k, rotation) in [0.0, 1.3, -2.5].into_iter().enumerate() {
        let sampler = EnvironmentSampler::new(&map(rotation)).unwrap();
        for density in DENSITIES {
            let mut random = Random(20 + k as u64);
            chi_square_directions(
                &format!("environment turned by {rotation}, {density:?}"),
                6,
                (400_000, 12),
                || sample_environment(&sampler, random.f32(), random.f32(), density).map(|s| s.wi),
                |wi| f64::from(radiance_pdf(&sampler, wi, density).1),
            );
        }
    }
}

#[test]
fn environment_samples_carry_their_directions_radiance_and_pdf() {
    let sampler = EnvironmentSampler::new(&map(0.7)).unwrap();
    let mut random = Random(3);
    for (_, density) in (0..10_000).flat_map(|i| DENSITIES.map(|density| (i, density))) {
        let s = sample_environment(&sampler, random.f32(), random.f32(), density).unwrap();
        let (radiance, pdf) = radiance_pdf(&sampler, s.wi, density);
        // Directions are rounded, and the map changes by up to 40 units over an eighth of a turn.
        assert!((radiance - s.radiance).abs().max_element() < 2e-3, "{}", s.wi);
        assert!((pdf / s.pdf - 1.0).abs() < 2e-2 || s.pdf < 1e-3, "{} {pdf} {}", s.wi, s.pdf);
    }
}

#[test]
fn environment_direction_reads_the_documented_texel() {
    // u = 0.5 + atan2(z, x)/2π, v = acos(y)/π from the top; texel centres at (i + 0.5)/size.
    let (width, height) = (8u32, 4u32);
    let mut e = Environment::constant([0.0; 3]);
    (e.width, e.height) = (width, height);
    e.pixels = (0..width * height).map(|i| [i as f32 + 1.0, 0.0, 0.0]).collect();
    let sampler = EnvironmentSampler::new(&e).unwrap();
    for y in 0..height {
        for x in 0..width {
            let phi = 2.0 * std::f32::consts::PI * ((x as f32 + 0.5) / width as f32 - 0.5);
            let theta = std::f32::consts::PI * (y as f32 + 0.5) / height as f32;
            let d = Vec3::new(theta.sin() * phi.cos(), theta.cos(), theta.sin() * phi.sin());
            let read = radiance_pdf(&sampler, d, Density::Radiance).0.x;
            assert!((read - (y * width + x + 1) as f32).abs() < 1e-3, "{x} {y}: {read}");
        }
    }
}

#[test]
fn rotation_turns_the_map_about_plus_y() {
    // A quarter turn about +y carries +z to +x.
    let mut still = map(0.0);
    std::sync::Arc::make_mut(&mut still.pixels)[10] = [90.0, 0.0, 0.0];
    let turned = Environment { rotation: std::f32::consts::FRAC_PI_2, ..still.clone() };
    let (still, turned) = (EnvironmentSampler::new(&still).unwrap(), EnvironmentSampler::new(&turned).unwrap());
    let mut random = Random(8);
    for _ in 0..1000 {
        let d = bismar::sampling::warp::sphere(random.f32(), random.f32());
        let carried = Vec3::new(d.z, d.y, -d.x);
        let of = |sky, d| radiance_pdf(sky, d, Density::Radiance).0;
        assert!((of(&still, d) - of(&turned, carried)).abs().max_element() < 1e-2);
    }
}

#[test]
fn constant_environment_has_the_uniform_pdf_on_average() {
    // sin θ is taken at the middle of a row of cells, so the pdf is not quite 1/4π; its mean over the sphere is.
    let sampler = EnvironmentSampler::new(&Environment::constant([1.0; 3])).unwrap();
    let mut mean = Mean::default();
    let mut random = Random(5);
    for _ in 0..200_000 {
        let d = bismar::sampling::warp::sphere(random.f32(), random.f32());
        mean.add(f64::from(radiance_pdf(&sampler, d, Density::Radiance).1) * 4.0 * std::f64::consts::PI);
    }
    assert!(mean.z(1.0).abs() < z_limit(1), "{}", mean.mean);
}

#[test]
fn where_compensated_no_sample_goes_to_what_is_below_the_mean() {
    let sampler = EnvironmentSampler::new(&map(0.4)).unwrap();
    let mut random = Random(12);
    let (mut left_out, mut drawn) = (0, 0);
    for _ in 0..10_000 {
        let d = bismar::sampling::warp::sphere(random.f32(), random.f32());
        let (radiance, pdf) = radiance_pdf(&sampler, d, Density::Compensated);
        let luminance = bismar::color::luminance(radiance);
        left_out += u32::from(pdf == 0.0);
        drawn += u32::from(pdf > 0.0);
        assert!(pdf > 0.0 || luminance <= sampler.mean_luminance(), "{d}: {luminance}");
        assert!(pdf == 0.0 || radiance_pdf(&sampler, d, Density::Radiance).1 > 0.0);
    }
    assert!(left_out > 5000 && drawn > 500, "{left_out} left out, {drawn} drawn");
    // Nothing is above the mean: as without.
    let sampler = EnvironmentSampler::new(&Environment::constant([1.0; 3])).unwrap();
    for _ in 0..100 {
        let d = bismar::sampling::warp::sphere(random.f32(), random.f32());
        let [plain, excess] = DENSITIES.map(|density| radiance_pdf(&sampler, d, density).1);
        assert!(plain == excess && plain > 0.0, "{d}: {plain} {excess}");
    }
}

/// Three area lights of unlike size and power around the origin, the middle one seen from behind unless two-sided, one placed
/// by a mirrored instance.
fn area_lights(double_sided: bool) -> Scene {
    let mut scene = Scene::default();
    for (radiance, points) in [
        (3.0, [[-1.0, 2.0, -1.0], [1.5, 2.0, -1.0], [0.0, 2.5, 1.5]]),
        (1.0, [[3.0, -1.0, 0.0], [3.0, 1.0, 0.5], [3.0, 0.0, 2.0]]),
        (8.0, [[0.0, 0.0, 2.0], [1.0, 0.0, 2.0], [0.0, 1.5, 2.5]]),
    ] {
        let material = Material { emissive: Vec3::splat(radiance), double_sided, ..Default::default() };
        add(&mut scene, points.to_vec(), vec![[0, 1, 2]], material);
    }
    scene.instances[2].transform = Some(Affine3A::from_scale(Vec3::new(-1.2, 1.0, 1.4)));
    scene
}

fn corners(scene: &Scene, Primitive { instance, mesh, prim }: Primitive) -> [Vec3; 3] {
    let mesh = &scene.meshes[mesh as usize];
    let place = |p| scene.instances[instance as usize].transform.map_or(p, |t| t.transform_point3(p));
    mesh.indices[prim as usize].map(|i| place(Vec3::from_array(mesh.positions[i as usize])))
}

/// The triangles in direction `d` from the origin, one behind the other, and their distances. Object `i` is mesh `i`.
fn hits(scene: &Scene, d: Vec3) -> Vec<(Primitive, f32)> {
    let of_mesh = |i: u32| (0..scene.meshes[i as usize].indices.len() as u32).map(move |prim| (i, prim));
    let all = (0..scene.meshes.len() as u32).flat_map(of_mesh);
    let hit = |(i, prim)| {
        let primitive = Primitive { instance: i, mesh: i, prim };
        let [a, b, c] = corners(scene, primitive);
        let n = (b - a).cross(c - a);
        let t = a.dot(n) / d.dot(n);
        let inside = [(a, b), (b, c), (c, a)].iter().all(|(p, q)| (*q - *p).cross(d * t - *p).dot(n) >= 0.0);
        (t > 0.0 && inside).then_some((primitive, t))
    };
    all.filter_map(hit).collect()
}

/// Do samples at the origin, of normal `n`, follow the pdf? They do not know what is in front of what.
fn follow_the_pdf(name: &str, scene: &Scene, n: Vec3, learned: Option<&LearnedLights>, seed: u64) {
    let lights = AreaLights::new(scene).unwrap();
    let mut random = Random(seed);
    let pdf = |d: Vec3| {
        let one = |(primitive, t)| f64::from(lights.pdf((scene, 0.0), (Vec3::ZERO, n), primitive, d, t, learned));
        hits(scene, d).into_iter().map(one).sum::<f64>()
    };
    let sample = || sample_lamps(&lights, scene, n, learned, [random.f32(), random.f32(), random.f32()]).map(|s| s.wi);
    chi_square_directions(name, 4, (100_000, 96), sample, pdf);
}

#[test]
fn lamp_samples_follow_the_pdf() {
    // Receivers that face all area lights, some, and one.
    let normals = [Vec3::new(1.0, 1.0, 1.0), Vec3::Y, Vec3::NEG_Z + 0.6 * Vec3::X].map(Vec3::normalize);
    for (double_sided, n, learns) in [
        (false, normals[0], false),
        (true, normals[0], false),
        (true, normals[1], false),
        (true, normals[2], false),
        (true, normals[0], true),
        (false, normals[1], true),
    ] {
        let scene = area_lights(double_sided);
        let lights = AreaLights::new(&scene).unwrap();
        // One finds much, another little, the third nothing.
        let (position, normal) = (Vec3::ZERO, n);
        let record = |i: u32| LightSampleRecord { position, normal, emitter: i, pixel: 0, contribution: i as f32 };
        let records: Vec<_> = (0..300).map(|i| record(i % 3)).collect();
        let learned = LearnedLights::learn(lights.tree(), &records, 1.0).filter(|_| learns);
        assert!((lights.levels() - 3.0f32.log2()).abs() < 1e-6);
        let name = format!("lamps, double_sided {double_sided}, normal {n}, learned {learns}");
        follow_the_pdf(&name, &scene, n, learned.as_ref(), 31);
    }
}

#[test]
fn two_triangles_of_a_parallelogram_are_one_lamp_that_follows_the_pdf() {
    let points = [[-1.0, 2.0, -1.0], [1.0, 2.0, -1.5], [1.5, 2.5, 0.5], [-0.5, 2.5, 1.0]];
    // All ways to cut it; and a quadrangle that is none, which stays two area lights.
    let cuts = [[[0, 1, 2], [0, 2, 3]], [[1, 2, 3], [3, 0, 1]], [[2, 0, 1], [3, 0, 2]], [[0, 1, 2], [2, 3, 0]]];
    for (k, indices) in cuts.into_iter().enumerate() {
        let bent = k == 3;
        let mut points = points;
        points[2][0] += if bent { 0.5 } else { 0.0 };
        let material = Material { emissive: Vec3::ONE, double_sided: true, ..Default::default() };
        let mut scene = Scene::default();
        add(&mut scene, points.to_vec(), indices.to_vec(), material);
        let lights = AreaLights::new(&scene).unwrap();
        let n = Vec3::new(0.2, 1.0, 0.1).normalize();
        follow_the_pdf(&format!("parallelogram cut {k}"), &scene, n, None, 61 + k as u64);
        // One area light: every direction has the same area density, whatever the choice's number.
        let spread = (0..64).map(|i| sample_lamps(&lights, &scene, n, None, [i as f32 / 64.0, 0.3, 0.6]).unwrap().wi.x);
        let (low, high) = spread.fold((f32::INFINITY, f32::NEG_INFINITY), |(l, h), x| (l.min(x), h.max(x)));
        assert_eq!(low == high, !bent, "cut {k}");
    }
}

#[test]
fn lamps_shine_from_the_side_that_the_winding_calls_the_front_also_when_mirrored() {
    let scene = area_lights(false);
    let lights = AreaLights::new(&scene).unwrap();
    let mut random = Random(32);
    for _ in 0..20_000 {
        let d =
            direction(f64::from(random.f32()) * std::f64::consts::PI, f64::from(random.f32()) * std::f64::consts::TAU);
        for (primitive, t) in hits(&scene, d) {
            let [a, b, c] = corners(&scene, primitive);
            // A mirroring instance turns the winding round, and with it the front.
            let turned = if primitive.instance == 2 { -1.0 } else { 1.0 };
            let n = (b - a).cross(c - a) * turned;
            let pdf = lights.pdf((&scene, 0.0), (Vec3::ZERO, d), primitive, d, t, None);
            assert_eq!(pdf > 0.0, n.dot(d) < 0.0, "{primitive:?}");
        }
    }
}
