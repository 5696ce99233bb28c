//! Path re-use: it changes noise, and no mean.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use bismar::film::Pixels;
use bismar::integrator::Reuse;
use bismar::rays::Backend;
use bismar::render::{Balance, Choice, RenderSettings, Technique, render};
use bismar::scene::{Environment, Material, PunctualKind, PunctualLight, Scene};
use glam::Vec3;

use crate::helpers::stage::{Stage, add, area_light, lambert, look, metal, rectangle, sphere};
use crate::helpers::statistics::{Mean, z_limit};

fn reuse(text: &str) -> Option<Reuse> {
    Some(text.parse().unwrap())
}

fn settings() -> RenderSettings {
    RenderSettings { width: 24, height: 16, spp: Some(8), max_depth: 6, ..RenderSettings::even() }
}

/// A room of this material, open toward the camera, under a lamp, a point light, a spherical light and a dim sky, with a box of plastic.
fn room(material: Material) -> Arc<Scene> {
    let mut scene = Scene { environment: Some(Environment::constant([0.2, 0.3, 0.4])), ..Default::default() };
    rectangle(&mut scene, 0.0, [-1.0, 1.0], [-1.0, 1.0], true, lambert(0.7));
    rectangle(&mut scene, 2.0, [-1.0, 1.0], [-1.0, 1.0], false, lambert(0.5));
    rectangle(&mut scene, 1.9, [-0.3, 0.3], [-0.3, 0.3], false, area_light(8.0));
    let wall = |x: f32| vec![[x, 0.0, -1.0], [x, 0.0, 1.0], [x, 2.0, 1.0], [x, 2.0, -1.0]];
    for x in [-1.0, 1.0] {
        let both = Material { double_sided: true, ..material.clone() };
        add(&mut scene, wall(x), vec![[0, 1, 2], [0, 2, 3]], both);
    }
    let (points, indices) = sphere(8, 0.35, Vec3::new(0.2, 0.35, 0.1));
    add(&mut scene, points, indices, Material { metallic: 0.0, roughness: 0.4, ..Material::default() });
    for (x, size) in [(-0.5, 0.0), (0.6, 0.15)] {
        scene.lights.push(PunctualLight {
            name: "bulb".into(),
            kind: PunctualKind::Point,
            intensity: Vec3::splat(0.2),
            position: Vec3::new(x, 1.2, 0.3),
            direction: Vec3::NEG_Y,
            range: f32::INFINITY,
            size,
            motion: Vec::new(),
        });
    }
    look(&mut scene, Vec3::new(0.0, 1.0, 3.5), Vec3::new(0.0, 0.9, 0.0), 0.8);
    Arc::new(scene)
}

#[test]
fn pixels_that_share_paths_have_the_mean_of_those_that_do_not() {
    let plastic = Material { metallic: 0.0, roughness: 0.5, ..Material::default() };
    let surfaces = [
        lambert(0.7),
        plastic.clone(),
        metal(0.4),
        metal(0.02),
        Material { clearcoat: 1.0, clearcoat_roughness: 0.2, ..plastic.clone() },
        Material { diffuse_transmission: 0.5, ..plastic },
    ];
    let modes = ["2", "4", "16", "16:4", "8:1"];
    const REPLICAS: u32 = 100;
    let limit = z_limit(surfaces.len() * modes.len());
    for (surface, backend) in surfaces.into_iter().zip([Backend::Embree, Backend::Obvhs].into_iter().cycle()) {
        let name = format!("{surface:?}");
        let stage = Stage::new(room(surface), backend);
        let reference = stage.mean_green(&RenderSettings { seed: 1, ..settings() }, 2 * REPLICAS);
        for (number, mode) in (1..).zip(modes) {
            let balance = if number % 2 == 0 { Balance::Half } else { Balance::Progressive };
            let guiding = if mode == "16" { Choice::On } else { Choice::Off };
            let guided = settings().with(Technique::Guiding, guiding);
            let of = RenderSettings { path_reuse: reuse(mode), seed: 1000 * number, balance, ..guided };
            let mean = stage.mean_green(&of, REPLICAS);
            let error = mean.standard_error().hypot(reference.standard_error());
            let z = (mean.mean - reference.mean) / error;
            assert!(z.abs() < limit, "{mode}: {} for {} ± {error}, z = {z}: {name}", mean.mean, reference.mean);
        }
    }
}

#[test]
fn inside_a_glowing_sphere_each_bounce_adds_its_albedo() {
    let (albedo, emitted, depth) = (0.6, 0.5, 5);
    let mut scene = Scene::default();
    let (points, indices) = sphere(10, 1.0, Vec3::ZERO);
    let glowing = Material { emissive: Vec3::splat(emitted), double_sided: true, ..lambert(albedo) };
    add(&mut scene, points, indices, glowing);
    look(&mut scene, Vec3::ZERO, Vec3::new(0.1, 0.2, 1.0), 1.0);
    let stage = Stage::new(Arc::new(scene), Backend::Embree);
    let expected: f64 = (0..depth).map(|bounces| f64::from(emitted) * f64::from(albedo).powi(bounces)).sum();
    let modes = ["4", "16:4"];
    for mode in modes {
        let of = RenderSettings { path_reuse: reuse(mode), max_depth: depth as u32, ..settings() };
        let z = stage.mean_green(&of, 100).z(expected);
        assert!(z.abs() < z_limit(modes.len()), "{mode}: z = {z}");
    }
}

/// Mean squared difference of pixels from means over all.
fn variance(stage: &Stage, of: &RenderSettings, replicas: u32) -> f64 {
    let mut pixels = vec![Mean::default(); (of.width * of.height) as usize];
    for seed in 0..replicas {
        let green = stage.green(&RenderSettings { seed, ..of.clone() });
        pixels.iter_mut().zip(green).for_each(|(pixel, green)| pixel.add(green));
    }
    pixels.iter().map(|pixel| pixel.standard_error().powi(2)).sum()
}

#[test]
fn light_that_arrives_by_other_surfaces_is_less_noisy() {
    // A lamp that is hidden from the floor below it, which fills the picture.
    let mut scene = Arc::unwrap_or_clone(room(lambert(0.7)));
    (scene.environment, scene.lights, scene.cameras) = (None, Vec::new(), Vec::new());
    look(&mut scene, Vec3::new(0.0, 0.9, 0.9), Vec3::new(-0.5, 0.0, 0.0), 0.4);
    rectangle(&mut scene, 1.8, [-0.6, 0.6], [-0.6, 0.6], true, lambert(0.8));
    let stage = Stage::new(Arc::new(scene), Backend::Embree);
    let alone = variance(&stage, &settings(), 20);
    let shared = variance(&stage, &RenderSettings { path_reuse: reuse("16"), ..settings() }, 20);
    // 384 pixels of 20 replicas: the ratio is known to about 2 %. Measured: see the commit.
    assert!(shared < 0.5 * alone, "{}", shared / alone);
}

#[test]
fn layers_add_up_to_the_picture() {
    let stage = Stage::new(room(lambert(0.7)), Backend::Embree);
    let of = RenderSettings { aovs: true, extras: true, path_reuse: reuse("16:4"), ..settings() };
    let rendered = render(&stage.scene, &of, &AtomicBool::new(false), &|_| ()).unwrap();
    let pixels = rendered.pixels();
    let mut by_kind = [0.0; 3];
    for (x, y) in (0..of.height).flat_map(|y| (0..of.width).map(move |x| (x, y))) {
        let (stats, sums) = pixels.at(x, y);
        let lights = pixels.extras(x, y).unwrap().lights;
        let green = stats.sum[1];
        let both = f64::from(sums.direct[1] + sums.indirect[1]);
        assert!((both - green).abs() <= 1e-4 * green.max(1.0), "{both} for {green}");
        let all: f64 = lights.iter().map(|light| f64::from(light[1])).sum();
        assert!((all - green).abs() <= 1e-4 * green.max(1.0), "{all} for {green}");
        by_kind.iter_mut().zip(lights).for_each(|(sum, light)| *sum += f64::from(light[1]));
    }
    assert!(by_kind.iter().all(|sum| *sum > 0.0), "{by_kind:?}");
}

#[test]
fn shared_pictures_do_not_depend_on_crops_and_are_as_before_where_nothing_can_be_shared() {
    let stage = Stage::new(room(lambert(0.7)), Backend::Embree);
    let green = |of: &RenderSettings| stage.green(of);
    let shared = RenderSettings { path_reuse: reuse("4"), ..settings() };
    assert_ne!(green(&shared), green(&settings()));
    // Of one tile, a part.
    let part = RenderSettings { crop: Some([16, 0, 24, 8]), ..shared.clone() };
    let (whole, part) = (green(&shared), green(&part));
    for (y, row) in part.chunks(8).enumerate() {
        assert_eq!(row, &whole[24 * y + 16..24 * y + 24], "row {y}");
    }
    let clamped = RenderSettings { clamp_indirect: Some(1.0), ..settings() };
    let both = RenderSettings { path_reuse: reuse("4"), ..clamped.clone() };
    assert_eq!(green(&clamped), green(&both));
}
