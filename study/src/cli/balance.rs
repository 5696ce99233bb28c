//! `bismar study balance`

use std::path::PathBuf;
use std::str::FromStr;
use std::time::Instant;

use bismar::Result;
use bismar::console::{Signals, Size, Verbosity, Verdict, print, say};
use bismar::render::{Integrator, Progress};
use clap::Args;

use super::{PAGE, RunArgs, open};
use crate::balance::table::{Level, Outcome, levels};
use crate::balance::{Design, Estimator, SceneResults, StudyScene, measure, portrait, write};

/// Measure how well each --balance shares the work, against a converged reference.
///
/// Writes report.html, results.csv, results.json and charts. Measurements are kept in DIR/cells: the same command goes on
/// where it was interrupted, and takes only what is missing. A file of the scene's name with .hdr or .exr beside it
/// lights it from infinity.
#[derive(Debug, Args)]
pub(super) struct BalanceArgs {
    /// Scenes, .gltf or .glb.
    #[arg(required = true, value_name = "SCENE")]
    scenes: Vec<PathBuf>,
    /// Folder of the results.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// What to compare with half: estimators separated by commas, or all; oracle is the best fixed share of each pixel,
    /// found by brute force.
    #[arg(long, value_name = "LIST")]
    balance: Option<Estimators>,
    /// Paths a pixel, separated by commas [default: 16,64,256].
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = clap::value_parser!(u32).range(1..=1 << 20))]
    spp: Vec<u32>,
    /// Renders of each kind that variances are taken from [default: 32].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(4..=1 << 16))]
    replicas: Option<u32>,
    /// Light transport.
    #[arg(long, value_enum, default_value_t = Integrator::Direct)]
    integrator: Integrator,
    /// Size of the measured pictures [default: 64x64].
    #[arg(long, value_name = "WxH")]
    size: Option<Size>,
    /// Paths a pixel of the reference [default: 64 times the most of --spp].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(16..=1 << 28))]
    reference_spp: Option<u32>,
    /// A look within a minute or so a scene: fewer and smaller pictures, half, second-order, progressive. Other flags
    /// hold all the same.
    #[arg(long)]
    quick: bool,
    #[command(flatten)]
    pub(super) run: RunArgs,
}

#[derive(Debug, Clone)]
struct Estimators(Vec<Estimator>);

impl FromStr for Estimators {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Self, String> {
        if text == "all" {
            return Ok(Self(Estimator::all()));
        }
        let one = |name: &str| {
            let known = || Estimator::all().into_iter().map(Estimator::name).collect::<Vec<_>>().join(", ");
            Estimator::named(name.trim()).ok_or_else(|| format!("there is no '{}'; there are {}", name.trim(), known()))
        };
        text.split(',').map(one).collect::<std::result::Result<_, _>>().map(Self)
    }
}

impl BalanceArgs {
    fn design(&self) -> Design {
        let quick = self.quick;
        let mut spp = match &self.spp[..] {
            [] if quick => vec![8, 16, 32, 64],
            [] => vec![16, 64, 256],
            chosen => chosen.to_vec(),
        };
        spp.sort_unstable();
        spp.dedup();
        let estimators = match &self.balance {
            Some(list) => list.0.clone(),
            None if quick => ["second-order", "progressive"].into_iter().filter_map(Estimator::named).collect(),
            None => Estimator::all(),
        };
        let Size(width, height) = self.size.unwrap_or(if quick { Size(32, 32) } else { Size(64, 64) });
        let most = spp.last().copied().unwrap_or(1);
        Design {
            folder: self.out.clone(),
            estimators,
            reference_spp: self.reference_spp.unwrap_or(most.saturating_mul(64)),
            spp,
            replicas: self.replicas.unwrap_or(if quick { 16 } else { 32 }),
            integrator: self.integrator,
            width,
            height,
        }
    }
}

pub(super) fn run(args: &BalanceArgs, verbosity: Verbosity) -> Result<Verdict> {
    let design = args.design();
    let page = open(&design.folder, PAGE)?;
    let stop = Signals::listen()?.stop;
    let reporter = args.run.reporter(verbosity);
    let start = Instant::now();
    let shown = Estimator::shown(&design.estimators);
    let mut results = Vec::new();
    for (i, path) in args.scenes.iter().enumerate() {
        let scene = StudyScene::load(path, &design)?;
        let all = args.scenes.len() as f64;
        // The portrait takes little.
        let at = |from: f64, to: f64| {
            let reporter = &reporter;
            move |p: Progress| {
                let fraction = (i as f64 + from + p.fraction * (to - from)) / all;
                reporter.update(Progress { fraction, seconds: start.elapsed().as_secs_f64(), ..p });
            }
        };
        let taken = measure(&scene, &design, &stop, &at(0.0, 0.97))
            .and_then(|measured| Ok((measured, portrait(&scene, &design, shown, &stop, &at(0.97, 1.0))?)));
        let (measured, portrait) = taken.inspect_err(|_| reporter.finish(false))?;
        let levels = levels(&scene, &design, &measured);
        if let Some(level) = levels.last() {
            print(summary(level))?;
        }
        results.push(SceneResults::new(&scene.name, levels, &measured, portrait));
        // What is known so far can be read while the rest is under way.
        write(&design, &results)?;
    }
    reporter.finish(true);
    if !verbosity.quiet {
        say(format_args!("{}", page.display()));
    }
    Ok(Verdict::Done)
}

/// The highest level's table, for the terminal.
fn summary(level: &Level) -> String {
    let mut text = String::new();
    if let Some(first) = level.results.first() {
        text += &format!("{}, {} paths a pixel, {} replicas\n", first.row.scene, level.spp, first.row.replicas);
    }
    text += &format!(
        "{:<16}{:>11}{:>9}{:>16}{:>16}{:>10}{:>9}{:>9}{:>9}{:>16}",
        "", "relMSE", "CPU s", "ratio", "found", "time", ">1.05", "sure", "p99", "worst 1 %"
    );
    let with_error = |x: Option<f64>, e: Option<f64>| match (x, e) {
        (Some(x), Some(e)) => format!("{x:.3} ±{e:.3}"),
        _ => "-".to_owned(),
    };
    for Outcome { row, .. } in &level.results {
        text += &format!(
            "\n{:<16}{:>11.3e}{:>9.3}{:>16}{:>16}{:>10.3}{:>8.1}%{:>8.2}%{:>9.2}{:>16}",
            row.estimator,
            row.rel_mse,
            row.cpu_seconds,
            with_error(Some(row.ratio), Some(row.ratio_se)),
            with_error(row.found_ratio, row.found_ratio_se),
            row.time_ratio,
            row.worse * 100.0,
            row.worse_surely * 100.0,
            row.p99,
            with_error(row.worst_held_out, row.worst_held_out_se),
        );
    }
    text + "\n"
}
