//! Takes the measurements on one scene.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use bismar::console::host::{peak_memory_bytes, reset_peak_memory, resident_memory_bytes};
use bismar::film::PixelStats;
use bismar::integrator::PreparedScene;
use bismar::rays::RayQueries;
use bismar::render::{Balance, RenderSettings, render};
use bismar::sampling::SplitMix64;
use bismar::{Error, Result};
use rayon::ThreadPool;

use super::agree::{Answers, Judge};
use super::host::Bench;
use super::replay::{Sink, in_turn, spaces};
use super::stream::{self, Stream};
use super::table::{Agreement, Build, Picture, Results, Trace};
use super::{Contender, Design, LARGE, Subject};
use crate::clock::{process_seconds, thread_seconds};
use crate::statistics::{farthest, median, median_error, robust_deviation};

/// The control's name: the baseline, built a second time.
pub(crate) const CONTROL: &str = "embree (again)";
/// Builds that together take less are made again for each round.
const AGAIN_SECONDS: f64 = 0.4;
/// Builds are repeated for about so long, this often at most.
const BUILD_SECONDS: f64 = 0.5;
const MOST_BUILDS: usize = 5;
/// Up to this many triangles, builds by one thread are timed for all contenders, not for the two defaults alone.
const FEW: u64 = 2_000_000;

/// Measures everything of `design` on one scene and adds it to `results`. `progress` is handed the share that is done.
pub fn measure(
    bench: &Bench,
    subject: &Subject,
    design: &Design,
    results: &mut Results,
    stop: &AtomicBool,
    progress: &(dyn Fn(f64) + Sync),
) -> Result<()> {
    let baseline = Contender::baseline();
    let machine = results.hosts[0].machine.clone();
    let campaign = Campaign { bench, subject, design, machine, stop };
    let (base, built) = campaign.build(&baseline, true)?;
    results.hosts[0].embree.clone_from(&base.info().version);
    results.hosts[0].embree_isa.clone_from(&base.info().isa);
    let record = || stream::record(&subject.scene, base.as_ref(), design.rays);
    let streams = bench.one.install(record)?;
    let judge = Judge::new(&subject.scene);
    let base = Side { backend: base.as_ref(), build_seconds: built.cpu_seconds };
    let answers = bench.one.install(|| streams.iter().map(|s| Answers::of(base.backend, s)).collect::<Vec<_>>());
    results.builds.push(built);
    let chosen = design.contenders(subject);
    if chosen.len() < design.contenders.len() {
        results.notes.push(format!(
            "{}: more than {LARGE} triangles are built; {} of {} contenders were measured, as --backends large",
            subject.name,
            chosen.len(),
            design.contenders.len()
        ));
    }
    let contenders = chosen.iter().filter(|c| **c != baseline);
    let mut contenders = contenders.map(|c| (c.name(), c.clone())).collect::<Vec<_>>();
    contenders.insert(0, (CONTROL.to_owned(), baseline.clone()));
    let all = contenders.len() as f64;
    // Per stream, all rounds of the baseline.
    let mut own = vec![Vec::new(); streams.len()];
    for (i, (name, contender)) in contenders.into_iter().enumerate() {
        progress(i as f64 / all);
        campaign.go_on()?;
        results.hosts[0].note();
        let (backend, mut built) = match campaign.build(&contender, contender == Contender::other()) {
            Err(Error::Data(text)) => {
                results.notes.push(format!("{}: {name} cannot build it: {text}", subject.name));
                continue;
            }
            other => other?,
        };
        built.backend.clone_from(&name);
        let side = Side { backend: backend.as_ref(), build_seconds: built.cpu_seconds };
        for (stream, of_base) in streams.iter().zip(&answers) {
            campaign.go_on()?;
            let mut tell = |text: String| results.notes.push(format!("{}, {name}: {text}", subject.name));
            let counts = bench.one.install(|| {
                let own = Answers::of(side.backend, stream);
                judge.compare(stream, (base.backend, of_base), (side.backend, &own), &mut tell)
            });
            results.agreements.push(Agreement::new([&campaign.machine, &subject.name, &name, &stream.name], counts));
        }
        progress((i as f64 + 0.3) / all);
        let rounds = campaign.rounds(&streams, &base, (&contender, &side))?;
        progress((i as f64 + 0.7) / all);
        for (((stream, of_base), rounds), own) in streams.iter().zip(&answers).zip(rounds).zip(&mut own) {
            results.traces.push(campaign.trace(&name, (stream, of_base.hit_share()), &rounds, 1));
            own.extend(rounds);
        }
        if design.spp > 0 {
            results.pictures.push(campaign.pictures(&name, &base, &side)?);
        }
        results.builds.push(built);
    }
    for ((stream, of_base), rounds) in streams.iter().zip(&answers).zip(&own) {
        let mut row = campaign.trace(&baseline.name(), (stream, of_base.hit_share()), rounds, 0);
        (row.speed_ratio, row.speed_ratio_se) = (1.0, 0.0);
        results.traces.push(row);
    }
    progress(1.0);
    Ok(())
}

struct Side<'a> {
    backend: &'a dyn RayQueries,
    build_seconds: f64,
}

struct Campaign<'a> {
    bench: &'a Bench,
    subject: &'a Subject,
    design: &'a Design,
    machine: String,
    stop: &'a AtomicBool,
}

impl Campaign<'_> {
    fn go_on(&self) -> Result<()> {
        if self.stop.load(Ordering::Relaxed) {
            return Err(Error::Interrupted("interrupted: the scenes that were finished are in the report".to_owned()));
        }
        Ok(())
    }

    fn build_once(&self, contender: &Contender) -> Result<Box<dyn RayQueries>> {
        let watch = |_: f64| !self.stop.load(Ordering::Relaxed);
        contender.clone().held_to(self.design.isa).build(Arc::clone(&self.subject.scene), &watch)
    }

    /// Builds now and then again for the time alone; by one thread, too, for few triangles or a `main` contender.
    fn build(&self, contender: &Contender, main: bool) -> Result<(Box<dyn RayQueries>, Build)> {
        let subject = self.subject;
        let timed = |pool: &ThreadPool| -> Result<(Box<dyn RayQueries>, f64, f64)> {
            let (wall, cpu) = (Instant::now(), process_seconds());
            let backend = pool.install(|| self.build_once(contender))?;
            Ok((backend, wall.elapsed().as_secs_f64(), process_seconds() - cpu))
        };
        reset_peak_memory();
        let before = resident_memory_bytes();
        let (backend, wall, cpu) = timed(&self.bench.all)?;
        let peak = peak_memory_bytes().saturating_sub(before);
        let (mut walls, mut cpus) = (vec![wall], vec![cpu]);
        let again = ((BUILD_SECONDS / wall) as usize).min(MOST_BUILDS - 1);
        for _ in 0..again {
            let (_, wall, cpu) = timed(&self.bench.all)?;
            walls.push(wall);
            cpus.push(cpu);
        }
        let one = if main || subject.built <= FEW {
            let times = (0..=again).map(|_| Ok(timed(&self.bench.one)?.1)).collect::<Result<Vec<_>>>()?;
            Some(median(&times))
        } else {
            None
        };
        let info = backend.info();
        let per_triangle = |bytes: u64| bytes as f64 / subject.built as f64;
        let row = Build {
            machine: self.machine.clone(),
            scene: subject.name.clone(),
            shape: subject.shape.map(str::to_owned),
            triangles: subject.triangles,
            built_triangles: subject.built,
            backend: contender.name(),
            version: info.version.clone(),
            isa: info.isa.clone(),
            builds: cpus.len(),
            threads: self.bench.all.current_num_threads(),
            wall_seconds: median(&walls),
            cpu_seconds: median(&cpus),
            cpu_seconds_spread: robust_deviation(&cpus),
            one_thread_seconds: one,
            bytes_per_triangle: per_triangle(info.memory_bytes),
            peak_bytes_per_triangle: info.peak_bytes.map(per_triangle),
            peak_process_bytes_per_triangle: per_triangle(peak),
        };
        Ok((backend, row))
    }

    /// For each stream, seconds of the baseline and of the other for one replay each, round by round in turn. A round goes
    /// through all streams: so each stream's rounds are spread over as long a time as can be, and what slows the machine
    /// for a second slows one of them. Where builds are short, each round has its own, in other places of the memory.
    fn rounds(
        &self,
        streams: &[Stream],
        base: &Side,
        (contender, side): (&Contender, &Side),
    ) -> Result<Vec<Vec<[f64; 2]>>> {
        let mut all = vec![Vec::with_capacity(self.design.rounds); streams.len()];
        let mut random = SplitMix64(1);
        for round in 0..self.design.rounds {
            self.go_on()?;
            let _spaces = spaces(&mut random);
            let again = if base.build_seconds + side.build_seconds < AGAIN_SECONDS {
                let build = |of: &Contender| self.bench.all.install(|| self.build_once(of));
                Some([build(&Contender::baseline())?, build(contender)?])
            } else {
                None
            };
            let both = again.as_ref().map_or([base.backend, side.backend], |[a, b]| [a.as_ref(), b.as_ref()]);
            self.bench.one.install(|| {
                let mut sink = Sink::default();
                for (stream, taken) in streams.iter().zip(&mut all) {
                    taken.push(in_turn(both, stream, round, &mut sink));
                }
            });
        }
        Ok(all)
    }

    fn trace(&self, name: &str, (stream, hit_share): (&Stream, f64), rounds: &[[f64; 2]], which: usize) -> Trace {
        let subject = self.subject;
        let own = rounds.iter().map(|r| r[which]).collect::<Vec<_>>();
        let (speed_ratio, speed_ratio_se) = ratio(rounds);
        let rays = stream.rays() as f64;
        let rate = rays / median(&own) / 1e6;
        Trace {
            machine: self.machine.clone(),
            scene: subject.name.clone(),
            shape: subject.shape.map(str::to_owned),
            triangles: subject.triangles,
            backend: name.to_owned(),
            stream: stream.name.clone(),
            rays: stream.rays() as u64,
            hit_share,
            rounds: rounds.len(),
            mrays_per_second: rate,
            mrays_spread: rate * robust_deviation(&own) / median(&own),
            speed_ratio,
            speed_ratio_se,
        }
    }

    /// Pictures by both, in turn, with different seeds: their times, and the z of their means.
    fn pictures(&self, name: &str, base: &Side, side: &Side) -> Result<Picture> {
        let design = self.design;
        let mut sums = [Vec::new(), Vec::new()];
        let mut taken = Vec::new();
        for round in 0..design.rounds.min(3) as u32 {
            self.go_on()?;
            let mut seconds = [0.0; 2];
            let order = if round.is_multiple_of(2) { [0, 1] } else { [1, 0] };
            for which in order {
                let settings = RenderSettings {
                    width: design.picture,
                    height: design.picture,
                    spp: Some(design.spp),
                    balance: Balance::Half,
                    seed: 1 + 2 * round + which as u32,
                    ..RenderSettings::even()
                };
                let backend = [base, side][which].backend;
                self.bench.one.install(|| -> Result<()> {
                    let start = thread_seconds();
                    let scene = PreparedScene::new(Arc::clone(&self.subject.scene), Box::new(backend));
                    let rendered = render(&scene, &settings, &AtomicBool::new(false), &|_| {})?;
                    seconds[which] = thread_seconds() - start;
                    join(&mut sums[which], &rendered.film().pixels);
                    Ok(())
                })?;
            }
            taken.push(seconds);
        }
        let (speed_ratio, speed_ratio_se) = ratio(&taken);
        let median_of = |which: usize| median(&taken.iter().map(|t: &[f64; 2]| t[which]).collect::<Vec<_>>());
        let [base_per_spp, per_spp] = [0, 1].map(|which| median_of(which) / f64::from(design.spp));
        let crossover = (side.build_seconds - base.build_seconds) / (base_per_spp - per_spp);
        Ok(Picture {
            machine: self.machine.clone(),
            scene: self.subject.name.clone(),
            backend: name.to_owned(),
            pixels: u64::from(design.picture) * u64::from(design.picture),
            spp: design.spp,
            rounds: taken.len(),
            build_cpu_seconds: side.build_seconds,
            cpu_seconds_per_spp: per_spp,
            speed_ratio,
            speed_ratio_se,
            crossover_spp: (side.build_seconds > base.build_seconds && per_spp < base_per_spp).then_some(crossover),
            bias_z: bias_z(&sums[0], &sums[1]),
        })
    }
}

/// Median of the first times over the second, and its standard error.
fn ratio(rounds: &[[f64; 2]]) -> (f64, f64) {
    let ratios = rounds.iter().map(|[base, own]| base / own).collect::<Vec<_>>();
    (median(&ratios), median_error(&ratios))
}

fn join(sums: &mut Vec<PixelStats>, pixels: &[PixelStats]) {
    if sums.is_empty() {
        sums.extend_from_slice(pixels);
    } else {
        sums.iter_mut().zip(pixels).for_each(|(sum, pixel)| sum.join(pixel));
    }
}

/// z of the pictures' mean difference, of the channel where it is largest.
fn bias_z(a: &[PixelStats], b: &[PixelStats]) -> f64 {
    let z = |c: usize| {
        let mean = |pixels: &[PixelStats]| pixels.iter().map(|p| f64::from(p.mean()[c])).sum::<f64>();
        let variance = |pixels: &[PixelStats]| pixels.iter().map(|p| f64::from(p.variance_of_mean()[c])).sum::<f64>();
        let (difference, deviation) = (mean(b) - mean(a), (variance(a) + variance(b)).sqrt());
        // Without any variance, rounding of the sums alone.
        if difference == 0.0 { 0.0 } else { difference / deviation.max(1e-6 * mean(a)) }
    };
    farthest((0..3).map(z))
}
