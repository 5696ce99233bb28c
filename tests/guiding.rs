//! Guiding: the same picture, the same bits, whatever the field holds.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use bismar::film::PixelStats;
use bismar::guiding::directions::{BINS, bins};
use bismar::guiding::{Field, NO_CELL, PathStatistics, TrainingSample, VertexRecord, learn};
use bismar::integrator::{PixelSums, PixelTask, Transport, Wave};
use bismar::lanes::{F, LANES, V3, mask};
use bismar::rays::Backend;
use bismar::render::prepass::guiding::learned;
use bismar::render::{
    Balance, Choice, Part, RenderSettings, Rendered, RunOptions, Saved, StudyOptions, Technique, TechniqueStats, run,
    transport,
};
use bismar::sampling::{SplitMix64, warp};
use bismar::scene::{Material, Scene, build};
use glam::{DVec3, Vec3};

use crate::helpers::stage::{Stage, add, area_light, closed_box, glass_hall, hall, lambert, look, rectangle};
use crate::helpers::statistics::Mean;

fn plaster() -> Material {
    Material { double_sided: true, ..lambert(0.7) }
}

/// A box with an area light above a thin shelf: all that the camera sees is lit by the ceiling.
fn cove() -> Arc<Scene> {
    let mut scene = Scene::default();
    closed_box(&mut scene, Vec3::new(-2.0, 0.0, -2.0), Vec3::new(2.0, 2.5, 2.0), plaster());
    rectangle(&mut scene, 2.0, [-0.8, 0.8], [-2.0, -1.2], true, lambert(0.6));
    rectangle(&mut scene, 1.99, [-0.8, 0.8], [-2.0, -1.2], false, lambert(0.6));
    rectangle(&mut scene, 2.05, [-0.3, 0.3], [-1.8, -1.5], true, area_light(40.0));
    look(&mut scene, Vec3::new(0.0, 1.0, 1.8), Vec3::new(0.0, 0.9, -1.0), 0.9);
    Arc::new(scene)
}

fn settings(guiding: Choice) -> RenderSettings {
    let even = RenderSettings::even().with(Technique::Guiding, guiding);
    RenderSettings { width: 36, height: 24, spp: Some(8), balance: Balance::Half, ..even }
}

/// Training samples of light that comes to the hall's floor, from directions that `toward` makes of random numbers.
fn training_samples(n: u32, toward: impl Fn(&mut SplitMix64) -> (Vec3, f32)) -> Vec<TrainingSample> {
    let mut random = SplitMix64(7);
    let one = |_| {
        let position = Vec3::new(6.0 * random.f32() - 3.0, 0.0, 6.0 * random.f32() - 3.0);
        let (wi, found) = toward(&mut random);
        TrainingSample {
            position,
            normal: Vec3::Y,
            wi,
            contribution: found,
            weight: found * found,
            pdf: 0.2,
            bsdf_pdf: 0.2,
            field_pdf: 0.0,
            light_pdf: 0.0,
            distance: f32::INFINITY,
        }
    };
    (0..n).map(one).collect()
}

/// What is learned in a scene.
fn learned_in(stage: &Stage, settings: &RenderSettings) -> (Option<Field>, TechniqueStats) {
    let unguided = transport(&stage.scene, settings);
    learned(&stage.scene, settings, &unguided, &AtomicBool::new(false)).unwrap()
}

#[test]
fn what_the_field_draws_has_the_density_that_it_says() {
    let training_samples = training_samples(40_000, |random| {
        let wi = warp::sphere(random.f32(), random.f32().powi(3));
        (Vec3::new(wi.x, wi.y.abs(), wi.z), random.f32().powi(6))
    });
    let (field, _) = learn(&training_samples, usize::MAX, false, 1.0, 1000);
    assert!(field.cells() > 20, "{}", field.cells());
    let mut random = SplitMix64(11);
    let mut worst: f64 = 0.0;
    for _ in 0..12 {
        let place = Vec3::new(5.0 * random.f32() - 2.5, 0.0, 5.0 * random.f32() - 2.5);
        let cell = field.guiding_cells(field.cells_at(V3::splat(place), V3::splat(Vec3::Y)))[0];
        assert_ne!(cell, NO_CELL);
        let cells = [cell; LANES];
        // The density on the square is the same all over a bin.
        let (n, mut expected, mut counts) = (200_000, [0.0; BINS], [0.0; BINS]);
        for _ in 0..20_000 {
            let w = V3::gather(std::array::from_fn(|_| warp::sphere(random.f32(), random.f32())));
            let density = field.density(cells, mask(LANES), w).to_array();
            for (bin, density) in bins(w).iter().zip(density) {
                let share = f64::from(density) / BINS as f64 * f64::from(n);
                let known = std::mem::replace(&mut expected[*bin as usize], share);
                assert!(known == 0.0 || (known - share).abs() <= 1e-4 * share, "{known} {share}");
            }
        }
        for _ in 0..n / LANES as u32 {
            let numbers = [(); 2].map(|()| F::from(std::array::from_fn(|_| random.f32())));
            for bin in bins(field.draw(cells, mask(LANES), numbers[0], numbers[1]).0) {
                counts[bin as usize] += 1.0;
            }
        }
        let total = expected.iter().sum::<f64>() / f64::from(n);
        assert!((total - 1.0).abs() < 1e-4, "the density is {total} in all");
        let (mut chi2, mut freedom) = (0.0, -1.0);
        for (count, expected) in counts.iter().zip(expected).filter(|(_, expected)| *expected > 5.0) {
            chi2 += (count - expected) * (count - expected) / expected;
            freedom += 1.0;
        }
        worst = worst.max((chi2 - freedom) / f64::sqrt(2.0 * freedom));
    }
    // Twelve tests at six standard deviations: a false alarm in 10⁷.
    assert!(worst < 6.0, "{worst}");
}

/// Means of the picture's green without a field and with one, that differ in seeds.
fn compared(stage: &Stage, settings: &RenderSettings, field: &Field, replicas: u32) -> [Mean; 2] {
    let mut means = [Mean::default(), Mean::default()];
    for (mean, field) in means.iter_mut().zip([None, Some(field)]) {
        for seed in 0..replicas {
            let settings = RenderSettings { seed: seed + if field.is_some() { 1000 } else { 0 }, ..settings.clone() };
            let transport = transport(&stage.scene, &settings);
            let transport = Transport { proposal: transport.proposal.guided(field), ..transport };
            let counts = bismar::balance::Counts::half(4);
            let task = |i: u32| PixelTask::first([i % settings.width, i / settings.width], counts, i);
            let tasks: Vec<_> = (0..settings.width * settings.height).map(task).collect();
            let mut stats = vec![PixelStats::default(); tasks.len()];
            Wave::default().run(&transport, &tasks, &mut PixelSums::new(&mut stats));
            mean.add(stats.iter().map(|s| s.sum[1] / f64::from(s.samples)).sum::<f64>() / stats.len() as f64);
        }
    }
    means
}

#[test]
fn a_field_of_lies_changes_no_mean() {
    // What fields learn in bad luck: a caustic from one side, light from below alone, one firefly among nothing, a light
    // that was never seen (the area light above), no training samples at all.
    let fields = [
        training_samples(20_000, |_| (Vec3::new(0.9, 0.1, 0.2).normalize(), 1.0)),
        training_samples(20_000, |random| (warp::sphere(0.5 + 0.5 * random.f32(), random.f32()).normalize(), 1.0)),
        training_samples(20_000, |random| (Vec3::Y, if random.f32() < 1e-4 { 1e12 } else { 1e-6 })),
        training_samples(20_000, |random| (Vec3::new(random.f32() - 0.5, 0.05, random.f32() - 0.5).normalize(), 1.0)),
        Vec::new(),
    ]
    .map(|training_samples| learn(&training_samples, usize::MAX, false, 1.0, 100).0);
    // And of how often to go on: nothing was found anywhere, by light samples, by others, by one of them only.
    let records = |found: [f32; 2]| {
        (0..2000).map(move |i| VertexRecord {
            position: Vec3::new(i as f32 / 400.0 - 2.5, 0.0, 0.0),
            normal: Vec3::Y,
            squared_contributions: found,
        })
    };
    let roulettes = [
        records([0.0, 0.0]).collect(),
        records([1e-3, 1e-6]).collect(),
        records([1e-6, 1e-2]).collect(),
        records([0.0, 0.0]).take(1999).chain(records([1e12, 1e12]).skip(1999)).collect(),
        Vec::new(),
    ];
    let paths = PathStatistics { cost: 6.0, variance: 1.0, inverse: 1.0 };
    let fields: Vec<_> = std::iter::zip(fields, roulettes)
        .map(|(mut field, records)| {
            field.learn_roulette(&records, paths);
            field
        })
        .collect();
    for (scene, name) in [(hall(), "hall"), (glass_hall(), "glass hall"), (cove(), "cove")] {
        let stage = Stage::new(scene, Backend::Obvhs);
        let settings = RenderSettings { width: 24, height: 16, ..settings(Choice::Off) };
        for (i, field) in fields.iter().enumerate() {
            let means = compared(&stage, &settings, field, 40);
            // Fifteen tests of about normal means: a false alarm in 10⁴.
            let z = means[0].z_to(&means[1]);
            assert!(z.abs() < 4.5, "{name}, field {i}: {} {}, z {z}", means[0].mean, means[1].mean);
        }
    }
}

#[test]
fn a_field_that_was_learned_changes_no_mean_and_takes_noise_away() {
    let stage = Stage::new(cove(), Backend::Embree);
    let settings = settings(Choice::On);
    let (field, stats) = learned_in(&stage, &settings);
    let means = compared(&stage, &settings, field.as_ref().unwrap(), 60);
    assert!(means[0].z_to(&means[1]).abs() < 4.5, "{} {}", means[0].mean, means[1].mean);
    // Of 60 replicas each, a ratio of variances below 0.75 by chance alone is 1 in 7; that the field takes half is seen.
    let [without, with] = means.map(|mean| mean.standard_error().powi(2));
    assert!(with < 0.75 * without, "{with} {without}");
    assert!(stats.remaining < Some(0.8), "{stats:?}");
}

/// A room behind blinds, whose light comes from a panel beyond them. Slats of this depth, 10 cm apart, begin at these heights
/// of their own, outside and inside.
fn blinds(depth: f32, [outer, inner]: [f32; 2]) -> Arc<Scene> {
    let mut scene = Scene::default();
    closed_box(&mut scene, Vec3::new(-2.0, 0.0, -2.0), Vec3::new(2.0, 2.5, 2.0), plaster());
    for slat in 0..25 {
        let (inner, outer, x) = (0.1 * slat as f32 + inner, 0.1 * slat as f32 + outer, 1.3 + depth);
        let points = vec![[1.3, inner, -2.0], [x, outer, -2.0], [x, outer, 2.0], [1.3, inner, 2.0]];
        add(&mut scene, points, vec![[0, 1, 2], [0, 2, 3]], plaster());
    }
    let panel = vec![[1.95, 0.0, -2.0], [1.95, 0.0, 2.0], [1.95, 2.5, 2.0], [1.95, 2.5, -2.0]];
    add(&mut scene, panel, vec![[0, 1, 2], [0, 2, 3]], area_light(20.0));
    look(&mut scene, Vec3::new(0.8, 1.3, 1.5), Vec3::new(-1.5, 1.0, -1.5), 0.9);
    Arc::new(scene)
}

/// The estimate for a room, and what `auto` has decided about it.
fn estimated_and_decided(stage: &Stage) -> (f64, (Option<Field>, TechniqueStats)) {
    let settings = |guiding| RenderSettings { width: 320, height: 240, spp: Some(64), ..settings(guiding) };
    let [estimated, decided] = [Choice::On, Choice::Auto].map(|guiding| learned_in(stage, &settings(guiding)));
    (estimated.1.remaining.unwrap(), decided)
}

#[test]
fn a_room_behind_blinds_is_guided() {
    let stage = Stage::new(blinds(0.1, [-0.02, 0.12]), Backend::Embree);
    let (estimated, (field, stats)) = estimated_and_decided(&stage);
    assert!(estimated > 0.25, "{estimated}: nothing was in doubt");
    let means = compared(&stage, &settings(Choice::Off), field.as_ref().expect("a field"), 240);
    assert!(means[0].z_to(&means[1]).abs() < 4.5, "{} {}", means[0].mean, means[1].mean);
    let [without, with] = means.map(|mean| mean.standard_error().powi(2));
    assert!(with < 0.75 * without, "{with} {without} {stats:?}");
}

/// The estimate takes paths for independent. Here stratified ones have nearly as little error without a field.
#[test]
fn the_trial_sees_what_stratified_points_gain_without_a_field() {
    let (estimated, (_, stats)) = estimated_and_decided(&Stage::new(blinds(0.03, [0.012, 0.088]), Backend::Embree));
    assert!(stats.remaining > Some(1.15 * estimated), "{estimated} {stats:?}");
}

/// A room with twelve bulbs, each in an opaque shade that is open below: every surface sees few of them.
fn pendants() -> Arc<Scene> {
    let mut scene = Scene::default();
    closed_box(&mut scene, Vec3::new(-3.2, 0.0, -3.6), Vec3::new(3.2, 2.8, 3.6), plaster());
    let corners = |y: f64, half: f64| {
        [[-half, -half], [half, -half], [half, half], [-half, half]].map(|[x, z]| DVec3::new(x, y, z))
    };
    let (low, high) = (corners(0.0, 0.17), corners(0.2, 0.05));
    let sides = (0..4).map(|k| build::quad([low[k], low[(k + 1) % 4], high[(k + 1) % 4], high[k]]));
    let shade = sides.fold(build::quad(high), |shade, side| shade.and(&side));
    let bulb = build::sphere(0.035, 8).translated(0.1 * DVec3::Y);
    for i in 0..12 {
        let at = DVec3::new(2.0 * f64::from(i % 3) - 2.0, 1.6, 1.6 * f64::from(i / 3) - 2.4);
        build::add_shape(&mut scene, &shade.clone().translated(at), plaster());
        build::add_shape(&mut scene, &bulb.clone().translated(at), area_light(120.0));
    }
    look(&mut scene, Vec3::new(-2.7, 1.9, 3.3), Vec3::new(0.3, 0.8, -1.2), 1.05);
    Arc::new(scene)
}

#[test]
fn rounds_learn_what_those_before_them_found_useless() {
    let stage = Stage::new(pendants(), Backend::Embree);
    let automatic = RenderSettings { width: 320, height: 240, spp: Some(64), ..settings(Choice::On) };
    let left = |seed: u32| {
        let (field, stats) = learned_in(&stage, &RenderSettings { seed, ..automatic.clone() });
        assert!(field.is_some(), "seed {seed}: {stats:?}");
        stats.remaining.unwrap()
    };
    // With the probabilities that early rounds find best, many cells would learn nothing more.
    let left: Vec<_> = (0..3).map(left).collect();
    assert!(left.iter().sum::<f64>() < 3.0 * 0.57, "{left:?}");
}

#[test]
fn nothing_is_learned_where_nothing_shines() {
    let mut scene = Scene::default();
    rectangle(&mut scene, 0.0, [-2.0, 2.0], [-2.0, 2.0], true, lambert(0.5));
    add(&mut scene, vec![[0.0; 3], [0.1, 0.0, 0.0], [0.0, 0.1, 0.0]], vec![[0, 1, 2]], area_light(1e-30));
    look(&mut scene, Vec3::new(0.0, 1.0, 3.0), Vec3::ZERO, 0.8);
    let stage = Stage::new(Arc::new(scene), Backend::Obvhs);
    assert!(stage.green(&settings(Choice::On)).iter().all(|g| g.is_finite() && *g < 1e-20));
    let automatic = RenderSettings { spp: Some(16), ..settings(Choice::Auto) };
    let rendered = stage.render(&automatic);
    assert!(!rendered.stats.techniques[Technique::Guiding].unwrap().on);
}

#[test]
fn a_guided_picture_has_the_same_bits_on_any_threads_in_any_window_and_part() {
    let stage = Stage::new(cove(), Backend::Embree);
    let settings = settings(Choice::On);
    let sums = |rendered: &Rendered| {
        let film = rendered.film();
        let [x0, y0, x1, _] = film.window;
        let place = move |i: usize| (x0 + i as u32 % (x1 - x0), y0 + i as u32 / (x1 - x0));
        film.pixels.iter().enumerate().map(|(i, p)| (place(i), p.sum)).collect::<Vec<_>>()
    };
    let one = stage.render_on(1, &settings);
    assert!(one.stats.techniques[Technique::Guiding].unwrap().on);
    assert_eq!(sums(&one), sums(&stage.render_on(3, &settings)));
    let whole = sums(&one);
    let crop = RenderSettings { crop: Some([17, 3, 33, 20]), ..settings.clone() };
    for (at, sum) in sums(&stage.render_on(2, &crop)) {
        assert_eq!(whole.iter().find(|pixel| pixel.0 == at).unwrap().1, sum, "{at:?}");
    }
    let part: Part = "2/3".parse().unwrap();
    let part = stage.render_on(2, &RenderSettings { part: Some(part), ..settings.clone() });
    for tile in &part.tiles {
        let same = one.tiles.iter().find(|other| other.grid_position() == tile.grid_position()).unwrap();
        assert!((0..tile.pixels()).all(|i| tile.at(i).0.sum == same.at(i).0.sum));
    }
    let unguided = settings.with(Technique::Guiding, Choice::Off);
    assert_ne!(whole, sums(&stage.render_on(2, &unguided)));
}

#[test]
fn a_guided_picture_that_is_gone_on_with_has_the_bits_of_one_in_one_go() {
    let stage = Stage::new(cove(), Backend::Embree);
    let longer = RenderSettings { spp: Some(32), ..settings(Choice::On) };
    let stop = AtomicBool::new(false);
    let study = StudyOptions { max_passes: Some(1), ..Default::default() };
    let options = RunOptions { study, ..RunOptions::new(&stop, &|_| ()) };
    let Rendered { tiles, stats, goals, .. } = run(&stage.scene, &longer, options).unwrap();
    assert!((0..tiles[0].pixels()).all(|i| tiles[0].at(i).0.samples < 32));
    let from = Some(Saved { tiles, stats, goals });
    let options = RunOptions { from, ..RunOptions::new(&stop, &|_| ()) };
    let (parts, whole) = (run(&stage.scene, &longer, options).unwrap(), stage.render_on(2, &longer));
    for (a, b) in parts.tiles.iter().zip(&whole.tiles) {
        assert!((0..a.pixels()).all(|i| a.at(i).0.samples == 32 && a.at(i).0.sum == b.at(i).0.sum));
    }
}

#[test]
fn a_field_is_no_larger_than_it_may_be() {
    let stage = Stage::new(hall(), Backend::Embree);
    for memory in [1 << 14, 1 << 19, 1 << 24] {
        let settings = RenderSettings { guiding_memory: Some(memory), ..settings(Choice::On) };
        let bytes = learned_in(&stage, &settings).0.map_or(0, |field| field.bytes());
        assert!(bytes as u64 <= memory, "{bytes} of {memory}");
    }
}
