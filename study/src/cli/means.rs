//! `bismar study means`

use std::path::PathBuf;
use std::time::Instant;

use bismar::console::{Signals, Verbosity, Verdict, print, say};
use bismar::{Error, Result};
use clap::Args;

use super::common::{RunArgs, open, progress};
use crate::means::features::{Feature, draw, features};
use crate::means::{Design, Results, Row, Subject, measure, page};

/// Test on random scenes that every technique, balance and stop rule has the same mean.
///
/// Each scene is rendered by the plain command, its balance alone, each technique alone, all of them, another balance, with objects
/// in another order, and in one more way (--noise, parts, groups of lights), and compared with --balance half:
/// the whole picture, and blocks of 8 x 8 pixels. What differs is rendered again with other seeds and, if it differs again, with
/// ever fewer features; a command for the smallest scene is printed. In every run, pictures from which light was taken verify the
/// tests. The exit code is 1 if a mean is wrong, or if a run of 20 scenes or more does not notice that light was taken. Writes
/// report.html, results.csv and results.json.
#[derive(Debug, Args)]
pub(super) struct MeansArgs {
    /// Scene files to test instead of random scenes, .gltf or .glb, lit as by study balance.
    #[arg(value_name = "SCENE")]
    files: Vec<PathBuf>,
    /// Number of random scenes, whose seeds are consecutive; of times that each file is rendered, in other ways [default: 40;
    /// of a file, and with --only, 1].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1 << 20))]
    scenes: Option<u32>,
    /// Seed of the first scene.
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u32,
    /// The features of the scene, KIND:VALUE, separated by commas, instead of random ones.
    #[arg(long, value_name = "FEATURES", value_parser = features)]
    only: Option<Features>,
    /// Pictures of each way and scene.
    #[arg(long, value_name = "N", default_value_t = 12, value_parser = clap::value_parser!(u32).range(6..=1 << 16))]
    replicas: u32,
    /// Paths per pixel.
    #[arg(long, value_name = "N", default_value_t = 32, value_parser = clap::value_parser!(u32).range(16..=1 << 20))]
    spp: u32,
    /// Folder of the results.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    #[command(flatten)]
    pub(super) run: RunArgs,
}

type Features = Vec<Feature>;

impl MeansArgs {
    fn design(&self) -> Design {
        let single = !self.files.is_empty() || self.only.is_some();
        let seeds = self.seed..self.seed.saturating_add(self.scenes.unwrap_or(if single { 1 } else { 40 }));
        let files = if self.files.is_empty() { vec![None] } else { self.files.iter().cloned().map(Some).collect() };
        let subject = |file: Option<PathBuf>, seed| {
            let features = self.only.clone().unwrap_or_else(|| draw(seed, file.is_some()));
            Subject { seed, file, features }
        };
        let subjects = files.into_iter().flat_map(|file| seeds.clone().map(move |seed| subject(file.clone(), seed)));
        Design { subjects: subjects.collect(), replicas: self.replicas, spp: self.spp }
    }
}

pub(super) fn run(args: &MeansArgs, verbosity: Verbosity) -> Result<Verdict> {
    let design = args.design();
    let opened = args.out.as_deref().map(open).transpose()?;
    let signals = Signals::listen()?;
    let reporter = args.run.reporter(verbosity);
    let (start, mut scenes) = (Instant::now(), 0.0);
    let mut done = |rows: &[Row]| {
        scenes += 1.0;
        reporter.update(progress(scenes / design.subjects.len() as f64, start));
        rows.iter().filter(|row| row.wrong).for_each(tell);
        if signals.stopped() { Err(Error::Interrupted("nothing was written".into())) } else { Ok(()) }
    };
    let results = measure(&design, &signals.stop, &mut done).inspect_err(|_| reporter.finish(false))?;
    reporter.finish(true);
    if let (Some(folder), Some(page)) = (&args.out, opened) {
        page::write(folder, &results)?;
        if !verbosity.quiet {
            say(format_args!("{}", page.display()));
        }
    }
    print(page::ways(&results).text())?;
    print(page::controls(&results.controls).text())?;
    Ok(verdict(&results))
}

/// Says that a mean is wrong.
fn tell(row: &Row) {
    let Row { seed, way, region, .. } = row;
    let (difference, t) = (100.0 * row.again_difference.unwrap_or(row.region_difference), row.again_t.unwrap_or(row.t));
    let place = if *region == 0 { "the whole picture".to_owned() } else { format!("block {region}") };
    say(format_args!("error: scene {seed}, {way}: {place} is off by {difference:+.2} % ({t:+.1} standard errors)"));
    if let Some(command) = &row.command {
        say(format_args!("    {command}"));
    }
}

/// Prints what concerns no scene alone; [`Verdict::Beyond`] if anything is wrong.
fn verdict(results: &Results) -> Verdict {
    let mut verdict = if results.wrong().next().is_some() { Verdict::Beyond } else { Verdict::Done };
    for way in results.ways.iter().filter(|way| way.wrong) {
        verdict = Verdict::Beyond;
        say(format_args!("error: {}: the mean over all scenes is wrong, though no scene shows it", way.way));
    }
    for control in results.controls.iter().filter(|control| !control.is_caught()) {
        verdict = Verdict::Beyond;
        say(format_args!(
            "error: {}: too few are noticed: this run could not have seen a fault of this size",
            control.name
        ));
    }
    verdict
}
