//! Path re-use: it changes noise, and no mean.

use std::sync::Arc;

use bismar::film::compare::compare;
use bismar::film::{Picture, Pixels, exr_file};
use bismar::rays::Backend;
use bismar::render::{Balance, Choice, RenderSettings, Technique};
use bismar::scene::{AlphaMode, Environment, Material, PunctualKind, PunctualLight, Scene};
use glam::{Vec3, Vec4};

use crate::helpers::program::{Folder, expect};
use crate::helpers::stage::{Stage, add, area_light, closed_box, lambert, look, metal, punctual, rectangle, sphere};
use crate::helpers::statistics::{Mean, z_limit};
use crate::motion::pixel_means;

/// These settings with groups of such sizes.
fn sharing(sizes: &str, of: RenderSettings) -> RenderSettings {
    RenderSettings { reuse_sizes: Some(sizes.parse().unwrap()), ..of.with(Technique::PathReuse, Choice::On) }
}

fn settings() -> RenderSettings {
    RenderSettings { width: 24, height: 16, spp: Some(8), max_depth: 6, ..RenderSettings::even() }
}

/// A room of this material with a floor of white and black stripes, open toward the camera, under a lamp, a point light, a
/// spherical light and a dim sky, with a box of plastic.
fn room(material: Material) -> Arc<Scene> {
    let mut scene = Scene { environment: Some(Environment::constant([0.2, 0.3, 0.4])), ..Default::default() };
    for stripe in 0..8 {
        let x = 0.25 * stripe as f32 - 1.0;
        let albedo = if stripe % 2 == 0 { 0.7 } else { 0.0 };
        rectangle(&mut scene, 0.0, [x, x + 0.25], [-1.0, 1.0], true, lambert(albedo));
    }
    rectangle(&mut scene, 2.0, [-1.0, 1.0], [-1.0, 1.0], false, lambert(0.5));
    rectangle(&mut scene, 1.9, [-0.3, 0.3], [-0.3, 0.3], false, area_light(8.0));
    let wall = |x: f32| vec![[x, 0.0, -1.0], [x, 0.0, 1.0], [x, 2.0, 1.0], [x, 2.0, -1.0]];
    for x in [-1.0, 1.0] {
        let both = Material { double_sided: true, ..material.clone() };
        add(&mut scene, wall(x), vec![[0, 1, 2], [0, 2, 3]], both);
    }
    // Glass is hollow: a ball of plastic lies in it, and its walls let the room's light out.
    for radius in [0.35, 0.25] {
        let (points, indices) = sphere(8, radius, Vec3::new(0.2, 0.35, 0.1));
        let plastic = Material { metallic: 0.0, roughness: 0.4, ..Material::default() };
        let outer = if material.transmission > 0.0 { material.clone() } else { plastic.clone() };
        add(&mut scene, points, indices, if radius > 0.3 { outer } else { plastic });
    }
    for (x, size) in [(-0.5, 0.0), (0.6, 0.15)] {
        let light = punctual(PunctualKind::Point, 0.2, Vec3::new(x, 1.2, 0.3), Vec3::NEG_Y);
        scene.lights.push(PunctualLight { size, ..light });
    }
    look(&mut scene, Vec3::new(0.0, 1.0, 3.5), Vec3::new(0.0, 0.9, 0.0), 0.8);
    Arc::new(scene)
}

#[test]
fn pixels_that_share_paths_have_the_mean_of_those_that_do_not() {
    let plastic = Material { metallic: 0.0, roughness: 0.5, ..Material::default() };
    let pane = Material { metallic: 0.0, roughness: 0.0, transmission: 1.0, ..Material::default() };
    let surfaces = [
        lambert(0.7),
        plastic.clone(),
        // α just above the limit of rough lobes.
        metal(0.3163),
        Material { metallic: 0.4, roughness: 0.0, ..plastic.clone() },
        Material { clearcoat: 1.0, clearcoat_roughness: 0.0, ..plastic.clone() },
        Material { diffuse_transmission: 0.5, ..plastic },
        pane.clone(),
        // Which surfaces are there depends on the ray.
        Material { alpha_mode: AlphaMode::Blend, base_color: Vec4::new(0.7, 0.7, 0.7, 0.5), ..lambert(0.7) },
        Material { absorption: Vec3::new(2.0, 0.5, 1.0), dispersion: 2.0, bounds_medium: true, ..pane },
    ];
    let modes = ["2", "4", "16", "64:16", "8:1"];
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
            let of = sharing(mode, RenderSettings { seed: 1000 * number, balance, ..guided });
            let mean = stage.mean_green(&of, REPLICAS);
            let z = mean.z_to(&reference);
            assert!(z.abs() < limit, "{mode}: {} for {}, z = {z}: {name}", mean.mean, reference.mean);
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
        let of = sharing(mode, RenderSettings { max_depth: depth as u32, ..settings() });
        let z = stage.mean_green(&of, 100).z(expected);
        assert!(z.abs() < z_limit(modes.len()), "{mode}: z = {z}");
    }
}

/// Mean squared difference of pixels from means over all.
fn variance(stage: &Stage, of: &RenderSettings, replicas: u32) -> f64 {
    pixel_means(stage, of, replicas).iter().map(|pixel| pixel.standard_error().powi(2)).sum()
}

/// A room whose lamp is hidden from the floor below it, which fills the picture.
fn indirect_room() -> Stage {
    let mut scene = Arc::unwrap_or_clone(room(lambert(0.7)));
    (scene.environment, scene.lights, scene.cameras) = (None, Vec::new(), Vec::new());
    look(&mut scene, Vec3::new(0.0, 0.9, 0.9), Vec3::new(-0.5, 0.0, 0.0), 0.4);
    rectangle(&mut scene, 1.8, [-0.6, 0.6], [-0.6, 0.6], true, lambert(0.8));
    Stage::new(Arc::new(scene), Backend::Embree)
}

#[test]
fn light_that_arrives_by_other_surfaces_is_less_noisy() {
    let stage = indirect_room();
    let alone = variance(&stage, &settings(), 20);
    let shared = variance(&stage, &sharing("16", settings()), 20);
    // 384 pixels of 20 replicas: the ratio is known to about 2 %. Measured: see the commit.
    assert!(shared < 0.5 * alone, "{}", shared / alone);
}

#[test]
fn what_sharp_lobes_of_second_surfaces_scatter_is_not_noisier() {
    let half = Material { metallic: 0.4, roughness: 0.0, ..Material::default() };
    for material in [metal(0.3163), half, Material { clearcoat: 1.0, ..lambert(0.7) }] {
        let stage = Stage::new(room(material.clone()), Backend::Embree);
        let [alone, shared] = [settings(), sharing("16:4", settings())].map(|of| variance(&stage, &of, 40));
        // Known to about 3 %. Fireflies of lobes that are lent whole make it 3 to 250.
        assert!(shared < 1.15 * alone, "{}: {material:?}", shared / alone);
    }
}

/// Of dim walls lit through a slit, where tiles could be seen.
#[test]
fn means_of_tiles_are_not_much_noisier_than_those_of_unrelated_pixels() {
    const REPLICAS: u32 = 6;
    let folder = Folder::new().with_scene("slit.glb", "study/slit.glb").with_scene("slit.hdr", "study/slit.hdr");
    let pictures = |flags: &str| -> Vec<Vec<f64>> {
        let render = |seed| {
            let line =
                format!("render slit.glb --env slit.hdr --size 96x64 --seed {seed} --aov none -q -o a.exr {flags}");
            expect(&folder, &line, 0);
            exr_file::read(&folder.join("a.exr")).unwrap().rgb.iter().map(|rgb| f64::from(rgb[1])).collect()
        };
        (0..REPLICAS).map(render).collect()
    };
    for paths in [16, 64] {
        let [alone, plain] = ["--balance half --adaptive off --guiding off --path-reuse off", ""]
            .map(|flags| pictures(&format!("--spp {paths} {flags}")));
        let mean = |x: usize| alone.iter().chain(&plain).map(|all| all[x]).sum::<f64>() / f64::from(2 * REPLICAS);
        let weights: Vec<f64> = (0..96 * 64).map(|x| 1.0 / (mean(x).powi(2) + 0.01).sqrt()).collect();
        // Sums of squares of what differs from the mean over the replicas, in the mean over blocks of `side` pixels.
        let squares = |all: &[Vec<f64>], side: usize| {
            let block = |picture: &[f64], at: usize| {
                let (x0, y0) = (at % (96 / side) * side, at / (96 / side) * side);
                let pixels = (y0..y0 + side).flat_map(|y| (x0..x0 + side).map(move |x| 96 * y + x));
                pixels.map(|i| picture[i] * weights[i]).sum::<f64>()
            };
            let of_block = |at| {
                all.iter().fold(Mean::default(), |mut all, picture| {
                    all.add(block(picture, at));
                    all
                })
            };
            (0..96 * 64 / side.pow(2)).map(|at| of_block(at).standard_error().powi(2)).sum::<f64>()
        };
        // 24 tiles of 6 replicas: the ratio is known to about a quarter.
        let ratio = squares(&plain, 16) / squares(&alone, 1);
        assert!(ratio < 2.0 * 1.5, "{paths} paths: {ratio}");
    }
}

#[test]
fn direct_and_indirect_light_add_up_to_the_picture() {
    let stage = Stage::new(room(lambert(0.7)), Backend::Embree);
    let of = sharing("16:4", RenderSettings { aovs: true, ..settings() });
    let rendered = stage.render(&of);
    let pixels = rendered.pixels();
    for (x, y) in (0..of.height).flat_map(|y| (0..of.width).map(move |x| (x, y))) {
        let (stats, sums) = pixels.at(x, y);
        let (green, both) = (stats.sum[1], f64::from(sums.direct[1] + sums.indirect[1]));
        assert!((both - green).abs() <= 1e-4 * green.max(1.0), "{both} for {green}");
    }
}

#[test]
fn shared_pictures_do_not_depend_on_crops_and_are_as_before_where_nothing_can_be_shared() {
    let stage = Stage::new(room(lambert(0.7)), Backend::Embree);
    let green = |of: &RenderSettings| stage.green(of);
    let shared = sharing("4", settings());
    assert_ne!(green(&shared), green(&settings()));
    // Of one tile, a part.
    let part = RenderSettings { crop: Some([16, 0, 24, 8]), ..shared.clone() };
    let (whole, part) = (green(&shared), green(&part));
    for (y, row) in part.chunks(8).enumerate() {
        assert_eq!(row, &whole[24 * y + 16..24 * y + 24], "row {y}");
    }
    let clamped = RenderSettings { clamp_indirect: Some(1.0), ..settings() };
    let both = sharing("4", clamped.clone());
    assert_eq!(green(&clamped), green(&both));
}

#[test]
fn paths_are_shared_where_it_pays() {
    let used = |stage: &Stage, seed: u32| {
        let auto = RenderSettings { width: 96, height: 64, spp: Some(16), seed, ..settings() };
        let auto = auto.with(Technique::PathReuse, Choice::Auto);
        let rendered = stage.render(&auto);
        rendered.stats.techniques[Technique::PathReuse].map(|stats| stats.on)
    };
    let mut plane = Scene { environment: Some(Environment::constant([0.5; 3])), ..Default::default() };
    rectangle(&mut plane, 0.0, [-9.0, 9.0], [-9.0, 9.0], true, lambert(0.7));
    look(&mut plane, Vec3::new(0.0, 1.0, 3.5), Vec3::ZERO, 0.8);
    let [room, plane] = [indirect_room(), Stage::new(Arc::new(plane), Backend::Embree)];
    for seed in 0..3 {
        assert_eq!([used(&room, seed), used(&plane, seed)], [Some(true), Some(false)], "seed {seed}");
    }
}

/// A closed room under a dim lamp, with a small bright spot on a wall that the camera, above the floor, does not see.
fn room_with_a_spot() -> Stage {
    let mut scene = Scene::default();
    closed_box(&mut scene, Vec3::splat(-1.0), Vec3::ONE, Material { double_sided: true, ..lambert(0.8) });
    let spot = PunctualKind::Spot { inner: 0.018, outer: 0.02 };
    scene.lights.push(punctual(spot, 100.0, Vec3::new(-0.9, 0.3, 0.0), Vec3::X));
    scene.lights.push(punctual(PunctualKind::Point, 1.5e-4, Vec3::new(0.0, -0.6, 0.2), Vec3::NEG_Y));
    look(&mut scene, Vec3::new(0.0, 0.5, 0.01), Vec3::new(0.0, -1.0, 0.0), 0.6);
    Stage::new(Arc::new(scene), Backend::Embree)
}

/// Rare light decides when pixels stop, and those that share it must not decide for one another.
#[test]
fn a_noise_goal_makes_no_picture_darker_that_shares_rare_light() {
    let stage = room_with_a_spot();
    let of = RenderSettings { width: 16, height: 16, max_depth: 3, balance: Balance::Half, ..RenderSettings::even() };
    let long = RenderSettings { spp: Some(2048), seed: 1 << 20, ..of.clone() };
    let goal = RenderSettings { spp: Some(1024), noise: Some(0.1), ..of };
    let (reference, mean) = (stage.mean_green(&long, 20), stage.mean_green(&sharing("64:16", goal), 60));
    let z = mean.z_to(&reference);
    assert!(z.abs() < z_limit(1), "{} for {}, z = {z}", mean.mean, reference.mean);
}

/// A room whose walls glow, which stratified points find well.
fn glowing_room() -> Stage {
    let mut scene = Scene::default();
    closed_box(&mut scene, Vec3::splat(-1.0), Vec3::ONE, Material { double_sided: true, ..lambert(0.6) });
    let glowing = Material { emissive: Vec3::splat(0.5), double_sided: true, ..lambert(0.6) };
    rectangle(&mut scene, 0.99, [-1.0, 1.0], [-1.0, 1.0], false, glowing);
    look(&mut scene, Vec3::new(0.0, 0.0, 0.6), Vec3::new(0.0, 0.0, -1.0), 0.8);
    Stage::new(Arc::new(scene), Backend::Embree)
}

#[test]
fn the_variance_of_a_picture_s_mean_counts_stratified_and_shared_paths() {
    const REPLICAS: u32 = 100;
    // Mean squares of z have a standard deviation of the root of 2 / 99 where variances are known; at four of them, 1e-4 of false
    // alarms each. Of these it is the estimates' own error that is allowed for: 1.25 in variance.
    let most = 1.25 * (1.0 + 4.0 * (2.0 / f64::from(REPLICAS - 1)).sqrt());
    let smooth = glowing_room();
    let lamp = Stage::new(room(lambert(0.7)), Backend::Embree);
    let indirect = indirect_room();
    for (name, stage, sizes) in [
        ("smooth", &smooth, Some("64:16")),
        ("smooth", &smooth, None),
        ("lamp", &lamp, Some("16")),
        ("lamp", &lamp, None),
        ("indirect", &indirect, Some("16:4")),
    ] {
        let of = RenderSettings { spp: Some(32), ..settings() };
        let of = sizes.map_or(of.clone(), |sizes| sharing(sizes, of.clone()));
        let (mut mean, mut stated, mut independent, mut found) = (Mean::default(), 0.0, 0.0, Vec::new());
        for seed in 0..REPLICAS {
            let rendered = stage.render(&RenderSettings { seed, ..of.clone() });
            let pixels = rendered.film().pixels;
            let n = pixels.len() as f64;
            let variance = pixels.iter().map(|pixel| f64::from(pixel.variance_of_mean()[1])).sum::<f64>() / n.powi(2);
            let estimate = variance * rendered.mean_variance().unwrap().over_independent[1];
            let own = pixels.iter().map(|pixel| f64::from(pixel.mean()[1])).sum::<f64>() / n;
            mean.add(own);
            (stated, independent) = (stated + estimate, independent + variance);
            found.push((own, estimate));
        }
        let squares = found.iter().map(|(own, variance)| (own - mean.mean).powi(2) / variance).sum::<f64>();
        let squares = squares / f64::from(REPLICAS - 1);
        let over = mean.standard_error().powi(2) * f64::from(REPLICAS).powi(2) / stated;
        println!("{name} {sizes:?}: {squares:.2} {over:.2}, stated {:.2} of independent", stated / independent);
        assert!(
            over < most && over > 1.0 / most,
            "{name} {sizes:?}: the true variance over that which is stated is {over}"
        );
        // Where a picture's own variance follows from a few bright paths, its z has longer tails.
        assert!(name == "indirect" || squares < most, "{name} {sizes:?}: mean square of z {squares}");
    }
}

/// `compare`'s z of two pictures of one scene is a standard normal number.
#[test]
fn bias_z_has_unit_variance() {
    const PAIRS: u32 = 50;
    let (stage, of) = (glowing_room(), sharing("64:16", RenderSettings { spp: Some(32), ..settings() }));
    let picture = |seed: u32| {
        let rendered = stage.render(&RenderSettings { seed, ..of.clone() });
        let film = rendered.film();
        let window = [0, 0, i64::from(of.width), i64::from(of.height)];
        Picture {
            window,
            display: window,
            rgb: film.pixels.iter().map(|pixel| pixel.mean()).collect(),
            variance: Some(film.pixels.iter().map(|pixel| pixel.variance_of_mean()).collect()),
            alpha: None,
            displayed: false,
            mean_variance: rendered.mean_variance().unwrap().over_independent,
        }
    };
    let z = |pair: u32| {
        let [a, b] = [2 * pair, 2 * pair + 1].map(picture);
        compare(&a, &b).unwrap().statistics.unwrap().bias_z[1]
    };
    let squares = (0..PAIRS).map(|pair| z(pair).powi(2)).sum::<f64>() / f64::from(PAIRS);
    // Four standard deviations of the mean of 50 squares, and 1.25 as above.
    let most = 1.25 * (1.0 + 4.0 * (2.0 / f64::from(PAIRS)).sqrt());
    assert!(squares < most && squares > 1.0 / most, "{squares}");
}
