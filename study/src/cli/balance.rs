//! `bismar study balance`

use std::path::PathBuf;
use std::time::Instant;

use bismar::Result;
use bismar::console::{Signals, Size, Verbosity, Verdict, print, say};
use bismar::job::value_of;
use bismar::render::{Integrator, Progress};
use clap::Args;

use super::common::{RunArgs, open};
use crate::balance::table::Level;
use crate::balance::{Design, Estimator, SceneResults, StudyScene, measure, whole, write};
use crate::report::Table;

/// Measure the error of each --balance against a converged reference.
///
/// Writes report.html, results.csv, results.json and charts. Measurements are kept in DIR/cells, so that the same command
/// resumes after an interruption and measures only what is missing. A .hdr or .exr file with the scene's name in the scene's
/// folder is used as environment map.
#[derive(Debug, Args)]
pub(super) struct BalanceArgs {
    /// Scene files, .gltf or .glb.
    #[arg(required = true, value_name = "SCENE")]
    scenes: Vec<PathBuf>,
    /// Folder of the results.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Estimators to compare with half, separated by commas, or all. NAME+guiding and NAME+adaptive add --guiding auto and --adaptive=auto, NAME-compensation
    /// and NAME-learned-lights turn these off.
    #[arg(long, value_name = "LIST", value_parser = estimators)]
    balance: Option<Estimators>,
    /// Paths per pixel, separated by commas [default: 16,64,256; with --whole also 1024].
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = clap::value_parser!(u32).range(1..=1 << 20))]
    spp: Vec<u32>,
    /// Number of independent renders from which variances are estimated [default: 32; with --whole 4].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(4..=1 << 16))]
    replicas: Option<u32>,
    /// Light transport to simulate [default: direct; with --whole path].
    #[arg(long, value_parser = value_of::<Integrator>())]
    integrator: Option<Integrator>,
    /// Number of measured pixels [default: 64x64; with --whole 192x128].
    #[arg(long, value_name = "WxH")]
    size: Option<Size>,
    /// Resolution of the picture from which the measured pixels are taken, as whole tiles of 16x16 spread evenly over the
    /// view; none: a whole picture of --size, whose large pixels contain edges that hide the effect of the balance.
    #[arg(long, value_name = "WxH|none", default_value = "1920x1080", value_parser = footprint)]
    footprint: Footprint,
    /// Measure whole pictures: error against CPU seconds, including the cost of learning. By default half and progressive,
    /// also with adaptive sampling and, with the path integrator, path guiding.
    #[arg(long, conflicts_with = "footprint")]
    whole: bool,
    /// Paths per pixel of the reference [default: 64 times the largest --spp; with --whole 4 times].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(16..=1 << 28))]
    reference_spp: Option<u32>,
    /// Quick preset, about a minute per scene: fewer and smaller pictures of half, second-order and progressive. Other flags
    /// override it.
    #[arg(long)]
    quick: bool,
    #[command(flatten)]
    pub(super) run: RunArgs,
}

/// The size of `--footprint`; `None`: a whole picture.
type Footprint = Option<Size>;

fn footprint(text: &str) -> std::result::Result<Footprint, String> {
    match text {
        "none" => Ok(None),
        size => size.parse().map(Some).map_err(|e| format!("{e}, nor none")),
    }
}

type Estimators = Vec<Estimator>;

fn estimators(text: &str) -> std::result::Result<Estimators, String> {
    if text == "all" {
        return Ok(Estimator::all());
    }
    let one = |name: &str| {
        let known = || Estimator::all().into_iter().map(Estimator::name).collect::<Vec<_>>().join(", ");
        Estimator::named(name.trim()).ok_or_else(|| format!("there is no '{}'; there are {}", name.trim(), known()))
    };
    text.split(',').map(one).collect()
}

impl BalanceArgs {
    fn design(&self) -> Design {
        let (quick, whole) = (self.quick, self.whole);
        let integrator = self.integrator.unwrap_or(if whole { Integrator::Path } else { Integrator::Direct });
        let mut spp = match &self.spp[..] {
            [] if quick => vec![8, 16, 32, 64],
            [] if whole => vec![16, 64, 256, 1024],
            [] => vec![16, 64, 256],
            chosen => chosen.to_vec(),
        };
        spp.sort_unstable();
        spp.dedup();
        let estimators = match &self.balance {
            Some(list) => list.clone(),
            None if whole => {
                let with = ["", "+guiding", "+adaptive", "+guiding+adaptive"].into_iter();
                let here = with.filter(|with| integrator == Integrator::Path || !with.contains("guiding"));
                let names = here.flat_map(|with| ["half", "progressive"].map(|name| format!("{name}{with}")));
                names.filter_map(|name| Estimator::named(&name)).collect()
            }
            None if quick => ["second-order", "progressive"].into_iter().filter_map(Estimator::named).collect(),
            None => Estimator::all(),
        };
        let (size, replicas) = match () {
            () if whole => (Size(192, 128), 4),
            () if quick => (Size(32, 32), 16),
            () => (Size(64, 64), 32),
        };
        let Size(width, height) = self.size.unwrap_or(size);
        let most = spp.last().copied().unwrap_or(1);
        Design {
            folder: self.out.clone(),
            estimators,
            reference_spp: self.reference_spp.unwrap_or(most.saturating_mul(if whole { 4 } else { 64 })),
            spp,
            replicas: self.replicas.unwrap_or(replicas),
            integrator,
            width,
            height,
            footprint: self.footprint.filter(|_| !whole).map(|Size(width, height)| [width, height]),
            whole,
        }
    }
}

pub(super) fn run(args: &BalanceArgs, verbosity: Verbosity) -> Result<Verdict> {
    let design = args.design();
    design.mosaic()?;
    let page = open(&design.folder)?;
    let stop = Signals::listen()?.stop;
    let reporter = args.run.reporter(verbosity);
    let start = Instant::now();
    // Maps progress of scene i to progress of all scenes.
    let at = |i: usize| {
        let (reporter, start, all) = (&reporter, &start, args.scenes.len() as f64);
        move |p: Progress| {
            let fraction = (i as f64 + p.fraction) / all;
            reporter.update(Progress { fraction, seconds: start.elapsed().as_secs_f64(), ..p });
        }
    };
    let ended = |_: &_| reporter.finish(false);
    let (mut results, mut pictures) = (Vec::new(), Vec::new());
    for (i, path) in args.scenes.iter().enumerate() {
        let scene = StudyScene::load(path, &design)?;
        let measured = measure(&scene, &design, &stop, &at(i)).inspect_err(ended)?;
        if design.whole {
            pictures.push(whole::SceneResults::new(&scene, &design, &measured));
            print(scores(&design, &pictures[i]))?;
            whole::page::write(&design, &pictures)?;
            continue;
        }
        results.push(SceneResults::new(&scene, &design, &measured));
        if let Some(level) = results[i].top() {
            print(summary(&scene.name, &design, level))?;
        }
        // The report can be read while the other scenes are measured.
        write(&design, &results)?;
    }
    reporter.finish(true);
    if !verbosity.quiet {
        say(format_args!("{}", page.display()));
    }
    Ok(Verdict::Done)
}

/// Table of a scene's whole pictures, for the terminal.
fn scores(design: &Design, scene: &whole::SceneResults) -> String {
    let fields = "estimator paths_mean rel_mse cpu_seconds rel_mse_ratio time_ratio product_ratio";
    let table = Table::of_fields(&scene.rows, fields);
    format!("{}, {} replicas\n{}", scene.name, design.replicas, table.text())
}

/// Table of the largest number of paths, for the terminal.
fn summary(scene: &str, design: &Design, level: &Level) -> String {
    let rows = level.results.iter().map(|outcome| &outcome.row).collect::<Vec<_>>();
    let fields = "estimator rel_mse cpu_seconds ratio time_ratio worse_surely p50 worst_held_out";
    let table = Table::of_fields(&rows, fields);
    format!("{scene}, {} paths a pixel, {} replicas\n{}", level.spp, design.replicas, table.text())
}
