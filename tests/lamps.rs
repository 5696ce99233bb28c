//! Lights that are chosen by what light samples of a pre-pass found: the same picture, less noise where walls hide most of them.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use bismar::film::PixelStats;
use bismar::integrator::{PixelSums, PixelTask, Proposal, Transport, Wave};
use bismar::light::{LearnedLights, LightProposal, LightSampleRecord};
use bismar::rays::Backend;
use bismar::render::prepass::SEED;
use bismar::render::prepass::learned_lights::LightsLearner;
use bismar::render::prepass::rounds;
use bismar::render::{
    Balance, Part, RenderSettings, RenderStats, Rendered, RunOptions, Saved, Technique, run, transport,
};
use bismar::sampling::SplitMix64;
use bismar::scene::Scene;
use glam::Vec3;

use crate::helpers::stage::{Stage, area_light, closed_box, glass_hall, lambert, look, rectangle};
use crate::helpers::statistics::{Mean, z_limit};

/// A room with a dim area light, next to one with a bright one.
fn house() -> Arc<Scene> {
    let mut scene = Scene::default();
    for (x, radiance) in [(0.0, 4.0), (4.2, 400.0)] {
        let (low, high) = (Vec3::new(x - 2.0, 0.0, -2.0), Vec3::new(x + 2.0, 2.5, 2.0));
        closed_box(&mut scene, low, high, bismar::scene::Material { double_sided: true, ..lambert(0.6) });
        rectangle(&mut scene, 2.4, [x - 0.5, x + 0.5], [-0.5, 0.5], false, area_light(radiance));
    }
    look(&mut scene, Vec3::new(0.0, 1.4, 1.9), Vec3::new(0.0, 0.8, -1.0), 0.9);
    Arc::new(scene)
}

fn settings(balance: Balance) -> RenderSettings {
    RenderSettings { width: 36, height: 24, spp: Some(16), max_depth: 4, balance, ..RenderSettings::even() }
}

/// Pixels' means and variances of the green of pictures that know of lights what is `learned`.
fn pictures(stage: &Stage, learned: Option<&LearnedLights>, first: u32, replicas: u32) -> [Mean; 2] {
    let settings = settings(Balance::Half);
    let mut means = vec![Mean::default(); (settings.width * settings.height) as usize];
    let mut whole = Mean::default();
    for seed in first..first + replicas {
        let settings = RenderSettings { seed, ..settings.clone() };
        let transport = transport(&stage.scene, &settings);
        let lights = LightProposal { learned, ..transport.proposal.lights };
        let transport = Transport { proposal: Proposal { lights, ..transport.proposal }, ..transport };
        let counts = bismar::balance::Counts::half(4);
        let task = |i: u32| PixelTask::first([i % settings.width, i / settings.width], counts, i);
        let tasks: Vec<_> = (0..settings.width * settings.height).map(task).collect();
        let mut stats = vec![PixelStats::default(); tasks.len()];
        Wave::default().run(&transport, &tasks, &mut PixelSums::new(&mut stats));
        let green: Vec<_> = stats.iter().map(|s| s.sum[1] / f64::from(s.samples)).collect();
        means.iter_mut().zip(&green).for_each(|(mean, green)| mean.add(*green));
        whole.add(green.iter().sum::<f64>() / green.len() as f64);
    }
    let mut variances = Mean::default();
    means.iter().for_each(|mean| variances.add(mean.standard_error().powi(2)));
    [whole, variances]
}

#[test]
fn what_a_pilot_learns_of_lamps_changes_no_mean_and_takes_noise_away() {
    let stage = Stage::new(house(), Backend::Embree);
    let settings = settings(Balance::Progressive);
    let mut found = LightsLearner::new(&stage.scene, &settings).unwrap();
    let transport = Transport { seed: SEED, ..transport(&stage.scene, &settings) };
    rounds::run(&stage.scene, &settings, &transport, &mut [&mut found], &AtomicBool::new(false)).unwrap();
    let lights = found.lights.as_ref().unwrap();
    assert!(lights.bytes() < 1 << 20);
    let [without, with] = [(None, 0), (Some(lights), 500)].map(|(lights, seed)| pictures(&stage, lights, seed, 200));
    assert!(without[0].z_to(&with[0]).abs() < z_limit(1), "{without:?} {with:?}");
    // The tree takes two light samples of three toward the area light next door, and what was learned but one. Variances of 864 pixels are
    // known to a few per cent.
    assert!(with[1].mean < 0.75 * without[1].mean, "{} {}", with[1].mean, without[1].mean);
    let rendered = stage.render_on(2, &settings);
    let stats = rendered.stats.techniques[Technique::LearnedLights].unwrap();
    assert!(stats.on && stats.cells == Some(lights.cells()) && stats.remaining < Some(0.8), "{stats:?}");
}

#[test]
fn lies_about_lamps_change_no_mean() {
    for (scene, name) in [(house(), "house"), (glass_hall(), "glass hall")] {
        let stage = Stage::new(scene, Backend::Obvhs);
        let area = stage.scene.lights.area.as_ref().unwrap();
        let (tree, area_lights) = (area.tree(), area.levels().exp2().round() as u32);
        let without = pictures(&stage, None, 0, 60)[0];
        // Only the last area light shines; only the first, and from everywhere but a corner; next to nothing but for a firefly.
        let wrong: [&dyn Fn(Vec3, u32, f32) -> f32; 3] = [
            &|_, area_light, _| if area_light + 1 == area_lights { 1.0 } else { 0.0 },
            &|p, area_light, _| if area_light == 0 && p.x > -1.0 { 1.0 } else { 0.0 },
            &|_, _, chance| if chance < 1e-3 { 1e12 } else { 1e-9 },
        ];
        for (i, learned) in wrong.iter().enumerate() {
            let mut random = SplitMix64(5);
            let light_sample_record = |n: u32| {
                let position = Vec3::new(5.0 * random.f32() - 2.5, 2.5 * random.f32(), 5.0 * random.f32() - 2.5);
                let (emitter, chance) = (n % area_lights, random.f32());
                let contribution = learned(position, emitter, chance);
                LightSampleRecord { position, normal: Vec3::Y, emitter, pixel: 0, contribution }
            };
            let light_sample_records: Vec<_> = (0..20_000).map(light_sample_record).collect();
            let lights = LearnedLights::learn(tree, &light_sample_records, 1.0).unwrap();
            let with = pictures(&stage, Some(&lights), 500 * (i as u32 + 1), 60)[0];
            assert!(without.z_to(&with).abs() < z_limit(6), "{name}, learned {i}: {without:?} {with:?}");
        }
    }
}

#[test]
fn where_lights_are_learned_bits_are_the_same_on_any_threads_in_any_window_part_and_session() {
    let learned = |stats: &RenderStats| stats.techniques[Technique::LearnedLights].unwrap();
    let (stage, settings) = (&Stage::new(house(), Backend::Embree), &settings(Balance::Progressive));
    let one = stage.render_on(1, settings);
    assert!(learned(&one.stats).on);
    let same = |other: &Rendered| {
        for tile in &other.tiles {
            let own = one.tiles.iter().find(|own| own.grid_position() == tile.grid_position()).unwrap();
            assert!((0..tile.pixels()).all(|i| tile.at(i).0.sum == own.at(i).0.sum), "{:?}", other.settings);
        }
    };
    same(&stage.render_on(3, settings));
    same(&stage.render_on(2, &RenderSettings { crop: Some([16, 0, 32, 16]), ..settings.clone() }));
    let part: Part = "2/3".parse().unwrap();
    same(&stage.render_on(2, &RenderSettings { part: Some(part), ..settings.clone() }));
    // Going on to more paths has learned the same as well.
    let go_on = |Rendered { tiles, stats, goals, .. }: Rendered| {
        let (stop, from) = (AtomicBool::new(false), Some(Saved { tiles, stats, goals }));
        let options = RunOptions { from, ..RunOptions::new(&stop, &|_| ()) };
        learned(&run(&stage.scene, settings, options).unwrap().stats)
    };
    let shorter = stage.render_on(2, &RenderSettings { spp: Some(8), ..settings.clone() });
    let whole = stage.render_on(2, settings);
    let of_whole = learned(&whole.stats);
    assert_eq!(go_on(shorter).cells, of_whole.cells);
    // Nothing is left to do: nothing is learned again, and what was found is still said.
    assert_eq!(go_on(whole).seconds, of_whole.seconds);
}
