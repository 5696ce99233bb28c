//! `bismar compare A B`

mod difference;
pub mod page;
pub mod report;
mod sequence;

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use clap::Args;

use super::options::{check_ending, has_ending};
use crate::console::args::not_negative;
use crate::console::{Paths, Verdict, print, print_json, say};
use crate::film::compare::{Comparison, compare, in_common};
use crate::film::{Picture, atomic};
use crate::{Error, Result};
pub use difference::false_color;
use difference::write_difference;
use report::{Pair, Report, and_more, overview, short, table, write_csv};

/// Compare a picture with a reference: relMSE, RMSE, MAE, FLIP, bias, and its z if both have variance.
///
/// Pictures are OpenEXR, Radiance HDR, PNG or JPEG; a crop is compared with the same window of the other picture. For two
/// folders, pictures of the same name are compared; for two sequences such as a.####.exr, frames of the same number. With
/// pixels that are NaN or infinite, in A or B, every threshold is exceeded.
#[derive(Debug, Args)]
pub struct CompareArgs {
    /// The picture, a folder of pictures, or a sequence: a name with the frame number as #### or {frame:04}.
    a: PathBuf,
    /// The reference, against which relMSE and bias are measured.
    b: PathBuf,
    /// Layer or channel of OpenEXR files to compare, such as albedo or depth.Z.
    #[arg(long, value_name = "NAME")]
    layer: Option<String>,
    /// Print JSON: for folders an array, for sequences the frames and the worst one.
    #[arg(long)]
    json: bool,
    /// Write a table as CSV, with one row per pair.
    #[arg(long, value_name = "FILE.csv")]
    csv: Option<PathBuf>,
    /// Exit with 1 if relMSE is larger than this.
    #[arg(long, value_name = "X", value_parser = not_negative)]
    max_relmse: Option<f64>,
    /// Exit with 1 if the mean FLIP error is larger than this.
    #[arg(long, value_name = "X", value_parser = not_negative)]
    max_flip: Option<f64>,
    /// Exit with 1 if the bias of a channel has a larger |z| than this; both pictures need the variance AOV.
    #[arg(long, value_name = "X", value_parser = not_negative)]
    max_z: Option<f64>,
    /// Write a picture of the difference: as .png, |A - B| / sqrt(B^2 + 0.01) in false colours (black 0 to pale yellow 1,
    /// green not finite); as .exr, A - B.
    #[arg(long, value_name = "FILE")]
    diff: Option<PathBuf>,
    /// Write an HTML page with both pictures under a slider and their FLIP error map; for sequences, of the worst frame, with
    /// a chart of the error over all frames.
    #[arg(long, value_name = "FILE.html")]
    page: Option<PathBuf>,
}

pub fn run(args: &CompareArgs) -> Result<Verdict> {
    let mut paths = Paths::default();
    let folders = args.a.is_dir() && args.b.is_dir();
    let frames = match sequence::are_sequences(&args.a, &args.b) {
        true => Some(sequence::in_both(&args.a, &args.b)?),
        false => None,
    };
    let pairs: Vec<(PathBuf, PathBuf)> = match &frames {
        Some(frames) => frames.iter().map(|(_, a, b)| (a.clone(), b.clone())).collect(),
        None if folders => same_names(&args.a, &args.b)?,
        None => vec![(args.a.clone(), args.b.clone())],
    };
    pairs.iter().flat_map(|(a, b)| [a, b]).try_for_each(|picture| paths.reads("the picture", picture))?;
    for (flag, path, endings) in
        [("--diff", &args.diff, &["png", "exr"][..]), ("--page", &args.page, &["html"]), ("--csv", &args.csv, &["csv"])]
    {
        let Some(path) = path else { continue };
        check_ending(flag, path, endings)?;
        paths.names(flag, path)?;
        atomic::check(path)?;
    }
    if folders && (args.diff.is_some() || args.page.is_some()) {
        return Err(Error::Usage("--diff and --page show one pair of pictures, not two folders of them".into()));
    }
    if frames.is_some() && args.diff.is_some() {
        return Err(Error::Usage("--diff shows one pair of pictures, not two sequences of them".into()));
    }
    let pairs = pairs.into_iter().map(|(a, b)| one(args, a, b)).collect::<Result<Vec<_>>>()?;
    let numbers: Option<Vec<u32>> = frames.map(|frames| frames.iter().map(|(frame, ..)| *frame).collect());
    let worst = sequence::worst(&pairs);
    if let Some(path) = &args.page {
        let curve = numbers.as_ref().map(|numbers| sequence::curve(numbers, worst, &pairs)).unwrap_or_default();
        let Pair { a, b, .. } = &pairs[worst];
        let (comparison, first, second) = both(args, a, b)?;
        page::write(path, [a, b], [&first, &second], &comparison, &curve)?;
    }
    let reports: Vec<_> = pairs
        .iter()
        .map(|pair| Report {
            a: &pair.a,
            b: &pair.b,
            reference: "b",
            comparison: &pair.comparison,
            max_relmse: args.max_relmse,
            max_flip: args.max_flip,
            max_z: args.max_z,
            within: pair.failures.is_empty(),
        })
        .collect();
    if let Some(path) = &args.csv {
        write_csv(path, &reports)?;
    }
    match (args.json, &reports[..], &numbers) {
        (true, all, Some(numbers)) => print_json(&sequence::Sequence::new([&args.a, &args.b], numbers, worst, all))?,
        (true, [one], None) if !folders => print_json(one)?,
        (true, all, None) => print_json(&all)?,
        (false, _, Some(numbers)) => {
            print(format_args!("{}\n{}", overview(&pairs), sequence::summary(numbers, worst, &pairs)))?;
        }
        (false, ..) if folders => print(overview(&pairs))?,
        (false, ..) => print(table(&pairs[0]))?,
    }
    for pair in &pairs {
        for failure in &pair.failures {
            let name = if folders || numbers.is_some() { format!("{}: ", pair.a.display()) } else { String::new() };
            say(format_args!("{name}{failure}"));
        }
    }
    Ok(if pairs.iter().all(|pair| pair.failures.is_empty()) { Verdict::Done } else { Verdict::Beyond })
}

fn one(args: &CompareArgs, a: PathBuf, b: PathBuf) -> Result<Pair> {
    let (comparison, first, second) = both(args, &a, &b)?;
    let failures = failures(args, &comparison)?;
    if let Some(path) = &args.diff {
        write_difference(path, &first, &second)?;
    }
    Ok(Pair { a, b, comparison, failures })
}

/// Opens two pictures, crops them to their common window, and compares them.
fn both(args: &CompareArgs, a: &Path, b: &Path) -> Result<(Comparison, Picture, Picture)> {
    let unlike = |why: String| Error::Data(format!("{} and {}: {why}", a.display(), b.display()));
    let layer = args.layer.as_deref();
    let [first, second] = [Picture::open(a, layer)?, Picture::open(b, layer)?];
    let (first, second) = in_common(&first, &second).map_err(unlike)?;
    Ok((compare(&first, &second).map_err(unlike)?, first, second))
}

/// Pictures that exist under the same name in both folders, by name.
fn same_names(a: &Path, b: &Path) -> Result<Vec<(PathBuf, PathBuf)>> {
    let names = |folder: &Path| -> Result<BTreeSet<_>> {
        let entries = fs::read_dir(folder).map_err(|e| Error::reading(folder, &e))?;
        let is_picture = |path: &PathBuf| path.is_file() && has_ending(path, &["exr", "hdr", "png", "jpg", "jpeg"]);
        let names = entries.flatten().map(|entry| entry.path()).filter(is_picture);
        Ok(names.filter_map(|path| path.file_name().map(ToOwned::to_owned)).collect())
    };
    let (ours, theirs) = (names(a)?, names(b)?);
    let alone = |these: &BTreeSet<_>, those| these.difference(those).cloned().collect::<Vec<std::ffi::OsString>>();
    for (folder, names) in [(a, alone(&ours, &theirs)), (b, alone(&theirs, &ours))] {
        if let Some(first) = names.first() {
            let (n, first) = (names.len(), first.display());
            say(format_args!("only in {}, not compared: {first}{}", folder.display(), and_more(n - 1)));
        }
    }
    let both: Vec<_> = ours.intersection(&theirs).map(|name| (a.join(name), b.join(name))).collect();
    if both.is_empty() {
        let why = "have no pictures of the same name";
        return Err(Error::Data(format!("{} and {} {why}", a.display(), b.display())));
    }
    Ok(both)
}

fn failures(args: &CompareArgs, comparison: &Comparison) -> Result<Vec<String>> {
    let mut failures = Vec::new();
    let beyond = |value: f64, most: f64| value.is_nan() || value > most;
    if let Some(most) = args.max_relmse.filter(|most| beyond(comparison.rel_mse, *most)) {
        failures.push(format!("relMSE {} is beyond {most}", short(comparison.rel_mse)));
    }
    if let Some(most) = args.max_flip.filter(|most| beyond(comparison.flip, *most)) {
        failures.push(format!("FLIP {} is beyond {most}", short(comparison.flip)));
    }
    if let Some(most) = args.max_z {
        let Some(statistics) = &comparison.statistics else {
            return Err(Error::Data(
                "--max-z: both pictures need variance (channels variance.R, .G, .B): render with --aov variance".into(),
            ));
        };
        for (z, channel) in statistics.bias_z.iter().zip(["R", "G", "B"]) {
            if beyond(z.abs(), most) {
                failures.push(format!("{channel}: the bias has z = {}, beyond {most}", short(*z)));
            }
        }
    }
    let [a, b] = comparison.not_finite;
    if a + b > 0 && [args.max_relmse, args.max_flip, args.max_z].iter().any(Option::is_some) {
        failures.push(format!("{a} pixels of A and {b} of B are not finite"));
    }
    Ok(failures)
}
