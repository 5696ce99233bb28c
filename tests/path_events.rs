//! What a wave tells its clients: everything that it adds to a path, and every ray once.

use bismar::balance::Counts;
use bismar::film::{ExtraSums, PixelStats};
use bismar::integrator::clients::{AovColumns, Aovs};
use bismar::integrator::data::queues::{PathRays, ShadowRays};
use bismar::integrator::data::requests::RequestPacket;
use bismar::integrator::data::vertices::Vertices;
use bismar::integrator::events::{FoundEmission, LightSamplePacket, ScatteredPacket, UnoccludedLight};
use bismar::integrator::{PathEvents, PixelSums, PixelTask, Wave, WaveContext};
use bismar::rays::{Backend, HitBatch, MISS};
use bismar::render::{RenderSettings, transport};
use glam::Vec3;

use crate::helpers::stage::{Stage, glass_hall, hall};

/// Adds up what it is told.
#[derive(Default)]
struct Ledger {
    /// By path, its radiance.
    radiance: Vec<Vec3>,
    /// By number of a ray, its path.
    path_of: Vec<u32>,
    /// Numbers of the rays of the next depth, and their directions.
    announced: Vec<(u32, Vec3)>,
    covered: u32,
    light_samples: usize,
    shadow_rays: usize,
    waves: u32,
}

impl PathEvents for Ledger {
    fn begin(&mut self, at: &WaveContext) {
        self.radiance = vec![Vec3::ZERO; at.paths.len()];
        self.path_of.clear();
        self.announced.clear();
    }

    fn hits(&mut self, at: &WaveContext, rays: &PathRays, hits: &HitBatch) {
        assert_eq!(rays.first as usize, self.path_of.len());
        if at.depth == 0 {
            self.covered += hits.mesh[..rays.len].iter().filter(|mesh| **mesh != MISS).count() as u32;
            assert_eq!(rays.path[..rays.len], (0..at.paths.len() as u32).collect::<Vec<_>>());
        } else {
            let rays = (0..rays.len).map(|row| (rays.first + row as u32, rays.rays.direction(row)));
            assert_eq!(rays.collect::<Vec<_>>(), self.announced);
        }
        self.announced.clear();
        self.path_of.extend(&rays.path[..rays.len]);
    }

    fn emission(&mut self, _at: &WaveContext, rays: &PathRays, found: &FoundEmission) {
        assert!(found.radiance != Vec3::ZERO && found.pdf[0] * found.pdf[1] == 0.0);
        self.radiance[rays.path[found.ray as usize] as usize] += found.radiance;
    }

    fn light_samples(&mut self, _at: &WaveContext, _v: &Vertices, packet: &RequestPacket, samples: &LightSamplePacket) {
        self.light_samples += packet.len;
        self.shadow_rays += samples.survivors.len;
    }

    fn scattered(&mut self, at: &WaveContext, vertices: &Vertices, packet: &RequestPacket, samples: &ScatteredPacket) {
        let survivors = &samples.survivors;
        let wi = survivors.compress_v3(samples.wi);
        let path = survivors.compress_bits(packet.path_ids.path).to_array();
        let arrived = survivors.compress_bits(bismar::lanes::load_bits(&vertices.ray, &packet.rows)).to_array();
        for lane in 0..survivors.len {
            assert_eq!(self.path_of[arrived[lane] as usize], path[lane]);
            assert_eq!(at.depth == 0, (arrived[lane] as usize) < at.paths.len());
            self.announced.push((samples.first_ray + lane as u32, wi.lane(lane)));
        }
    }

    fn unoccluded(&mut self, _at: &WaveContext, shadows: &ShadowRays, found: &UnoccludedLight) {
        let path = shadows.path[found.row];
        assert_eq!(self.path_of[shadows.ray[found.row] as usize], path);
        assert!(found.scale > 0.0 && found.scale <= 1.0);
        self.radiance[path as usize] += found.radiance;
    }

    fn end(&mut self, at: &WaveContext, radiance: &[Vec3]) {
        assert_eq!(self.radiance, radiance);
        assert_eq!(at.by_pixel(radiance).map(|(_, paths)| paths.len()).sum::<usize>(), radiance.len());
        self.waves += 1;
    }
}

#[test]
fn events_are_all_that_a_wave_adds_and_clients_do_not_see_each_other() {
    for (scene, limit) in [(hall(), None), (glass_hall(), Some(0.5))] {
        let stage = Stage::new(scene, Backend::Obvhs);
        let settings = RenderSettings { width: 24, height: 18, max_depth: 9, ..RenderSettings::even() };
        let settings = RenderSettings { clamp_direct: limit, clamp_indirect: limit, ..settings };
        let transport = transport(&stage.scene, &settings);
        let tasks: Vec<_> = (0..24 * 18).map(|i| PixelTask::first([i % 24, i / 24], Counts::new(0.6, 5), i)).collect();
        let empty = || vec![PixelStats::default(); tasks.len()];
        let bits = |stats: &[PixelStats]| stats.iter().map(|s| (s.covered, s.sum)).collect::<Vec<_>>();

        let (mut wave, mut alone) = (Wave::default(), empty());
        wave.run(&transport, &tasks, &mut PixelSums::new(&mut alone));
        let shadow_rays = wave.counts.shadow_rays;

        // The same buffers again, after another wave, with every kind of client.
        let (mut stats, mut extras, mut ledger) = (empty(), vec![ExtraSums::default(); tasks.len()], Ledger::default());
        let mut lights = vec![[0.0; 3]; 3 * tasks.len()];
        wave.run(&transport, &tasks[..7], &mut ());
        let before = wave.counts.shadow_rays;
        let mut columns = AovColumns::default();
        let aovs =
            Aovs { sums: &mut [], extras: &mut extras, layers: &mut lights, indirect: &mut [], columns: &mut columns };
        let absent = None::<Ledger>;
        wave.run(&transport, &tasks, &mut (PixelSums::new(&mut stats), Some(aovs), (&mut ledger, absent)));
        assert_eq!(wave.counts.shadow_rays - before, shadow_rays);
        assert!(ledger.shadow_rays as u64 <= shadow_rays && ledger.shadow_rays <= ledger.light_samples);
        assert!(ledger.shadow_rays > 1000 && ledger.waves == 1);
        assert_eq!(bits(&stats), bits(&alone));
        assert_eq!(ledger.covered, stats.iter().map(|stats| stats.covered).sum::<u32>());
        // Lights by their source add up to the picture.
        for (stats, lights) in stats.iter().zip(lights.chunks(3)) {
            let by_source: f64 = lights.iter().map(|light| f64::from(light[1])).sum();
            // At most 5 paths with 4 terms at each of 9 depths, each rounded twice, by half an epsilon of the sum at most.
            assert!((by_source - stats.sum[1]).abs() <= 180.0 * f64::from(f32::EPSILON) * stats.sum[1]);
        }
    }
}
