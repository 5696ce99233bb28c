//! Where guiding fails: renders that are led by fields which pilots learned in hard places, or were lied to.
//!
//! Pictures are the 4 x 4 pixels in the middle of 64 x 64, of which the pilot is. A pilot takes far longer than so few pixels,
//! so a hundred replicas share one; a field of lies is the same for all.

pub mod page;
pub mod scenes;

use std::sync::atomic::{AtomicBool, Ordering};

use bismar::Result;
use bismar::balance::{Balance, Counts};
use bismar::film::PixelStats;
use bismar::guiding::Field;
use bismar::integrator::{PixelBatch, PixelTask, PreparedScene, Transport, Wave};
use bismar::render::prepass::guiding::learned;
use bismar::render::{Guiding, RenderSettings, transport};
use rayon::prelude::*;
use serde::Serialize;

use super::Control;
use super::cases::BAR;
use super::judge::{FALSE_ALARM, Outcome, Verdict, z_limit};
use super::renders::Renders;
use super::scenes::{OTHER_SEEDS, PATHS};

/// A failure mode on a scene.
pub struct Case {
    /// F19 … F23.
    pub mode: &'static str,
    /// In a few words.
    pub name: &'static str,
    /// How it is posed.
    pub construct: &'static str,
    /// What is rendered.
    pub scene: PreparedScene<'static>,
    /// A field that was taught what is not so; `None`: the pilot's own.
    pub lies: Option<Field>,
}

/// How an estimator came through a mode.
#[derive(Debug, Clone, Serialize)]
pub struct Guided {
    /// Against `half` without guiding.
    #[serde(flatten)]
    pub outcome: Outcome,
    /// Share of renders that had a field.
    pub led: f64,
}

/// A mode and how the estimators came through it.
#[derive(Debug, Clone, Serialize)]
pub struct ModeResult {
    /// F19 … F23.
    pub mode: &'static str,
    /// In a few words.
    pub name: &'static str,
    /// How it is posed.
    pub construct: &'static str,
    /// Was the field of `on` lied to?
    pub lies: bool,
    /// `on` and `auto`.
    pub outcomes: [Guided; 2],
}

/// All that was found.
#[derive(Debug, Clone, Serialize)]
pub struct Results {
    /// Replicas.
    pub replicas: u32,
    /// Largest |z| allowed of one test.
    pub z_limit: f64,
    /// How many z-tests there were.
    pub tests: usize,
    /// Chance of a false alarm among all of them.
    pub false_alarm: f64,
    /// In the order of their numbers.
    pub modes: Vec<ModeResult>,
    /// What had to be caught.
    pub controls: Vec<Control>,
}

impl Results {
    /// How an estimator came through a mode.
    pub fn verdict(&self, outcome: &Guided) -> Verdict {
        outcome.outcome.verdict(BAR, self.z_limit)
    }

    /// Estimators with a wrong mean or a value that is not finite, each with the mode.
    pub fn wrong(&self) -> Vec<(&str, &ModeResult)> {
        let all = self.modes.iter().flat_map(|m| m.outcomes.iter().map(move |o| (m, o)));
        let wrong = all.filter(|(_, o)| self.verdict(o) == Verdict::Wrong);
        wrong.map(|(m, o)| (o.outcome.estimator.as_str(), m)).collect()
    }
}

/// Pixels along a side of the whole picture.
const WHOLE: u32 = 64;
/// The pixels that are rendered.
const WINDOW: [u32; 4] = [30, 30, 34, 34];
/// Most segments of a path: some beyond the second surface, where roulette begins.
const DEPTH: u32 = 4;
/// Replicas that share a pilot.
const TOGETHER: u32 = 100;

/// Of every render here.
pub fn settings(seed: u32, guiding: Guiding) -> RenderSettings {
    RenderSettings {
        width: WHOLE,
        height: WHOLE,
        crop: Some(WINDOW),
        spp: Some(PATHS),
        max_depth: DEPTH,
        balance: Balance::Half,
        guiding,
        seed,
        ..Default::default()
    }
}

/// A pixel's value.
fn green(pixel: &PixelStats) -> f64 {
    pixel.sum[1] / f64::from(pixel.samples)
}

/// What a render with these settings is led by.
pub fn field(scene: &PreparedScene, settings: &RenderSettings) -> Option<Field> {
    learned(scene, settings, &transport(scene, settings)).and_then(|learned| learned.field)
}

/// The window's pixels as [`settings`] and a seed have them after so many paths, led by a field.
pub fn pixels(scene: &PreparedScene, field: Option<&Field>, seed: u32, paths: u32) -> Vec<PixelStats> {
    let transport = Transport { field, ..transport(scene, &settings(seed, Guiding::Off)) };
    let [x0, y0, x1, y1] = WINDOW;
    let places = (y0..y1).flat_map(|y| (x0..x1).map(move |x| [x, y]));
    let tasks: Vec<_> = places.zip(0..).map(|(at, i)| PixelTask::first(at, Counts::half(paths), i)).collect();
    let mut stats = vec![PixelStats::default(); tasks.len()];
    Wave::default().run(&transport, &mut PixelBatch::radiance_only(&tasks, &mut stats));
    stats
}

/// One picture after another, by its seed; nothing more once `stop` is raised.
fn renders(seeds: std::ops::Range<u32>, stop: &AtomicBool, of: impl Fn(u32) -> Vec<f64> + Sync + Send) -> Renders {
    let stopped = || stop.load(Ordering::Relaxed);
    let green: Vec<_> = seeds.into_par_iter().map(|seed| if stopped() { vec![0.0] } else { of(seed) }).collect();
    let shares = green.iter().map(|g| vec![0.5; g.len()]).collect();
    Renders { green, shares }
}

impl Case {
    /// Pictures that this field leads.
    fn take(&self, field: Option<&Field>, seeds: std::ops::Range<u32>, stop: &AtomicBool) -> Renders {
        renders(seeds, stop, |seed| pixels(&self.scene, field, seed, PATHS).iter().map(green).collect())
    }

    /// Pictures that fields of pilots lead, and of which of them `auto` would do so.
    fn piloted(&self, replicas: u32, stop: &AtomicBool) -> (Renders, Vec<bool>) {
        let (mut all, mut auto) = (Renders { green: Vec::new(), shares: Vec::new() }, Vec::new());
        for first in (0..replicas).step_by(TOGETHER as usize) {
            if stop.load(Ordering::Relaxed) {
                break;
            }
            let seeds = first..(first + TOGETHER).min(replicas);
            let of = |guiding| field(&self.scene, &settings(first, guiding));
            let own = self.take(of(Guiding::On).as_ref(), seeds.clone(), stop);
            all.green.extend(own.green);
            all.shares.extend(own.shares);
            let chosen = of(Guiding::Auto).is_some();
            auto.extend(seeds.map(|_| chosen));
        }
        (all, auto)
    }

    /// Positive control of unbiasedness: half of the paths with the field and half without, averaged pixel by pixel by what
    /// each half's own samples say of its variance.
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

/// How many pieces of work a measurement has.
pub fn steps() -> usize {
    2 * scenes::CASES + 1
}

/// Takes everything, with so many replicas, ≥ 2. `done` is called after each of [`steps`] and may stop with an error; it
/// must, once `stop` is raised.
///
/// # Errors
/// Those of `done`, and of building the scenes.
pub fn measure(replicas: u32, stop: &AtomicBool, done: &mut dyn FnMut() -> Result<()>) -> Result<Results> {
    let (mut modes, mut controls) = (Vec::new(), Vec::new());
    for case in scenes::cases()? {
        let truth = case.take(None, OTHER_SEEDS..OTHER_SEEDS + replicas, stop);
        let half = case.take(None, 0..replicas, stop);
        done()?;
        let (piloted, auto) = case.piloted(replicas, stop);
        let lied_to = case.lies.as_ref().map(|lies| case.take(Some(lies), 0..replicas, stop));
        done()?;
        let chosen = |i: usize| if auto[i] { piloted.green[i].clone() } else { half.green[i].clone() };
        let by_choice = Renders { green: (0..auto.len()).map(chosen).collect(), shares: half.shares.clone() };
        let on = lied_to.as_ref().unwrap_or(&piloted);
        let led = auto.iter().filter(|led| **led).count() as f64 / f64::from(replicas);
        let guided = |name: &str, own: &Renders, led| Guided { outcome: own.outcome(name.into(), &half, &truth), led };
        let outcomes = [guided("on", on, 1.0), guided("auto", &by_choice, led)];
        let Case { mode, name, construct, .. } = case;
        if let (Some(lies), CONTROLS) = (&case.lies, mode) {
            let averaged = case.averaged(lies, replicas, stop);
            done()?;
            let averaged = averaged.outcome("averaged control".into(), &half, &truth);
            let noisy = Outcome { estimator: "lied-to control".into(), ..outcomes[0].outcome.clone() };
            let control = |name, check, outcome| Control { mode, name, check, outcome, caught: false };
            controls = vec![
                control("led and not led, averaged by measured variances", "z-test of the mean", averaged),
                control("led by what a firefly has taught", "worst pixel's variance", noisy),
            ];
        }
        modes.push(ModeResult { mode, name, construct, lies: case.lies.is_some(), outcomes });
    }
    let tests = modes.iter().flat_map(|m| &m.outcomes).map(|o| o.outcome.tests).sum::<usize>();
    // The second control's are among them.
    let tests = tests + controls.first().map_or(0, |c| c.outcome.tests);
    let z_limit = z_limit(tests);
    for control in &mut controls {
        let verdict = control.outcome.verdict(BAR, z_limit);
        control.caught = verdict == if control.check.starts_with('z') { Verdict::Wrong } else { Verdict::Fails };
    }
    Ok(Results { replicas, z_limit, tests, false_alarm: FALSE_ALARM, modes, controls })
}

/// The mode whose field of lies the controls have.
const CONTROLS: &str = "F23";
