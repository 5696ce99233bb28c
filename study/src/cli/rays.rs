//! `bismar study rays`

use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::time::Instant;

use bismar::console::{Signals, Verbosity, Verdict, host, print, say};
use bismar::{Error, Result};
use clap::Args;
use clap::builder::PossibleValuesParser;

use super::common::{RunArgs, open, progress};
use crate::rays::contender::ISAS;
use crate::rays::table::{Build, Trace};
use crate::rays::{Bench, Contender, Design, Results, Shape, Subject, measure, write};
use crate::report::{Table, with_error};

/// Compare Embree and obvhs: speed on recorded rays, build time, memory, agreement of hits.
///
/// Writes report.html, results.json, one CSV file per table, and charts. Each configuration is measured in alternation with
/// embree as the renderer uses it. The exit code is 1 if hits differ by more than rounding explains, or pictures differ.
#[derive(Debug, Args)]
pub(super) struct RaysArgs {
    /// Scene files, .gltf or .glb.
    #[arg(value_name = "SCENE", required_unless_present = "generate")]
    scenes: Vec<PathBuf>,
    /// Folder of the results.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Generated scenes, separated by commas: sphere:N, slivers:N, foliage:N with N triangles.
    #[arg(long, value_name = "LIST", value_delimiter = ',')]
    generate: Vec<Shape>,
    /// Configurations to compare with embree, separated by commas, such as embree+high+robust or obvhs+bvh2+slow, or a list:
    /// usual, quick, large, all [default: usual]. Scenes of more than four million triangles use the list large instead.
    #[arg(long, value_name = "LIST")]
    backends: Option<Contenders>,
    /// Limit Embree to an instruction set.
    #[arg(long, value_name = "ISA", value_parser = PossibleValuesParser::new(ISAS))]
    isa: Option<String>,
    /// Approximate number of rays per stream [default: 65536].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1024..=1 << 26))]
    rays: Option<u32>,
    /// Number of rounds of alternating measurements [default: 9].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(3..=1000))]
    rounds: Option<u32>,
    /// Paths per pixel of the compared pictures; 0 renders none [default: 4].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(0..=1 << 16))]
    spp: Option<u32>,
    /// Quick preset, about a minute per scene: fewer rays, rounds and configurations. Other flags override it.
    #[arg(long)]
    quick: bool,
    #[command(flatten)]
    run: RunArgs,
}

#[derive(Debug, Clone)]
struct Contenders {
    all: Vec<Contender>,
    large: Vec<Contender>,
}

impl FromStr for Contenders {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Self, String> {
        let large = if ["usual", "quick", "all"].contains(&text) { "large" } else { text };
        Ok(Self { all: Contender::list(text)?, large: Contender::list(large)? })
    }
}

impl RaysArgs {
    fn design(&self) -> Result<Design> {
        let quick = self.quick;
        let default_list = || if quick { "quick" } else { "usual" }.parse::<Contenders>().map_err(Error::Bug);
        let contenders = self.backends.as_ref().map_or_else(default_list, |list| Ok(list.clone()))?;
        Ok(Design {
            folder: self.out.clone(),
            contenders: contenders.all,
            contenders_large: contenders.large,
            isa: ISAS.into_iter().find(|isa| Some(*isa) == self.isa.as_deref()),
            rays: self.rays.unwrap_or(if quick { 1 << 15 } else { 1 << 16 }) as usize,
            rounds: self.rounds.unwrap_or(if quick { 3 } else { 9 }) as usize,
            picture: if quick { 96 } else { 128 },
            spp: match self.spp {
                Some(0) => 0,
                Some(spp) => spp.max(2),
                None if quick => 2,
                None => 4,
            },
        })
    }
}

pub(super) fn run(args: &RaysArgs, verbosity: Verbosity) -> Result<Verdict> {
    let design = args.design()?;
    let page = open(&design.folder)?;
    let (threads, _) = host::threads(args.run.threads)?;
    let bench = Bench::new(threads)?;
    let stop = Signals::listen()?.stop;
    let reporter = args.run.reporter(verbosity);
    let start = Instant::now();
    let mut host = bench.host();
    if let Some(isa) = design.isa {
        host.machine += &format!(", Embree held to {isa}");
    }
    let mut results = Results::new(host, design.rounds);
    let files = args.scenes.iter().zip(names(&args.scenes, &args.generate)?);
    let files = files.map(|(path, name)| Subject::load(path, &name));
    let subjects = files.chain(args.generate.iter().map(|shape| Ok(Subject::generate(shape))));
    let all = (args.scenes.len() + args.generate.len()) as f64;
    for (i, subject) in subjects.enumerate() {
        let progress = |done: f64| reporter.update(progress((i as f64 + done) / all, start));
        let subject = subject?;
        let before = results.clone();
        if let Err(error) = measure(&bench, &subject, &design, &mut results, &stop, &progress) {
            reporter.finish(false);
            // Keeps the scenes measured before and drops the incomplete one.
            write(&design.folder, &before)?;
            return Err(error);
        }
        print(summary(&results, &subject.name))?;
        write(&design.folder, &results)?;
    }
    reporter.finish(true);
    let (unexplained, pictures) = (results.unexplained(), results.differing_pictures());
    if !verbosity.quiet {
        say(format_args!("{}", page.display()));
    }
    if unexplained > 0 || pictures > 0 {
        say(format_args!(
            "the backends do not agree: {unexplained} answers and {pictures} pictures differ without explanation (see the notes of \
             the report)"
        ));
        return Ok(Verdict::Beyond);
    }
    Ok(Verdict::Done)
}

/// Name of each scene: the file's stem, with the folder's name in front if several files have the same stem.
fn names(paths: &[PathBuf], shapes: &[Shape]) -> Result<Vec<String>> {
    let stem = |path: &PathBuf| path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let stems = paths.iter().map(stem).collect::<Vec<_>>();
    let name = |(path, stem): (&PathBuf, &String)| match path.parent().and_then(Path::file_name) {
        Some(folder) if stems.iter().filter(|s| *s == stem).count() > 1 => {
            format!("{}-{stem}", folder.to_string_lossy())
        }
        _ => stem.clone(),
    };
    let names = paths.iter().zip(&stems).map(name).collect::<Vec<_>>();
    let mut all = names.iter().cloned().chain(shapes.iter().map(Shape::name)).collect::<Vec<_>>();
    all.sort_unstable();
    match all.windows(2).find(|pair| pair[0] == pair[1]) {
        Some(pair) => Err(Error::Usage(format!("two scenes are called '{}': give each once, or rename one", pair[0]))),
        None => Ok(names),
    }
}

/// Table of a scene's speeds, for the terminal.
fn summary(results: &Results, scene: &str) -> String {
    let builds = results.builds.iter().filter(|b| b.scene == scene).collect::<Vec<_>>();
    let trace = |build: &Build, stream: &str| {
        let own = |t: &&Trace| t.scene == scene && t.backend == build.backend && t.stream == stream;
        results.traces.iter().find(own)
    };
    let mut table = Table::of(&builds)
        .column(scene, "", |b| &*b.backend)
        .column("build s", "", |b| b.cpu_seconds)
        .column("bytes per triangle", "", |b| b.bytes_per_triangle)
        .column("diffuse Mrays/s", "", |b| trace(b, "diffuse").map(|t| t.mrays_per_second));
    for stream in ["camera", "diffuse", "shadow"] {
        let ratio = |b: &&Build| trace(b, stream).map(|t| with_error(t.speed_ratio, t.speed_ratio_se));
        table = table.column(stream, "", ratio);
    }
    table.end().text()
}
