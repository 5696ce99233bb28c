//! `bismar check GOLDEN…`

mod outcome;
mod page;
mod report;

use std::collections::{HashMap, HashSet};
use std::fs;
use std::path::{Component, Path, PathBuf};
use std::time::Instant;

use clap::Args;

use super::batch::{Work, plan};
use super::options::has_ending;
use crate::batch::job::Job;
use crate::batch::report::{Entry, Status, earlier};
use crate::console::args::{not_negative, threads};
use crate::console::progress::Style;
use crate::console::{Paths, Size, Verbosity, Verdict, print, say};
use crate::film::atomic;
use crate::job::RenderRequest;
use crate::render::StopReason;
use crate::render::record::checkpoint::Earlier;
use crate::{Error, Result};
use outcome::{Check, Limit, Outcome, compare};

/// Render golden pictures again as their headers say, and compare (docs/check.md).
///
/// A golden picture passes if every channel has equal bits, or if the FLIP error of the beauty is within --max-flip at
/// --percentile. The exit code is 1 if a picture differs; if one cannot be rendered, the highest exit code of those.
#[derive(Debug, Args)]
pub struct CheckArgs {
    /// Golden pictures (.exr) that bismar has rendered, or folders of them.
    #[arg(required = true, value_name = "GOLDEN")]
    goldens: Vec<PathBuf>,
    /// Folder against which the scenes' and environments' relative paths in the headers are resolved, and in which those that
    /// were given as absolute paths are looked up by name.
    #[arg(long, value_name = "DIR", default_value = ".")]
    root: PathBuf,
    /// Largest number of paths of a picture, all pixels together: a header may ask for days.
    #[arg(long, value_name = "N", default_value_t = 1 << 33)]
    max_paths: u64,
    /// Folder of the results: index.html, junit.xml, report.json, and in `new` the pictures that are not identical.
    #[arg(long, value_name = "DIR", default_value = OUT)]
    out: PathBuf,
    /// Largest FLIP error, 0 to 1; 0 asks for equal bits.
    #[arg(long, value_name = "X", value_parser = not_negative, default_value_t = outcome::MAX_FLIP)]
    max_flip: f64,
    /// Percentile of the pixels' FLIP errors that is compared with --max-flip.
    #[arg(long, value_name = "P", value_parser = percent, default_value_t = 99.0)]
    percentile: f64,
    /// Replace golden pictures that are not identical by the new ones.
    #[arg(long)]
    update: bool,
    /// Number of pictures to render at the same time; they share the threads.
    #[arg(short, long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=1024))]
    jobs: u32,
    /// Number of threads [default: BISMAR_THREADS, else SLURM_CPUS_PER_TASK, else all cores].
    #[arg(long, value_name = "N", value_parser = threads)]
    threads: Option<usize>,
}

/// The folder of the results that nobody has typed.
const OUT: &str = "bismar-check";

fn percent(text: &str) -> std::result::Result<f64, String> {
    text.parse().ok().filter(|p| (0.0..=100.0).contains(p)).ok_or("not a number from 0 to 100".into())
}

pub fn run(args: &CheckArgs, verbosity: Verbosity) -> Result<Verdict> {
    let began = Instant::now();
    if args.out == Path::new(OUT) {
        atomic::check_folder(&args.out, "--out")?;
    }
    let folder = args.out.join("new");
    let mut folders = vec![args.out.clone()];
    if args.update {
        folders.extend(
            args.goldens.iter().map(|path| if path.is_dir() { path } else { path.parent().unwrap_or(path) }.into()),
        );
    }
    atomic::confine(&folders);
    atomic::create_folder(&folder.join("a"))?;
    let results = ["index.html", "junit.xml", "report.json"].map(|name| args.out.join(name));
    results.iter().try_for_each(|path| atomic::check(path))?;
    let (mut checks, mut jobs, mut paths) = (Vec::new(), Vec::new(), Paths::default());
    let goldens = pictures(&args.goldens)?;
    goldens.iter().try_for_each(|golden| paths.reads("the golden picture", golden))?;
    for (i, golden) in goldens.into_iter().enumerate() {
        let stem = golden.file_stem().unwrap_or_default().to_string_lossy();
        // A file's name has at most 255 bytes.
        let stem = &stem[..stem.floor_char_boundary(240)];
        let new = folder.join(format!("{:04}-{stem}.exr", i + 1));
        paths.writes("the new picture", &new)?;
        // What an earlier check has left is of another build, perhaps.
        atomic::check(&new)?;
        let _ = fs::remove_file(&new);
        let job = job(&golden, &new, args);
        let (scene, outcome) = match &job {
            Ok(job) => (job.request.scene.display().to_string(), Outcome::Pending),
            Err(error) => (String::new(), Outcome::failed(error)),
        };
        jobs.extend(job);
        checks.push(Check { golden, scene, new, seconds: 0.0, outcome, updated: false, is_said: false });
    }
    let rendered = render(args, jobs, verbosity)?;
    let limit = Limit { percentile: args.percentile, max_flip: args.max_flip };
    for check in checks.iter_mut().filter(|check| matches!(check.outcome, Outcome::Pending)) {
        let name = check.golden.display().to_string();
        let entry = rendered.get(&name).ok_or_else(|| Error::Bug(format!("{name}: no result")))?;
        check.seconds = entry.seconds;
        check.is_said = entry.status == Status::Failed;
        check.outcome = match entry.status {
            Status::Done | Status::Before => {
                compare(&check.golden, &check.new, limit).unwrap_or_else(|e| Outcome::failed(&e))
            }
            Status::Failed => Outcome::Failed {
                exit_code: entry.exit_code,
                error: entry.error.clone().unwrap_or_else(|| "no error".into()),
            },
            Status::Interrupted | Status::Pending => {
                return Err(Error::Interrupted("interrupted: nothing is compared; run it again".into()));
            }
        };
    }
    page::write(&results[0], &checks, limit)?;
    for check in &mut checks {
        finish(args, check)?;
    }
    report::write_junit(&results[1], &checks)?;
    report::write_json(&results[2], &checks, limit, began.elapsed().as_secs_f64())?;
    for check in checks.iter().filter(|check| !check.outcome.is_identical() && !check.is_said) {
        let (name, line) = (check.golden.display(), report::line(check));
        match &check.outcome {
            // Errors name the picture.
            Outcome::Failed { .. } => say(line),
            outcome if outcome.passes() => print(format_args!("{name}: {line}"))?,
            _ => say(format_args!("{name}: {line}")),
        }
    }
    if !verbosity.quiet {
        let text = report::summary(&checks, began.elapsed().as_secs_f64());
        say(format_args!("{text}; see {}", results[0].display()));
    }
    let failed = checks.iter().filter_map(|check| check.outcome.exit_code()).max();
    Ok(match failed {
        Some(code) => Verdict::Worst(code),
        None if checks.iter().any(|check| !check.outcome.passes() && !check.updated) => Verdict::Beyond,
        None => Verdict::Done,
    })
}

/// All pictures of the arguments: files as they are, and the OpenEXR files of folders by name.
pub fn pictures(goldens: &[PathBuf]) -> Result<Vec<PathBuf>> {
    let mut all = Vec::new();
    for path in goldens {
        if !path.is_dir() {
            all.push(path.clone());
            continue;
        }
        let entries = fs::read_dir(path).map_err(|e| Error::reading(path, &e))?;
        let mut found: Vec<_> = entries.flatten().map(|entry| entry.path()).collect();
        found.retain(|path| path.is_file() && has_ending(path, &["exr"]));
        found.sort();
        if found.is_empty() {
            return Err(Error::Missing(format!("{}: there is no .exr file in this folder", path.display())));
        }
        all.extend(found);
    }
    let mut seen = HashSet::new();
    all.retain(|path| seen.insert(path.clone()));
    Ok(all)
}

/// The job that renders a golden picture again into `new`.
fn job(golden: &Path, new: &Path, args: &CheckArgs) -> Result<Job> {
    let name = golden.display().to_string();
    let cannot = |why: &str| Error::Data(format!("{name}: {why}"));
    let earlier = Earlier::read(golden)?.ok_or_else(|| Error::Missing(format!("{name}: there is no such file")))?;
    earlier.verify()?;
    let request = RenderRequest::read(&earlier.header).map_err(|why| cannot(&why))?.ok_or_else(|| {
        cannot(
            "its header does not say how it was rendered (attribute bismar.command): render it again with this version",
        )
    })?;
    let settings = &earlier.record.identity.settings;
    if earlier.record.stop == StopReason::Interrupted {
        return Err(cannot("it is not complete: finish it with --resume"));
    }
    if settings.part.is_some() {
        return Err(cannot("it is a part of a picture: merge the parts"));
    }
    let roots = [args.root.as_path(), golden.parent().unwrap_or(golden)];
    let below = |path: &Path| below(&roots, path).map_err(|why| cannot(&why));
    let (scene, root) = below(&request.scene)?;
    let env = request.env.as_deref().map(below).transpose()?.map(|(env, _)| env);
    // Else the scene's camera decides.
    let size = request.size.or(Some(Size(settings.width, settings.height)));
    let (output, relative_to) = (new.to_owned(), Some(root.to_owned()));
    let request = RenderRequest { scene, env, size, output, relative_to, ..request };
    request.check(false).map_err(|e| cannot(&format!("its command cannot be run: {e}")))?;
    let settings = request.settings();
    if settings.time.is_some() {
        return Err(cannot(
            "it was rendered with --time, which ends elsewhere on another machine: use --spp or --noise",
        ));
    }
    let pixels = size.map_or(0, |size| u64::from(size.0) * u64::from(size.1));
    // Without a number of paths, those that give the noise where a path's standard deviation is the mean.
    let of_noise = settings.noise.map_or(0, |noise| noise.powi(-2) as u64).max(MIN_PATHS_OF_NOISE);
    let spp = settings.spp.map_or(of_noise, u64::from);
    let paths = pixels.saturating_mul(spp);
    if paths > args.max_paths {
        return Err(cannot(&format!("its header asks for {paths} paths, more than --max-paths {}", args.max_paths)));
    }
    Ok(Job { name, request, ..Job::default() })
}

/// Least number of paths per pixel that a render whose only goal is its noise is taken for.
const MIN_PATHS_OF_NOISE: u64 = 1 << 15;

/// A file that a header names, and the folder that it was found below; the first folder where there is none. A header must not
/// reach other files: neither by its path nor through links.
fn below<'a>(roots: &[&'a Path], name: &Path) -> std::result::Result<(PathBuf, &'a Path), String> {
    let inside = |part: Component| matches!(part, Component::Normal(_) | Component::CurDir);
    let shown = name.display();
    if !name.components().all(inside) {
        return Err(format!("its header names '{shown}', which is not below a folder"));
    }
    let found = roots.iter().find(|root| root.join(name).exists()).unwrap_or(&roots[0]);
    let path = found.join(name);
    let resolved = |path: &Path| path.canonicalize().unwrap_or_else(|_| path.into());
    if path.exists() && !resolved(&path).starts_with(resolved(found)) {
        return Err(format!(
            "'{shown}' leads out of {} by a link: --root DIR names the folder where it is",
            found.display()
        ));
    }
    Ok((path, found))
}

/// Renders all jobs as a batch; the results by name.
fn render(args: &CheckArgs, jobs: Vec<Job>, verbosity: Verbosity) -> Result<HashMap<String, Entry>> {
    if jobs.is_empty() {
        return Ok(HashMap::new());
    }
    let order = jobs.iter().map(|job| job.name.clone()).collect();
    let (jobs, _) = plan(None, &jobs)?;
    let report = args.out.join("renders.json");
    atomic::check(&report)?;
    let _ = fs::remove_file(&report);
    let work = Work {
        file: "golden pictures".into(),
        order,
        report: Some(report.clone()),
        folders: vec![args.out.clone()],
        at_once: args.jobs as usize,
        threads: args.threads,
        style: if verbosity.quiet { Style::None } else { Style::Auto },
        ..Work::default()
    };
    work.run(jobs, Paths::default(), Verbosity { quiet: true, ..verbosity })?;
    let entries = earlier(&report);
    let _ = fs::remove_file(&report);
    Ok(entries)
}

/// Removes what is not needed of a comparison, and replaces the golden picture where that is asked for.
fn finish(args: &CheckArgs, check: &mut Check) -> Result<()> {
    if check.outcome.exit_code().is_some() {
        return Ok(());
    }
    if args.update && !check.outcome.is_identical() {
        let bytes = fs::read(&check.new).map_err(|e| Error::reading(&check.new, &e))?;
        atomic::write(&check.golden, |file| Ok(Ok(std::io::Write::write_all(file, &bytes)?)))?;
        check.updated = true;
    }
    if check.outcome.is_identical() || check.updated {
        let _ = fs::remove_file(&check.new);
    }
    Ok(())
}
