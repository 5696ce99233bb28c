//! Failure modes of path guiding: renders guided by fields that a pre-pass learned in hard scenes, or by adversarial fields.
//!
//! The pre-pass covers 64 x 64 pixels; renders cover the 4 x 4 pixels in the middle. The pre-pass takes far longer than these
//! pixels, so a hundred replicas share one. All replicas share an adversarial field.

pub mod scenes;

use std::sync::atomic::{AtomicBool, Ordering};

use bismar::Result;
use bismar::balance::Counts;
use bismar::film::PixelStats;
use bismar::guiding::Field;
use bismar::integrator::{PixelSums, PixelTask, PreparedScene, Transport, Wave};
use bismar::render::{Choice, transport};
use rayon::prelude::*;

use super::judge::{Control, Outcome};
use super::renders::Renders;
use super::scenes::{OTHER_SEEDS, PATHS};
use super::{Results, of_renders};
use scenes::{Case, WINDOW, field, settings};

/// Number of replicas that share a pre-pass.
const REPLICAS_PER_PREPASS: u32 = 100;

fn green(pixel: &PixelStats) -> f64 {
    pixel.sum[1] / f64::from(pixel.samples)
}

/// Renders the window's pixels with [`settings`] and a number of paths per pixel, guided by `field`.
pub fn pixels(scene: &PreparedScene, field: Option<&Field>, seed: u32, paths: u32) -> Vec<PixelStats> {
    let transport = transport(scene, &settings(seed, Choice::Off));
    let transport = Transport { proposal: transport.proposal.guided(field), ..transport };
    let [x0, y0, x1, y1] = WINDOW;
    let places = (y0..y1).flat_map(|y| (x0..x1).map(move |x| [x, y]));
    let tasks: Vec<_> = places.zip(0..).map(|(at, i)| PixelTask::first(at, Counts::half(paths), i)).collect();
    let mut stats = vec![PixelStats::default(); tasks.len()];
    Wave::default().run(&transport, &tasks, &mut PixelSums::new(&mut stats));
    stats
}

/// Renders one picture per seed with `render`. Once `stop` is raised, pictures are black.
fn renders(seeds: std::ops::Range<u32>, stop: &AtomicBool, render: impl Fn(u32) -> Vec<f64> + Sync + Send) -> Renders {
    let stopped = || stop.load(Ordering::Relaxed);
    let green: Vec<_> = seeds.into_par_iter().map(|seed| if stopped() { vec![0.0] } else { render(seed) }).collect();
    let shares = green.iter().map(|g| vec![0.5; g.len()]).collect();
    Renders { green, shares }
}

impl Case {
    fn renders(&self, field: Option<&Field>, seeds: std::ops::Range<u32>, stop: &AtomicBool) -> Renders {
        renders(seeds, stop, |seed| pixels(&self.scene, field, seed, PATHS).iter().map(green).collect())
    }

    /// Renders guided by fields of pre-passes, and whether `auto` would guide each of them.
    fn with_prepass(&self, replicas: u32, stop: &AtomicBool) -> (Renders, Vec<bool>) {
        let (mut all, mut auto) = (Renders { green: Vec::new(), shares: Vec::new() }, Vec::new());
        for first in (0..replicas).step_by(REPLICAS_PER_PREPASS as usize) {
            if stop.load(Ordering::Relaxed) {
                break;
            }
            let seeds = first..(first + REPLICAS_PER_PREPASS).min(replicas);
            let of = |guiding| field(&self.scene, &settings(first, guiding));
            let own = self.renders(of(Choice::On).as_ref(), seeds.clone(), stop);
            all.green.extend(own.green);
            all.shares.extend(own.shares);
            let chosen = of(Choice::Auto).is_some();
            auto.extend(seeds.map(|_| chosen));
        }
        (all, auto)
    }

    /// Positive control of unbiasedness: half of the paths with the field and half without, averaged per pixel with
    /// weights from the measured variance of each half.
    fn averaged(&self, field: &Field, replicas: u32, stop: &AtomicBool) -> Renders {
        let one = |(a, b): (&PixelStats, &PixelStats)| {
            let [v, w] = [a, b].map(|s| f64::from(s.variance_of_mean()[1]).max(f64::MIN_POSITIVE));
            (green(a) * w + green(b) * v) / (v + w)
        };
        renders(0..replicas, stop, |seed| {
            let of = |field, seed| pixels(&self.scene, field, seed, PATHS / 2);
            of(None, seed).iter().zip(&of(Some(field), !seed)).map(one).collect()
        })
    }
}

/// Number of steps of [`measure`].
pub fn steps() -> usize {
    2 * scenes::CASES + 1
}

/// Measures all cases with `replicas` ≥ 2. Calls `done` after each of [`steps`]; `done` may stop the measurement with an
/// error, and must once `stop` is raised.
pub fn measure(replicas: u32, stop: &AtomicBool, done: &mut dyn FnMut() -> Result<()>) -> Result<Results> {
    let (mut modes, mut controls) = (Vec::new(), Vec::new());
    for case in scenes::cases()? {
        let truth = case.renders(None, OTHER_SEEDS..OTHER_SEEDS + replicas, stop);
        let half = case.renders(None, 0..replicas, stop);
        done()?;
        let (guided_renders, auto) = case.with_prepass(replicas, stop);
        let adversarial = case.adversarial.as_ref().map(|field| case.renders(Some(field), 0..replicas, stop));
        done()?;
        let chosen = |i: usize| if auto[i] { guided_renders.green[i].clone() } else { half.green[i].clone() };
        let by_choice = Renders { green: (0..auto.len()).map(chosen).collect(), shares: half.shares.clone() };
        let on = adversarial.as_ref().unwrap_or(&guided_renders);
        let guided_fraction = auto.iter().filter(|guided| **guided).count() as f64 / f64::from(replicas);
        let guided = |name: &str, renders: &Renders, fraction| Outcome {
            guided_fraction: Some(fraction),
            ..renders.outcome(name.into(), &half, &truth)
        };
        let outcomes = vec![guided("on", on, 1.0), guided("auto", &by_choice, guided_fraction)];
        let Case { mode, name, construct, .. } = case;
        if let (Some(field), CONTROL_MODE) = (&case.adversarial, mode) {
            let averaged = case.averaged(field, replicas, stop);
            done()?;
            let averaged = averaged.outcome("averaged control".into(), &half, &truth);
            let noisy = Outcome { estimator: "adversarial control".into(), ..outcomes[0].clone() };
            let control = |name, check, outcome| Control { mode, name, check, outcome, caught: false };
            controls = vec![
                control("guided and unguided, averaged by measured variances", "z-test of the mean", averaged),
                control("guided by a field learned from a firefly", "worst pixel's variance", noisy),
            ];
        }
        modes.push(of_renders([mode, name, construct], replicas, Some(case.adversarial.is_some()), outcomes));
    }
    // The tests of the second control are among those of the modes.
    let more = controls.first().map_or(0, |c: &Control| c.outcome.tests);
    Ok(Results::new(replicas, modes, controls, more))
}

/// The mode whose adversarial field the controls use.
const CONTROL_MODE: &str = "F23";
