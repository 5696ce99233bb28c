//! Paths where the noise is: as many in all, less error, the same means.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use bismar::film::compare::relative_to;
use bismar::rays::Backend;
use bismar::render::record::checkpoint::{fits, pack, unpack};
use bismar::render::{
    Balance, Choice, Part, Progress, RenderSettings, Rendered, RunOptions, Saved, StopReason, Technique,
    TechniqueStats, run,
};
use bismar::scene::Scene;
use glam::Vec3;

use crate::helpers::program::{Folder, expect, read_json, says};
use crate::helpers::stage::{Stage, add_sphere, area_light, lambert, look, metal, rectangle};
use crate::helpers::statistics::Mean;

/// A matt floor below two area lights next to a polished one that shows them, and a wide black border: noise of three kinds.
fn floors() -> Arc<Scene> {
    let mut scene = Scene::default();
    rectangle(&mut scene, 0.0, [-1.0, 0.0], [-1.0, 1.0], true, lambert(0.7));
    rectangle(&mut scene, 0.0, [0.0, 1.0], [-1.0, 1.0], true, metal(0.3));
    rectangle(&mut scene, 1.2, [-0.1, 0.1], [-1.1, -0.9], false, area_light(30.0));
    rectangle(&mut scene, 0.4, [-0.9, -0.86], [0.2, 0.24], false, area_light(600.0));
    look(&mut scene, Vec3::new(0.0, 2.2, 2.4), Vec3::new(0.0, 0.0, -0.1), 1.2);
    Arc::new(scene)
}

fn settings() -> RenderSettings {
    RenderSettings {
        width: 96,
        height: 64,
        spp: Some(32),
        balance: Balance::Half,
        ..RenderSettings::even().with(Technique::Adaptive, Choice::On)
    }
}

/// Paths over those of as many everywhere.
fn paths(rendered: &Rendered, mean: u32) -> f64 {
    rendered.stats.paths as f64 / f64::from(mean * 96 * 64)
}

#[test]
fn as_many_paths_leave_less_error_and_the_same_means() {
    compare(floors(), 240, 1.0);
}

/// Tiles that differ leave no trace of threads, crops, parts or sessions.
#[test]
fn the_paths_of_a_tile_depend_on_nothing_but_the_picture() {
    let stage = Stage::new(floors(), Backend::Embree);
    let settings = |spp| RenderSettings { balance: Balance::Progressive, spp: Some(spp), aovs: true, ..settings() };
    let on = |threads, settings: &RenderSettings, from| {
        let never = AtomicBool::new(false);
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let options = RunOptions { from, ..RunOptions::new(&never, &|_| ()) };
            run(&stage.scene, settings, options).unwrap()
        })
    };
    let whole = on(1, &settings(256), None);
    let differ = whole.tiles.iter().filter(|tile| tile.paths() != 256).count();
    assert!(differ > 4 && whole.stats.paths <= 256 * 96 * 64, "{differ}");
    let packed = |rendered: &Rendered| pack(&rendered.tiles).unwrap();
    // From 128 paths, by way of a file's bytes.
    let half = on(3, &settings(128), None);
    let tiles = unpack(&packed(&half)).unwrap();
    assert!(fits(&tiles, &settings(128)));
    let saved = Saved { tiles, stats: half.stats, goals: half.goals };
    assert!(saved.has_passes_of(&settings(256)));
    assert_eq!(packed(&on(2, &settings(256), Some(saved))), packed(&whole));
    // Any number of paths goes on, to the mean that it should have.
    let odd = on(2, &settings(50), None);
    let saved = Saved { tiles: odd.tiles, stats: odd.stats, goals: odd.goals };
    let more = on(2, &settings(77), Some(saved));
    assert!(more.tiles.iter().all(|tile| tile.fewest_paths() == tile.paths()));
    assert!((0.93..=1.0).contains(&paths(&more, 77)), "{}", more.stats.paths);
    let [crop, part] = [
        RenderSettings { crop: Some([13, 9, 50, 40]), ..settings(256) },
        RenderSettings { part: Some(Part { number: 2, of: 3 }), ..settings(256) },
    ]
    .map(|settings| on(2, &settings, None));
    for tile in crop.tiles.iter().chain(&part.tiles) {
        let same = whole.tiles.iter().find(|other| other.grid_position() == tile.grid_position()).unwrap();
        assert_eq!(format!("{:?}", tile.stats), format!("{:?}", same.stats));
    }
}

#[test]
fn silhouettes_of_lights_have_a_fraction_of_the_error_and_the_same_means() {
    let mut scene = Scene::default();
    rectangle(&mut scene, 0.0, [-1.0, 1.0], [-1.0, 1.0], true, lambert(0.05));
    for i in 0..5 {
        let center = Vec3::new(0.36 * i as f32 - 0.72, 0.2 + 0.07 * i as f32, 0.0);
        add_sphere(&mut scene, 12, 0.12, center, area_light(60.0));
    }
    look(&mut scene, Vec3::new(0.0, 2.2, 2.4), Vec3::new(0.0, 0.0, -0.1), 1.2);
    let stats = compare(Arc::new(scene), 100, 0.5);
    assert!(stats.emission_rays > Some(0.01) && stats.remaining < Some(0.5), "{stats:?}");
}

/// Pictures of a scene have the same means with and without adaptive sampling, and at most this fraction of the error.
fn compare(scene: Arc<Scene>, replicas: u32, remaining: f64) -> TechniqueStats {
    let stage = Stage::new(scene, Backend::Embree);
    let pixel = |r: &Rendered| r.film().pixels.iter().map(|p| f64::from(p.mean()[1])).collect::<Vec<_>>();
    let adaptive = settings();
    let even = adaptive.clone().with(Technique::Adaptive, Choice::Off);
    let reference = pixel(&stage.render(&RenderSettings { spp: Some(4096), seed: 1 << 20, ..even.clone() }));
    let mut found = None;
    let (mut means, mut errors) = ([Mean::default(), Mean::default()], [Mean::default(), Mean::default()]);
    for (i, settings) in [even, adaptive].into_iter().enumerate() {
        for seed in 0..replicas {
            let picture = stage.render(&RenderSettings { seed: seed + 1000 * i as u32, ..settings.clone() });
            assert!((0.93..=1.0).contains(&paths(&picture, 32)), "{}", picture.stats.paths);
            found = picture.stats.techniques[Technique::Adaptive].or(found);
            let pixels = pixel(&picture);
            means[i].add(pixels.iter().sum::<f64>() / pixels.len() as f64);
            let of = |(a, b): (&f64, &f64)| (a - b) * (a - b) / relative_to(*b);
            let error = pixels.iter().zip(&reference).map(of).sum::<f64>() / pixels.len() as f64;
            errors[i].add(error * if i == 0 { remaining } else { 1.0 });
        }
    }
    let apart = |[a, b]: &[Mean; 2]| a.z_to(b);
    // A false alarm in 10⁵.
    assert!(apart(&means).abs() < 4.5, "{} {}", means[0].mean, means[1].mean);
    // Less error, and surely: by chance once in 10⁵.
    assert!(apart(&errors) > 4.5, "{} {}", errors[0].mean, errors[1].mean);
    found.unwrap()
}

#[test]
fn a_pilot_that_finds_all_tiles_alike_gives_all_as_many_and_the_bits_of_none() {
    let mut scene = Scene::default();
    rectangle(&mut scene, 0.0, [-50.0, 50.0], [-50.0, 50.0], true, lambert(0.5));
    rectangle(&mut scene, 9.0, [-50.0, 50.0], [-50.0, 50.0], false, area_light(1.0));
    look(&mut scene, Vec3::new(0.0, 3.0, 0.01), Vec3::ZERO, 0.8);
    let stage = Stage::new(Arc::new(scene), Backend::Obvhs);
    let alike = stage.render(&settings());
    let even = stage.render(&settings().with(Technique::Adaptive, Choice::Off));
    assert_eq!(alike.stats.techniques[Technique::Adaptive].unwrap().range, Some([1.0; 2]));
    assert_eq!(format!("{:?}", alike.film()), format!("{:?}", even.film()));
    assert!(even.stats.techniques[Technique::Adaptive].is_none());
}

#[test]
fn few_paths_and_black_pictures_are_as_ever_and_time_stops_it_too() {
    let stage = Stage::new(floors(), Backend::Obvhs);
    let few = stage.render(&RenderSettings { spp: Some(15), ..settings() });
    assert!(few.stats.techniques[Technique::Adaptive].is_none() && few.paths_range() == (15, 15));
    let mut black = Scene::default();
    rectangle(&mut black, 0.0, [-1.0, 1.0], [-1.0, 1.0], true, lambert(0.5));
    look(&mut black, Vec3::new(0.0, 2.0, 1.0), Vec3::ZERO, 0.8);
    let black = Stage::new(Arc::new(black), Backend::Obvhs).render(&settings());
    assert_eq!((black.paths_range(), black.stop), ((32, 32), StopReason::Samples));
    // Against the clock, with a goal that comes first and with none.
    let goal = stage.render(&RenderSettings { time: Some(1e9), ..settings() });
    assert!(goal.stop == StopReason::Samples && (0.93..=1.0).contains(&paths(&goal, 32)), "{}", goal.stats.paths);
    let timed = stage.render(&RenderSettings { time: Some(2.0), spp: None, ..settings() });
    assert!(timed.stop == StopReason::Time && timed.paths_range().0 > 0, "{:?}", timed.stop);
    let enough = AtomicBool::new(false);
    let progress = |at: Progress| _ = enough.fetch_or(at.mean_spp > 64.0, Ordering::Relaxed);
    let endless = RenderSettings { time: Some(1e9), spp: None, ..settings() };
    let (fewest, most) = run(&stage.scene, &endless, RunOptions::new(&enough, &progress)).unwrap().paths_range();
    assert!(fewest > 0 && most > fewest, "{fewest} {most}");
}

#[test]
fn the_command_says_what_it_did_and_what_does_not_go_together() {
    let folder = Folder::new().with_scene("veach.glb", "veach.glb");
    let line = "render veach.glb --size 192x128 --adaptive -q";
    expect(&folder, &format!("{line} --spp 32 --aov samples --stats a.json --checkpoint 9 -o a.exr"), 0);
    let stats = read_json(&folder.join("a.json"));
    assert!(stats["adaptive"]["left"].as_f64().unwrap() < 0.97, "{stats}");
    assert_eq!(stats["settings"]["adaptive"], "on");
    let of = |name: &str| stats["samples"][name].as_f64().unwrap();
    assert!(of("pixel_min") < 20.0 && of("pixel_max") > 40.0 && (of("pixel_mean") - 32.0).abs() < 1.0, "{stats}");
    // Going on to more paths is right, but not the bits of one go, and says so.
    let said =
        expect(&folder, "render veach.glb --size 192x128 --adaptive --spp 64 --aov samples --resume -o a.exr", 0);
    assert!(said.contains("not bit-identical"), "{said}");
    let said = expect(&folder, &format!("{line} --noise 0.1 -o b.exr"), 64);
    assert!(said.contains("--noise") && said.contains("--adaptive"), "{said}");
    says(&folder, "render veach.glb --size 192x128 --spp 64 --aov samples --resume -o a.exr", 65, "adaptive");
}
