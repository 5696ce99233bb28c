//! `bismar study rays`

use std::path::PathBuf;
use std::str::FromStr;
use std::time::Instant;

use clap::Args;
use clap::builder::PossibleValuesParser;

use crate::cli::progress::{Reporter, Style};
use crate::cli::render::threads;
use crate::cli::signals::Signals;
use crate::cli::{Verbosity, Verdict, host, print, say};
use crate::film::atomic;
use crate::render::Progress;
use crate::study::rays::contender::ISAS;
use crate::study::rays::{Bench, Contender, Plan, Results, Shape, Subject, measure, write};
use crate::{Error, Result};

/// Measure Embree against obvhs: speed on recorded rays, builds, memory, agreement.
///
/// Writes report.html, results.json, a CSV file a table and charts. Each contender takes turns with embree as the renderer
/// uses it. Differences in hits that rounding does not explain, or pictures that differ, end with exit code 1.
#[derive(Debug, Args)]
pub(super) struct RaysArgs {
    /// Scenes, .gltf or .glb.
    #[arg(value_name = "SCENE", required_unless_present = "generate")]
    scenes: Vec<PathBuf>,
    /// Folder of the results.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Generated scenes, separated by commas: sphere:N, slivers:N, foliage:N with about N triangles.
    #[arg(long, value_name = "LIST", value_delimiter = ',')]
    generate: Vec<Shape>,
    /// What to compare with embree: names such as embree+high+robust or obvhs+bvh2+slow separated by commas, or usual,
    /// quick, all [default: usual].
    #[arg(long, value_name = "LIST")]
    backends: Option<Contenders>,
    /// Hold Embree to an instruction set, for comparisons of like with like.
    #[arg(long, value_name = "ISA", value_parser = PossibleValuesParser::new(ISAS))]
    isa: Option<String>,
    /// About how many rays a stream has [default: 262144].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1024..=1 << 26))]
    rays: Option<u32>,
    /// Rounds in which a contender and embree take turns [default: 9].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(3..=1000))]
    rounds: Option<u32>,
    /// Paths a pixel of the compared pictures, 0 for none [default: 8].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(0..=1 << 16))]
    spp: Option<u32>,
    /// Keep the recorded rays in DIR/streams.
    #[arg(long)]
    save_streams: bool,
    /// Replay rays that were kept instead of recording them.
    #[arg(long, value_name = "DIR", conflicts_with = "save_streams")]
    streams: Option<PathBuf>,
    /// Add the rows of other studies' results.json, of another machine for example.
    #[arg(long, value_name = "FILE", num_args = 1..)]
    merge_report: Vec<PathBuf>,
    /// How to call this machine [default: its processor].
    #[arg(long, value_name = "NAME")]
    machine: Option<String>,
    /// A look within a minute or so a scene: fewer rays, rounds and contenders. Other flags hold all the same.
    #[arg(long)]
    quick: bool,
    /// Threads [default: BISMAR_THREADS, else SLURM_CPUS_PER_TASK, else all].
    #[arg(long, value_name = "N", value_parser = threads)]
    threads: Option<usize>,
    /// How progress is shown.
    #[arg(long, value_enum, default_value_t = Style::Auto)]
    progress: Style,
}

#[derive(Debug, Clone)]
struct Contenders(Vec<Contender>);

impl FromStr for Contenders {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Self, String> {
        Contender::list(text).map(Self)
    }
}

impl RaysArgs {
    fn plan(&self) -> Result<Plan> {
        let quick = self.quick;
        let usual = || Contender::list(if quick { "quick" } else { "usual" }).map_err(Error::Bug);
        Ok(Plan {
            folder: self.out.clone(),
            contenders: self.backends.as_ref().map_or_else(usual, |list| Ok(list.0.clone()))?,
            isa: ISAS.into_iter().find(|isa| Some(*isa) == self.isa.as_deref()),
            rays: self.rays.unwrap_or(if quick { 1 << 16 } else { 1 << 18 }) as usize,
            rounds: self.rounds.unwrap_or(if quick { 3 } else { 9 }) as usize,
            picture: if quick { 96 } else { 192 },
            spp: match self.spp {
                Some(0) => 0,
                Some(spp) => spp.max(2),
                None if quick => 4,
                None => 8,
            },
            save_streams: self.save_streams,
            streams: self.streams.clone(),
            machine: self.machine.clone(),
        })
    }
}

pub(super) fn run(args: &RaysArgs, verbosity: Verbosity) -> Result<Verdict> {
    let plan = args.plan()?;
    let others = args.merge_report.iter().map(|path| Results::read(path)).collect::<Result<Vec<_>>>()?;
    std::fs::create_dir_all(&plan.folder)
        .map_err(|e| Error::CannotCreate(format!("{}: cannot create: {e}", plan.folder.display())))?;
    let report = plan.folder.join("report.html");
    atomic::check(&report)?;
    let (threads, _) = host::threads(args.threads)?;
    let bench = Bench::new(threads)?;
    let stop = Signals::listen()?.stop;
    let reporter = Reporter::new(args.progress, verbosity.quiet);
    let start = Instant::now();
    let mut host = bench.host(plan.machine.as_deref());
    if let Some(isa) = plan.isa {
        host.machine += &format!(", Embree held to {isa}");
    }
    let mut results = Results::new(host, plan.rounds);
    let mut subjects: Vec<Box<dyn Fn() -> Result<Subject>>> = Vec::new();
    for path in &args.scenes {
        subjects.push(Box::new(move || Subject::load(path)));
    }
    for shape in &args.generate {
        subjects.push(Box::new(move || Ok(Subject::generate(shape))));
    }
    let all = subjects.len() as f64;
    for (i, subject) in subjects.iter().enumerate() {
        let progress = |done: f64| {
            let fraction = (i as f64 + done) / all;
            reporter.update(Progress {
                fraction,
                seconds: start.elapsed().as_secs_f64(),
                rays: 0,
                noise: f64::INFINITY,
                spp: 0,
            });
        };
        let subject = subject()?;
        let before = results.clone();
        if let Err(error) = measure(&bench, &subject, &plan, &mut results, &stop, &progress) {
            reporter.finish(false);
            // What is known of the scenes before stays readable; half a scene would not be.
            write(&plan.folder, &before)?;
            return Err(error);
        }
        print(summary(&results, &subject.name))?;
        write(&plan.folder, &results)?;
    }
    reporter.finish(true);
    let (unexplained, pictures) = (results.unexplained(), results.differing_pictures());
    others.into_iter().for_each(|other| results.merge(other));
    write(&plan.folder, &results)?;
    if !verbosity.quiet {
        say(format_args!("{}", report.display()));
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

/// A scene's speeds for the terminal.
fn summary(results: &Results, scene: &str) -> String {
    let traces = results.traces.iter().filter(|t| t.scene == scene);
    let mut text = format!(
        "{scene}\n{:<28}{:>10}{:>8}{:>10}{:>16}{:>16}{:>16}",
        "", "build s", "B/tri", "Mrays/s", "camera", "diffuse", "shadow"
    );
    let traces = traces.collect::<Vec<_>>();
    for build in results.builds.iter().filter(|b| b.scene == scene) {
        let of = |stream: &str| traces.iter().find(|t| t.backend == build.backend && t.stream == stream);
        let ratio = |stream: &str| {
            of(stream).map_or("-".to_owned(), |t| format!("{:.3} ±{:.3}", t.speed_ratio, t.speed_ratio_se))
        };
        text += &format!(
            "\n{:<28}{:>10.4}{:>8.1}{:>10.2}{:>16}{:>16}{:>16}",
            build.backend,
            build.cpu_seconds,
            build.bytes_per_triangle,
            of("diffuse").map_or(f64::NAN, |t| t.mrays_per_second),
            ratio("camera"),
            ratio("diffuse"),
            ratio("shadow"),
        );
    }
    text + "\n"
}
