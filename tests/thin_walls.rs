//! Thin smooth walls pass light straight on: closed forms for every balance and both ray backends, and the variance of rooms
//! behind panes.

use std::f64::consts::FRAC_1_PI;
use std::sync::Arc;

use bismar::bsdf::{Bsdf, Lobe, Parameters, Surface};
use bismar::lanes::{F, LANES, V3};
use bismar::rays::Backend;
use bismar::render::record::checkpoint::pack;
use bismar::render::{Balance, Choice, Integrator, RenderSettings, Technique};
use bismar::scene::{Environment, Filter, Material, Mesh, PunctualKind, Scene, Texels, TextureSlot, Wrap, build};
use glam::{DVec3, Vec3};

use crate::closed_forms::{BALANCES, agrees, settings};
use crate::glass::fresnel;
use crate::helpers::stage::{Stage, add, area_light, closed_box, glass, lambert, look, punctual, rectangle, sphere};
use crate::helpers::statistics::{Mean, z_limit};
use crate::motion::pixel_means;
use crate::one_mean::add_texture;

const DIRECT: [Integrator; 1] = [Integrator::Direct];

pub fn pane() -> Material {
    Material { bounds_medium: false, double_sided: true, ..glass(1.5, 0.0) }
}

/// A floor of albedo 0.5 at y = 0 under `panes` panes of glass, seen from beneath them.
pub fn floor_under(panes: usize, material: &Material) -> Scene {
    let mut scene = Scene::default();
    rectangle(&mut scene, 0.0, [-50.0, 50.0], [-50.0, 50.0], true, lambert(0.5));
    for i in 0..panes {
        rectangle(&mut scene, 0.6 + 0.1 * i as f32, [-99.0, 99.0], [-99.0, 99.0], i % 2 == 0, material.clone());
    }
    look(&mut scene, Vec3::new(0.0, 0.3, 0.4), Vec3::ZERO, 1e-4);
    scene
}

/// What a pane of index 1.5 leaves of light at cosine `cos`.
pub fn left(cos: f64) -> f64 {
    1.0 - fresnel(1.5, cos.acos())
}

/// The area light above the panes: corners in x and z, height.
pub const LIGHT: ([f64; 2], [f64; 2], f64) = ([-1.5, 2.0], [-1.7, 1.4], 1.6);

/// Irradiance from [`LIGHT`] of radiance 1 through panes that leave `left(cos)`.
pub fn irradiance(left: impl Fn(f64) -> f64) -> f64 {
    const N: usize = 1000;
    let ([x0, x1], [z0, z1], y) = LIGHT;
    let at = |low: f64, high: f64, k: usize| low + (k as f64 + 0.5) * (high - low) / N as f64;
    let mut sum = 0.0;
    for i in 0..N * N {
        let p = DVec3::new(at(x0, x1, i % N), y, at(z0, z1, i / N));
        let cos = y / p.length();
        sum += cos * cos / p.length_squared() * left(cos);
    }
    sum * (x1 - x0) * (z1 - z0) / (N * N) as f64
}

#[test]
fn an_area_light_through_panes_is_what_they_leave() {
    let ([x0, x1], [z0, z1], y) = LIGHT;
    for panes in [1, 2] {
        let mut scene = floor_under(panes, &pane());
        let (x, z) = ([x0 as f32, x1 as f32], [z0 as f32, z1 as f32]);
        rectangle(&mut scene, y as f32, x, z, false, area_light(10.0));
        let expected = 0.5 * FRAC_1_PI * 10.0 * irradiance(|cos| left(cos).powi(panes as i32));
        agrees(scene, expected, &DIRECT);
    }
}

#[test]
fn a_sky_through_panes_is_what_they_leave() {
    for panes in [1, 2] {
        let mut scene = floor_under(panes, &pane());
        scene.environment = Some(Environment::constant([2.0; 3]));
        let n = 100_000;
        let cos = |i: i32| (f64::from(i) + 0.5) / f64::from(n);
        let mean: f64 = (0..n).map(|i| 2.0 * cos(i) * left(cos(i)).powi(panes as i32)).sum::<f64>() / f64::from(n);
        agrees(scene, 0.5 * 2.0 * mean, &DIRECT);
    }
}

#[test]
fn punctual_lights_through_panes_are_what_they_leave() {
    let position = Vec3::new(0.7, 1.9, -0.4);
    let (square, cos) = (f64::from(position.length_squared()), f64::from(position.y / position.length()));
    let direction = -position.normalize();
    for (kind, irradiance) in [
        (PunctualKind::Point, 3.0 * cos / square),
        (PunctualKind::Spot { inner: 0.2, outer: 0.3 }, 3.0 * cos / square),
        (PunctualKind::Directional, 3.0 * cos),
    ] {
        for panes in [1, 2] {
            let mut scene = floor_under(panes, &pane());
            scene.lights.push(punctual(kind, 3.0, position, direction));
            agrees(scene, 0.5 * FRAC_1_PI * irradiance * left(cos).powi(panes as i32), &DIRECT);
        }
    }
}

#[test]
fn every_lobe_above_and_within_a_pane_takes_its_part() {
    // A point light through the pane, and an area light that the camera sees through it.
    let tint = |material: Material| Material { base_color: Vec3::new(0.9, 0.6, 0.2).extend(1.0), ..material };
    let film = |material: Material| Material { iridescence: 1.0, iridescence_ior: 1.3, ..material };
    let film = |material| Material { iridescence_thickness: [100.0, 350.0], ..film(material) };
    for material in [
        tint(pane()),
        tint(Material { transmission: 0.7, metallic: 0.2, ..pane() }),
        Material { clearcoat: 0.8, ..pane() },
        tint(Material { sheen_color: Vec3::splat(0.5), sheen_roughness: 0.4, ..pane() }),
        Material { specular: 0.3, specular_color: Vec3::new(1.0, 0.2, 3.0), ..pane() },
        film(pane()),
        film(Material { transmission: 0.6, clearcoat: 0.5, ..pane() }),
        Material { ior: 1.0, ..tint(glass(1.0, 0.7)) },
    ] {
        let material = Material { bounds_medium: false, ..material };
        let surface = Surface {
            base_color: material.base_color.truncate(),
            metallic: material.metallic,
            roughness: material.roughness,
            transmission: material.transmission,
            clearcoat: material.clearcoat,
            sheen_color: material.sheen_color,
            sheen_roughness: material.sheen_roughness,
            specular: material.specular,
            specular_color: material.specular_color,
            ior: material.ior,
            iridescence: (material.iridescence > 0.0).then_some(bismar::bsdf::Iridescence {
                factor: material.iridescence,
                ior: material.iridescence_ior,
                thickness: material.iridescence_thickness[1],
            }),
            ..Surface::default()
        };
        let bsdf = Bsdf::gather([&surface.bsdf(); LANES]);
        let straight =
            |wo: Vec3| f64::from(bsdf.straight(V3::splat(Vec3::Y), V3::splat(wo), F::ONE, false).weight.lane(0).y);

        let position = Vec3::new(0.7, 1.9, -0.4);
        let mut scene = floor_under(1, &material);
        scene.lights.push(punctual(PunctualKind::Point, 3.0, position, Vec3::NEG_Y));
        let (square, cos) = (f64::from(position.length_squared()), f64::from(position.y / position.length()));
        let left = straight(position.normalize());
        assert!(left > 0.05 && left < 1.0, "{left} {material:?}");
        if material.clearcoat == 0.8 {
            let coat = 0.8 * (0.04 + 0.96 * (1.0 - cos).powi(5));
            assert!((left / ((1.0 - coat) * self::left(cos)) - 1.0).abs() < 1e-5, "{left}");
        }
        agrees(scene, 0.5 * FRAC_1_PI * 3.0 * cos / square * left, &DIRECT);

        let mut scene = Scene::default();
        rectangle(&mut scene, 0.0, [-9.0, 9.0], [-9.0, 9.0], true, material);
        rectangle(&mut scene, -1.0, [-9.0, 9.0], [-9.0, 9.0], true, area_light(4.0));
        let eye = Vec3::new(0.0, 1.0, 1.3);
        look(&mut scene, eye, Vec3::ZERO, 1e-4);
        agrees(scene, 4.0 * straight(eye.normalize()), &DIRECT);
    }
}

#[test]
fn panes_are_no_bounces() {
    // A floor behind 20 panes, lit through 20 others, by direct light only.
    let thin = Material { ior: 1.2, ..pane() };
    let mut scene = floor_under(20, &thin);
    let position = Vec3::new(0.5, 4.0, -0.4);
    scene.lights.push(punctual(PunctualKind::Point, 3.0, position, Vec3::NEG_Y));
    let eye = Vec3::new(0.0, 5.0, 2.0);
    scene.cameras.clear();
    look(&mut scene, eye, Vec3::ZERO, 1e-4);
    let left = |from: Vec3| (1.0 - fresnel(1.2, f64::from(from.normalize().y).acos())).powi(20);
    let (square, cos) = (f64::from(position.length_squared()), f64::from(position.normalize().y));
    agrees(scene, 0.5 * FRAC_1_PI * 3.0 * cos / square * left(position) * left(eye), &DIRECT);
}

#[test]
fn a_ray_passes_no_more_than_256_walls() {
    for (walls, lit) in [(256, true), (257, false)] {
        let air = Material { ior: 1.0, specular: 0.0, ..pane() };
        let mut scene = Scene::default();
        rectangle(&mut scene, 0.0, [-50.0, 50.0], [-50.0, 50.0], true, lambert(0.5));
        for i in 0..walls {
            rectangle(&mut scene, 1.0 + 0.01 * i as f32, [-9.0, 9.0], [-9.0, 9.0], true, air.clone());
        }
        let sun = punctual(PunctualKind::Directional, 1.0, Vec3::ZERO, Vec3::NEG_Y);
        for (eye, sun) in [(Vec3::new(0.0, 0.5, 0.5), Some(sun)), (Vec3::new(0.0, 9.0, 1.0), None)] {
            let mut scene = scene.clone();
            match sun {
                Some(sun) => scene.lights.push(sun),
                None => rectangle(&mut scene, 0.5, [-9.0, 9.0], [-9.0, 9.0], true, area_light(1.0)),
            }
            look(&mut scene, eye, Vec3::ZERO, 1e-3);
            for backend in [Backend::Embree, Backend::Obvhs] {
                let green = Stage::new(Arc::new(scene.clone()), backend).green(&settings());
                assert!(green.iter().all(|green| (*green > 0.1) == lit), "{walls} {eye} {backend:?}: {green:?}");
            }
        }
    }
}

/// A room of 4 x 3 x 4 metres with a window of one metre in the wall at x = 2, and panes in it.
fn room(panes: usize, light: impl Fn(&mut Scene)) -> Arc<Scene> {
    let mut scene = Scene::default();
    let mut wall = |corners: [[f64; 3]; 4]| {
        let material = Material { double_sided: true, ..lambert(0.7) };
        build::add_shape(&mut scene, &build::quad(corners.map(DVec3::from_array)), material);
    };
    let quad = |x: [f64; 2], y: [f64; 2], z: [f64; 2]| match (x[0] == x[1], y[0] == y[1]) {
        (true, _) => [[x[0], y[0], z[0]], [x[0], y[1], z[0]], [x[0], y[1], z[1]], [x[0], y[0], z[1]]],
        (_, true) => [[x[0], y[0], z[0]], [x[1], y[0], z[0]], [x[1], y[0], z[1]], [x[0], y[0], z[1]]],
        _ => [[x[0], y[0], z[0]], [x[1], y[0], z[0]], [x[1], y[1], z[0]], [x[0], y[1], z[0]]],
    };
    let (x, y, z) = ([-2.0, 2.0], [0.0, 3.0], [-2.0, 2.0]);
    for end in [0, 1] {
        wall(quad(x, [y[end]; 2], z));
        wall(quad(x, y, [z[end]; 2]));
    }
    wall(quad([-2.0; 2], y, z));
    for (y, z) in [(y, [-2.0, -0.5]), (y, [0.5, 2.0]), ([0.0, 1.0], [-0.5, 0.5]), ([2.0, 3.0], [-0.5, 0.5])] {
        wall(quad([2.0; 2], y, z));
    }
    for i in 0..panes {
        let corners = quad([2.0 + 0.02 * i as f64; 2], [1.0, 2.0], [-0.5, 0.5]);
        build::add_shape(&mut scene, &build::quad(corners.map(DVec3::from_array)), pane());
    }
    light(&mut scene);
    look(&mut scene, Vec3::new(-1.8, 1.6, 1.8), Vec3::new(1.0, 0.8, -0.8), 0.9);
    Arc::new(scene)
}

/// Mean of a picture with its standard error, and the median relative variance of its pixels that are not dark.
/// Reflections of a small light between two panes are rare bright paths, as without glass in front of mirrors; a median
/// leaves them out.
fn relative_variance(scene: Arc<Scene>, backend: Backend, settings: &RenderSettings) -> (f64, f64, f64) {
    const REPLICAS: u32 = 12;
    let mut pixels = pixel_means(&Stage::new(scene, backend), settings, REPLICAS);
    let n = pixels.len() as f64;
    let mean = pixels.iter().map(|p| p.mean).sum::<f64>() / n;
    let error = pixels.iter().map(|p| p.standard_error().powi(2)).sum::<f64>().sqrt() / n;
    // The view through the window is black.
    pixels.retain(|pixel| pixel.mean > 0.1 * mean);
    let variance = |p: &Mean| f64::from(REPLICAS) * (p.standard_error() / p.mean).powi(2);
    let mut variances: Vec<_> = pixels.iter().map(variance).collect();
    variances.sort_by(f64::total_cmp);
    (mean, error, variances[variances.len() / 2])
}

/// A light by its name, and what adds it.
type Light = (&'static str, fn(&mut Scene));

const LIGHTS: [Light; 5] = [
    ("sun", |scene| {
        let direction = Vec3::new(-1.0, -0.7, 0.2).normalize();
        scene.lights.push(punctual(PunctualKind::Directional, 10.0, Vec3::ZERO, direction));
    }),
    ("spot", |scene| {
        let (position, direction) = (Vec3::new(4.0, 2.6, 0.3), Vec3::new(-1.0, -0.55, 0.0).normalize());
        scene.lights.push(punctual(PunctualKind::Spot { inner: 0.3, outer: 0.5 }, 30.0, position, direction));
    }),
    ("point", |scene| {
        scene.lights.push(punctual(PunctualKind::Point, 30.0, Vec3::new(3.6, 2.6, 0.3), Vec3::NEG_Y));
    }),
    ("area light", |scene| {
        let corners = [[4.0, 1.5, 0.5], [4.0, 1.5, -0.5], [3.6, 2.4, -0.5], [3.6, 2.4, 0.5]].map(DVec3::from_array);
        build::add_shape(scene, &build::quad(corners), Material { double_sided: true, ..area_light(20.0) });
    }),
    ("sky", |scene| scene.environment = Some(Environment::constant([3.0; 3]))),
];

#[test]
fn a_room_behind_panes_is_no_noisier_than_one_without() {
    let settings = RenderSettings { width: 24, height: 18, spp: Some(32), max_depth: 8, ..RenderSettings::even() };
    for (name, light) in LIGHTS {
        for (backend, guiding) in
            [(Backend::Embree, Choice::Off), (Backend::Obvhs, Choice::Off), (Backend::Embree, Choice::On)]
        {
            let settings = settings.clone().with(Technique::Guiding, guiding);
            let [open, one, two] = [0, 1, 2].map(|n| relative_variance(room(n, light), backend, &settings));
            for (panes, (mean, error, variance)) in [(1, one), (2, two)] {
                let (left, ratio) = (mean / open.0, variance / open.2);
                let error = left * (error / mean).hypot(open.1 / open.0);
                // At this angle a pane leaves 0.92 to 0.96 of the light, reflections in the room included.
                let most = z_limit(30) * error;
                let is_glass = left + most > 0.9f64.powi(panes) && left - most < 0.97;
                assert!(is_glass, "{name} {panes} {backend:?}: {left} ± {error}");
                assert!(ratio < 1.5, "{name} {panes} {backend:?} {guiding:?}: {ratio} of {}", open.2);
            }
        }
    }
}

#[test]
fn all_balances_agree_on_a_pane_that_is_smooth_in_parts() {
    // Stripes of roughness 0 and 0.5, interpolated between, in front of a small light and a sky.
    let mut scene = Scene { environment: Some(Environment::constant([0.5; 3])), ..Default::default() };
    rectangle(&mut scene, 0.0, [-3.0, 3.0], [-3.0, 3.0], true, lambert(0.6));
    rectangle(&mut scene, 1.5, [-0.4, 0.4], [-0.4, 0.4], false, area_light(9.0));
    let texels = (0..4).map(|x| [0, if x < 2 { 0 } else { 255 }, 0]).collect();
    let stripes = add_texture(&mut scene, 4, Texels::Rgb8(texels), Wrap::Repeat, Filter::Linear);
    let mut material = Material { roughness: 0.5, ..pane() };
    material.textures[TextureSlot::MetallicRoughness] = Some(stripes);
    let points = vec![[-1.0, 0.7, -1.0], [-1.0, 0.7, 1.0], [1.0, 0.7, 1.0], [1.0, 0.7, -1.0]];
    let mut mesh = Mesh::new(points, vec![[0, 1, 2], [0, 2, 3]]);
    mesh.texcoords[0] = Some(vec![[0.0, 0.0], [0.0, 1.0], [2.0, 1.0], [2.0, 0.0]]);
    scene.add(mesh, material);
    look(&mut scene, Vec3::new(0.0, 1.6, 1.9), Vec3::new(0.0, 0.3, 0.0), 0.9);
    let stage = Stage::new(Arc::new(scene), Backend::Embree);
    let settings = RenderSettings { width: 8, height: 6, max_depth: 6, ..settings() };
    let reference = RenderSettings { balance: Balance::Half, seed: 900_000, spp: Some(128), ..settings.clone() };
    let reference = stage.mean_green(&reference, 100);
    for balance in BALANCES {
        let mean = stage.mean_green(&RenderSettings { balance, ..settings.clone() }, 200);
        let z = mean.z_to(&reference);
        assert!(z.abs() < z_limit(BALANCES.len()), "{balance:?}: {} for {}, z = {z}", mean.mean, reference.mean);
    }
}

#[test]
fn hostile_panes_give_finite_pictures() {
    let mut scene = Scene { environment: Some(Environment::constant([1.0; 3])), ..Default::default() };
    rectangle(&mut scene, 0.0, [-3.0, 3.0], [-3.0, 3.0], true, lambert(0.6));
    scene.lights.push(punctual(PunctualKind::Point, 3.0, Vec3::new(0.3, 2.5, 0.2), Vec3::NEG_Y));
    // 200 panes in a row, of which every other one emits.
    for i in 0..200 {
        let emissive = Vec3::splat(0.01 * f32::from(u8::from(i % 2 == 0)));
        let y = 1.0 + 1e-3 * i as f32;
        rectangle(&mut scene, y, [-1.0, 1.0], [-1.0, 1.0], true, Material { emissive, ..pane() });
    }
    // Panes of odd indices that intersect, some of them twice in the same place, and a lamp inside of a solid.
    for (i, ior) in (0..).zip([0.0, 1.0, 1.0, 1.000_01, 1000.0, 1000.0, f32::MAX]) {
        let x = -1.5 + 0.5 * (i / 2) as f32;
        let points = vec![[x, 0.1, 1.5], [x + 0.9, 0.1, 1.0], [x + 0.9, 1.5, 1.0], [x, 1.5, 1.5]];
        let iridescence = f32::from(u8::from(i % 2 == 1));
        let material = Material { ior, iridescence, ..pane() };
        add(&mut scene, points, vec![[0, 1, 2], [0, 2, 3]], material);
    }
    let centre = Vec3::new(0.0, 0.5, 1.2);
    let (points, indices) = sphere(6, 0.1, centre);
    add(&mut scene, points, indices, area_light(10.0));
    closed_box(&mut scene, centre - Vec3::splat(0.2), centre + Vec3::splat(0.2), glass(1.5, 0.0));
    look(&mut scene, Vec3::new(0.0, 1.6, 3.5), Vec3::new(0.0, 0.5, 0.0), 0.9);
    for backend in [Backend::Embree, Backend::Obvhs] {
        let stage = Stage::new(Arc::new(scene.clone()), backend);
        for balance in BALANCES {
            let pixels = stage.green(&RenderSettings { width: 24, height: 16, balance, max_depth: 16, ..settings() });
            assert!(pixels.iter().all(|p| p.is_finite()) && pixels.iter().sum::<f64>() > 0.0);
        }
    }
}

#[test]
fn panes_in_a_white_furnace_vanish() {
    // With all that they reflect to and fro between them.
    let mut scene = Scene { environment: Some(Environment::constant([1.0; 3])), ..Default::default() };
    for i in 0..3 {
        let (points, indices) = sphere(8, 0.5 + 0.2 * i as f32, Vec3::ZERO);
        add(&mut scene, points, indices, Material { clearcoat: 0.3 * i as f32, ..pane() });
    }
    look(&mut scene, Vec3::new(0.0, 0.5, 3.0), Vec3::ZERO, 0.3);
    let settings = RenderSettings { max_depth: 64, ..settings() };
    for backend in [Backend::Embree, Backend::Obvhs] {
        let mean = Stage::new(Arc::new(scene.clone()), backend).mean_green(&settings, 300);
        assert!(mean.z(1.0).abs() < z_limit(2), "{backend:?}: {} ± {}", mean.mean, mean.standard_error());
    }
}

#[test]
fn a_thread_that_has_rendered_panes_renders_other_scenes_as_before() {
    let room = |panes: usize| {
        let mut scene = floor_under(panes, &pane());
        let ([x0, x1], [z0, z1], y) = LIGHT;
        rectangle(&mut scene, y as f32, [x0 as f32, x1 as f32], [z0 as f32, z1 as f32], false, area_light(10.0));
        scene.environment = Some(Environment::constant([2.0; 3]));
        Stage::new(Arc::new(scene), Backend::Embree)
    };
    let (plain, glazed) = (room(0), room(2));
    for (balance, transparent) in [(Balance::SecondOrder, false), (Balance::Half, true)] {
        let settings = RenderSettings {
            width: 24,
            height: 24,
            spp: Some(40),
            aovs: true,
            balance,
            transparent,
            ..RenderSettings::even()
        };
        let bits = |stages: &[&Stage]| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
            let of = |stage: &&Stage| stage.render(&settings);
            pool.install(|| stages.iter().map(|stage| pack(&of(stage).tiles).unwrap()).next_back())
        };
        assert!(bits(&[&plain]) == bits(&[&glazed, &plain]), "{balance:?}");
    }
}
