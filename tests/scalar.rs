//! The wavefront integrator against the scalar one, which shares neither queues nor sorting with it.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use bismar::balance::{Balance, Contribution, Counts, Heuristic, Observer, Shares};
use bismar::color::luminance;
use bismar::film::{Peak, PixelStats};
use bismar::integrator::clients::{ContributionColumns, Contributions};
use bismar::integrator::{EmissionRayCounts, PixelSums, PixelTask, Proposal, Transport, Wave};
use bismar::light::{LearnedLights, LightProposal, LightSampleRecord};
use bismar::rays::Backend;
use bismar::render::prepass::guiding::learned;
use bismar::render::{Choice, GlassShadows, RenderSettings, Technique, transport};
use bismar::scene::{PunctualKind, Scene};
use glam::Vec3;

use crate::helpers::stage::{Stage, glass_hall, globe_hall, hall, moving_hall, pool, punctual};
use crate::oracle;

#[derive(Default)]
struct Radiance(Vec<Vec3>);

impl Observer for Radiance {
    fn contribution(&mut self, _found: &Contribution) {}

    fn path(&mut self, _pixel: u32, radiance: Vec3) {
        self.0.push(radiance);
    }
}

/// Gives the scene's lights a size, and it a spot that touches the floor and a sun.
fn sized(scene: Arc<Scene>) -> Arc<Scene> {
    let mut scene = Arc::unwrap_or_clone(scene);
    let spot = PunctualKind::Spot { inner: 0.5, outer: 1.4 };
    scene.lights.push(punctual(spot, 1.0, Vec3::new(1.2, 0.3, 0.4), Vec3::new(-0.6, 0.8, 0.0)));
    scene.lights.push(punctual(PunctualKind::Directional, 0.5, Vec3::ZERO, Vec3::new(0.6, -0.8, 0.0)));
    scene.lights.iter_mut().for_each(|light| light.size = 0.35);
    Arc::new(scene)
}

#[test]
fn each_path_of_a_wave_is_the_scalar_path() {
    use GlassShadows::Straight;
    // Sums of the same terms in another order differ by ROUNDINGS of the largest term; paths have at most 100 terms here.
    const ROUNDINGS: f32 = 100.0 * f32::EPSILON;
    for (scene, backend, balance, max_depth, least_lit, guiding, learns, glass_shadows) in [
        (hall(), Backend::Obvhs, Balance::Half, 2, 6000, Choice::Off, false, Straight),
        (hall(), Backend::Obvhs, Balance::Power, 8, 6000, Choice::Off, false, Straight),
        (hall(), Backend::Obvhs, Balance::Max, 5, 6000, Choice::Off, false, Straight),
        (hall(), Backend::Embree, Balance::Half, 8, 6000, Choice::Off, false, Straight),
        (hall(), Backend::Obvhs, Balance::Progressive, 8, 6000, Choice::Off, false, Straight),
        (glass_hall(), Backend::Obvhs, Balance::Half, 12, 4000, Choice::Off, false, Straight),
        (glass_hall(), Backend::Obvhs, Balance::Power, 3, 4000, Choice::Off, false, Straight),
        (hall(), Backend::Obvhs, Balance::Half, 8, 6000, Choice::On, false, Straight),
        (glass_hall(), Backend::Obvhs, Balance::Power, 12, 4000, Choice::On, false, Straight),
        (moving_hall(), Backend::Embree, Balance::Half, 8, 6000, Choice::Off, false, Straight),
        (moving_hall(), Backend::Embree, Balance::Power, 3, 6000, Choice::Off, false, Straight),
        (moving_hall(), Backend::Embree, Balance::Half, 8, 6000, Choice::On, false, Straight),
        (glass_hall(), Backend::Obvhs, Balance::Half, 6, 4000, Choice::Off, true, Straight),
        (sized(hall()), Backend::Obvhs, Balance::Half, 8, 6000, Choice::Off, false, Straight),
        (sized(glass_hall()), Backend::Obvhs, Balance::Max, 12, 4000, Choice::On, false, Straight),
        (sized(glass_hall()), Backend::Obvhs, Balance::Half, 6, 4000, Choice::Off, true, Straight),
        (sized(globe_hall()), Backend::Obvhs, Balance::Power, 8, 4000, Choice::Off, false, Straight),
        (sized(globe_hall()), Backend::Obvhs, Balance::Power, 8, 4000, Choice::On, false, GlassShadows::Off),
        (sized(moving_hall()), Backend::Embree, Balance::Half, 8, 6000, Choice::Off, false, Straight),
        (globe_hall(), Backend::Obvhs, Balance::Half, 12, 4000, Choice::Off, false, Straight),
        (globe_hall(), Backend::Obvhs, Balance::Power, 3, 4000, Choice::Off, false, Straight),
        (globe_hall(), Backend::Obvhs, Balance::Power, 8, 4000, Choice::On, false, Straight),
        (sized(pool()), Backend::Obvhs, Balance::Half, 8, 4000, Choice::Off, false, Straight),
        (sized(pool()), Backend::Obvhs, Balance::Power, 6, 4000, Choice::On, false, GlassShadows::Off),
    ] {
        let stage = Stage::new(scene, backend);
        let even = RenderSettings::even().with(Technique::Guiding, guiding);
        let settings = RenderSettings { width: 20, height: 15, balance, max_depth, ..even };
        // Without effect where there are no bodies of smooth glass.
        let settings = RenderSettings { glass_shadows, ..settings };
        let limit = |most| Some(most).filter(|_| balance == Balance::Max);
        let settings = RenderSettings { clamp_direct: limit(0.5), clamp_indirect: limit(0.1), ..settings };
        let unguided = transport(&stage.scene, &settings);
        let learned = learned(&stage.scene, &settings, &unguided, &AtomicBool::new(false));
        let field = learned.as_ref().and_then(|(field, _)| field.as_ref());
        assert_eq!(field.is_some(), guiding == Choice::On);
        // A third of the area lights contribute nothing anywhere.
        let light_samples = || -> Vec<_> {
            let light_sample_record = |i: u32| {
                let position =
                    Vec3::new((i % 61) as f32 / 10.0 - 3.0, (i % 17) as f32 / 17.0, (i % 53) as f32 / 10.0 - 2.6);
                LightSampleRecord { position, normal: Vec3::Y, emitter: i % 40, pixel: 0, contribution: (i % 3) as f32 }
            };
            (0..4000).filter(|_| learns).map(light_sample_record).collect()
        };
        let area = stage.scene.lights.area.as_ref();
        let area = area.and_then(|area| LearnedLights::learn(area.tree(), &light_samples(), 1.0));
        assert_eq!(area.is_some(), learns);
        let lights = LightProposal { learned: area.as_ref(), ..unguided.proposal.lights };
        // Camera rays for emission in two of three pixels.
        let emission_rays = EmissionRayCounts::new(20, (0..300).map(|i| [1, 4, 2][i % 3]).collect());
        let emission_rays = Some(&emission_rays).filter(|_| max_depth > 5);
        let transport = Transport { proposal: Proposal { lights, field, emission_rays, reuse: None }, ..unguided };
        let paths = 24;
        // Uneven sample counts, allocated to environment and area lights, with MIS weights of other counts.
        let counts = Counts::from_shares(Shares { light_share: 0.7, environment_share: Some(0.4) }, paths);
        let weighed = Counts::from_shares(Shares { light_share: 0.6, environment_share: Some(0.5) }, 2 * paths);
        let task = |i: u32| PixelTask {
            x: i % 20,
            y: i / 20,
            first_path: 8,
            first_light: 11,
            first_environment: 5,
            first_bsdf: 7,
            counts,
            weighed,
            number: i,
            class: 0,
        };
        let tasks: Vec<_> = (0..300).map(task).collect();
        let mut stats = vec![PixelStats::default(); tasks.len()];
        let mut seen = Radiance::default();
        let mut peaks = vec![Peak::default(); tasks.len()];
        let pixels = PixelSums { stats: &mut stats, peaks: &mut peaks };
        let contributions = Contributions { observer: &mut seen, columns: &mut ContributionColumns::default() };
        Wave::default().run(&transport, &tasks, &mut (pixels, contributions));
        assert_eq!(seen.0.len(), tasks.len() * paths as usize);
        for (peak, (task, paths)) in peaks.iter().zip(tasks.iter().zip(seen.0.chunks(paths as usize))) {
            let of = |path: u32| luminance(paths[(path - task.first_path) as usize]);
            let most = paths.iter().map(|radiance| luminance(*radiance)).fold(0.0, f32::max);
            assert!(peak.luminance == most && (most == 0.0 || of(peak.path) == most), "{peak:?}");
        }
        // Walks end up to 1e-5 beside the light, wherever rounding leads them, and geometric terms magnify that.
        let mut errors = [0; 8];
        let mut differing = 0;
        let mut lit = 0;
        for (i, wave) in seen.0.iter().enumerate() {
            let (task, path) = (&tasks[i / paths as usize], (i % paths as usize) as u32);
            let scalar = oracle::trace(&transport, task, path);
            lit += u32::from(scalar != Vec3::ZERO);
            let error = (*wave - scalar).abs().max_element() / scalar.max_element().max(1.0);
            differing += u32::from(error > ROUNDINGS);
            (0..8).for_each(|i| errors[i] += u32::from(error > 10f32.powi(-(i as i32))));
        }
        assert!(lit > least_lit, "{lit}");
        // On triangle edges, Embree's packets may hit where a single ray misses: a few paths in ten thousand.
        // Rounding may move a point on a cell boundary to the neighbouring cell: as few.
        // Smooth bodies magnify the rounding of points over many bounces: as few.
        let smooth = stage.scene.materials.has_smooth_bodies;
        let rounds = backend == Backend::Embree || guiding == Choice::On || learns || smooth;
        let allowed = if rounds { 7 } else { 0 };
        let what = format!("{backend:?} {balance:?} {max_depth} {glass_shadows:?}");
        assert!(differing <= allowed, "{what}: {differing} of {lit} lit paths, {errors:?} beyond powers of ten");
        assert_eq!(transport.heuristic, balance.method().heuristic());
        assert!(balance != Balance::Power || transport.heuristic == Heuristic::Power);
    }
}
