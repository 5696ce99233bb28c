//! `bismar compare A B`

mod page;
mod sequence;

use std::collections::BTreeSet;
use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};

use clap::Args;
use serde::Serialize;

use crate::console::args::not_negative;
use crate::console::{Paths, Verdict, print, print_json, say};
use crate::film::compare::{Comparison, REL_MSE_EPSILON, compare, in_common};
use crate::film::{Picture, atomic, exr_file, preview};
use crate::{Error, Result};

/// Compare a picture with a reference: relMSE, RMSE, MAE, FLIP, bias, and z where both carry variance.
///
/// Pictures are OpenEXR, Radiance HDR, PNG or JPEG; a crop is compared with its part of the whole. Of two folders, pictures
/// of the same name are compared; of two sequences, as in a.####.exr, frames of the same number.
#[derive(Debug, Args)]
pub struct CompareArgs {
    /// The picture, or a folder of them, or a sequence: a name with the frame's number as #### or {frame:04}.
    a: PathBuf,
    /// The reference: what relMSE divides by, and what a bias is measured from.
    b: PathBuf,
    /// Compare this layer of OpenEXR files, or one channel, as in albedo or depth.Z.
    #[arg(long, value_name = "NAME")]
    layer: Option<String>,
    /// Print JSON; of folders, an array; of sequences, their frames and which is the worst.
    #[arg(long)]
    json: bool,
    /// Write a row of numbers for each pair.
    #[arg(long, value_name = "FILE.csv")]
    csv: Option<PathBuf>,
    /// Exit with 1 if relMSE is beyond this, or A has a value that is not finite.
    #[arg(long, value_name = "X", value_parser = not_negative)]
    max_relmse: Option<f64>,
    /// Exit with 1 if mean FLIP is beyond this.
    #[arg(long, value_name = "X", value_parser = not_negative)]
    max_flip: Option<f64>,
    /// Exit with 1 if a channel's bias has |z| beyond this; both pictures must carry variance.
    #[arg(long, value_name = "X", value_parser = not_negative)]
    max_z: Option<f64>,
    /// Write a picture of the difference: .png of |A - B| / sqrt(B^2 + 0.01) in false colours (black 0 to pale
    /// yellow 1, green not finite), or .exr of A - B.
    #[arg(long, value_name = "FILE")]
    diff: Option<PathBuf>,
    /// Write a page with both pictures under a slider, and what people see of their difference (FLIP); of sequences, the
    /// worst frame's, and the curve of their errors.
    #[arg(long, value_name = "FILE.html")]
    page: Option<PathBuf>,
}

#[derive(Serialize)]
struct Report<'a> {
    a: &'a Path,
    b: &'a Path,
    reference: &'static str,
    #[serde(flatten)]
    comparison: &'a Comparison,
    max_relmse: Option<f64>,
    max_flip: Option<f64>,
    max_z: Option<f64>,
    within: bool,
}

/// Two pictures that were compared.
struct Pair {
    a: PathBuf,
    b: PathBuf,
    comparison: Comparison,
    failures: Vec<String>,
}

pub fn run(args: &CompareArgs) -> Result<Verdict> {
    let mut paths = Paths::default();
    let frames = match sequence::are_sequences(&args.a, &args.b) {
        true => Some(sequence::in_both(&args.a, &args.b)?),
        false => None,
    };
    let pairs: Vec<(PathBuf, PathBuf)> = match &frames {
        Some(frames) => frames.iter().map(|(_, a, b)| (a.clone(), b.clone())).collect(),
        None => vec![(args.a.clone(), args.b.clone())],
    };
    pairs.iter().flat_map(|(a, b)| [a, b]).try_for_each(|picture| paths.reads("the picture", picture))?;
    for (flag, path, endings) in
        [("--diff", &args.diff, &["png", "exr"][..]), ("--page", &args.page, &["html"]), ("--csv", &args.csv, &["csv"])]
    {
        let Some(path) = path else { continue };
        if !endings.iter().any(|ending| has_extension(path, ending)) && !path.starts_with("/dev") {
            let endings = endings.iter().map(|ending| format!(".{ending}")).collect::<Vec<_>>().join(" or ");
            return Err(Error::Usage(format!("{flag} {}: the name must end in {endings}", path.display())));
        }
        paths.writes(flag, path)?;
        atomic::check(path)?;
    }
    let folders = args.a.is_dir() && args.b.is_dir();
    if folders && (args.diff.is_some() || args.page.is_some()) {
        return Err(Error::Usage("--diff and --page show one pair of pictures, not two folders of them".into()));
    }
    if frames.is_some() && args.diff.is_some() {
        return Err(Error::Usage("--diff shows one pair of pictures, not two sequences of them".into()));
    }
    let pairs = if folders { same_names(&args.a, &args.b)? } else { pairs };
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

/// Two pictures, as far as they show the same place, and how they compare.
fn both(args: &CompareArgs, a: &Path, b: &Path) -> Result<(Comparison, Picture, Picture)> {
    let unlike = |why: String| Error::Data(format!("{} and {}: {why}", a.display(), b.display()));
    let layer = args.layer.as_deref();
    let [first, second] = [Picture::open(a, layer)?, Picture::open(b, layer)?];
    let (first, second) = in_common(&first, &second).map_err(unlike)?;
    Ok((compare(&first, &second).map_err(unlike)?, first, second))
}

/// Pictures of the first folder that have a namesake in the second, by name.
fn same_names(a: &Path, b: &Path) -> Result<Vec<(PathBuf, PathBuf)>> {
    let names = |folder: &Path| -> Result<BTreeSet<_>> {
        let entries = fs::read_dir(folder).map_err(|e| Error::reading(folder, &e))?;
        let names = entries.flatten().map(|entry| entry.path()).filter(|path| {
            path.is_file() && ["exr", "hdr", "png", "jpg", "jpeg"].iter().any(|ending| has_extension(path, ending))
        });
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

fn and_more(n: usize) -> String {
    if n == 0 { String::new() } else { format!(" and {n} more") }
}

fn write_csv(path: &Path, reports: &[Report]) -> Result<()> {
    let quoted = |path: &Path| format!("\"{}\"", path.display().to_string().replace('"', "\"\""));
    atomic::write(path, |file| {
        writeln!(file, "a,b,width,height,rel_mse,rmse,mae,flip,bias_r,bias_g,bias_b,z_r,z_g,z_b,within")?;
        for report in reports {
            let c = report.comparison;
            let [r, g, b] = c.bias;
            // Without variance there is no z.
            let z = c
                .statistics
                .as_ref()
                .map_or([String::new(), String::new(), String::new()], |s| s.bias_z.map(|z| z.to_string()));
            writeln!(
                file,
                "{},{},{},{},{},{},{},{},{r},{g},{b},{},{}",
                quoted(report.a),
                quoted(report.b),
                c.width,
                c.height,
                c.rel_mse,
                c.rmse,
                c.mae,
                c.flip,
                z.join(","),
                report.within
            )?;
        }
        Ok(Ok(()))
    })
}

fn failures(args: &CompareArgs, comparison: &Comparison) -> Result<Vec<String>> {
    let mut failures = Vec::new();
    let beyond = |value: f64, most: f64| value.is_nan() || value > most;
    if let Some(most) = args.max_relmse {
        // NaN is beyond everything.
        if beyond(comparison.rel_mse, most) {
            failures.push(format!("relMSE {} is beyond {most}", short(comparison.rel_mse)));
        }
        if comparison.not_finite[0] > 0 {
            failures.push(format!("{} pixels of A are not finite", comparison.not_finite[0]));
        }
    }
    if let Some(most) = args.max_flip.filter(|most| beyond(comparison.flip, *most)) {
        failures.push(format!("FLIP {} is beyond {most}", short(comparison.flip)));
    }
    if let Some(most) = args.max_z {
        let Some(statistics) = &comparison.statistics else {
            return Err(Error::Data(
                "--max-z: both pictures must carry variance (channels variance.R, .G, .B): render with --aov variance"
                    .into(),
            ));
        };
        for (z, channel) in statistics.bias_z.iter().zip(["R", "G", "B"]) {
            if beyond(z.abs(), most) {
                failures.push(format!("{channel}: the bias has z = {}, beyond {most}", short(*z)));
            }
        }
    }
    Ok(failures)
}

fn short(x: f64) -> String {
    if x == 0.0 || (1e-3..1e4).contains(&x.abs()) { format!("{x:.4}") } else { format!("{x:.3e}") }
}

/// A line for each pair.
fn overview(pairs: &[Pair]) -> String {
    let mut text = format!("{:>12}{:>12}{:>12}{:>12}  picture\n", "relMSE", "RMSE", "MAE", "FLIP");
    for Pair { a, comparison: c, .. } in pairs {
        let [rel_mse, rmse, mae, flip] = [c.rel_mse, c.rmse, c.mae, c.flip].map(short);
        let name = a.file_name().unwrap_or_default().display();
        text += &format!("{rel_mse:>12}{rmse:>12}{mae:>12}{flip:>12}  {name}\n");
    }
    text.trim_end().to_owned()
}

fn table(Pair { a, b, comparison: c, .. }: &Pair) -> String {
    let row = |name: &str, values: &[f64; 3]| {
        format!("{name:<10}{:>12}{:>12}{:>12}\n", short(values[0]), short(values[1]), short(values[2]))
    };
    let mut text = format!("A  {}\nB  {}  (the reference)\n", a.display(), b.display());
    text += &format!("{} x {} pixels\n\n", c.width, c.height);
    if c.not_finite != [0, 0] {
        text += &format!("not finite, left out: {} pixels of A, {} of B\n\n", c.not_finite[0], c.not_finite[1]);
    }
    for (name, value) in [("relMSE", c.rel_mse), ("RMSE", c.rmse), ("MAE", c.mae), ("FLIP", c.flip)] {
        text += &format!("{name:<10}{:>12}\n", short(value));
    }
    text += &format!("\n{:<10}{:>12}{:>12}{:>12}\n", "", "R", "G", "B");
    text += &row("mean of B", &c.reference_mean);
    text += &row("bias A-B", &c.bias);
    match &c.statistics {
        None => text += "\nno z: not both pictures carry variance",
        Some(s) => {
            text += &row("z of bias", &s.bias_z);
            let percent = |x: f64| format!("{:.3} %", x * 100.0);
            text += &format!(
                "\npixels' z  deviation {} (noise as estimated: 1), |z| > 3 in {} (normal: {})",
                short(s.z_deviation),
                percent(s.beyond_3),
                percent(s.beyond_3_expected)
            );
            if let Some((z, [x, y])) = s.largest {
                text += &format!(", largest {} at ({x}, {y})", short(z));
            }
        }
    }
    text
}

fn has_extension(path: &Path, extension: &str) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case(extension))
}

fn write_difference(path: &Path, a: &Picture, b: &Picture) -> Result<()> {
    let pairs = a.rgb.iter().zip(&b.rgb);
    if has_extension(path, "exr") {
        let signed = pairs.map(|(x, y)| std::array::from_fn(|c| x[c] - y[c])).collect::<Vec<_>>();
        return exr_file::write_rgb(path, a.window, a.display, &signed);
    }
    let bytes = pairs.flat_map(|(x, y)| false_color(relative_difference(x, y)).map(preview::to_byte));
    let [width, height] = a.size();
    preview::write_rgb8(path, width as u32, height as u32, &bytes.collect::<Vec<_>>())
}

/// Root mean square over the channels of (a - b) / sqrt(b^2 + 0.01): a pixel's share of relMSE, rooted.
fn relative_difference(a: &[f32; 3], b: &[f32; 3]) -> f32 {
    let squares = a.iter().zip(b).map(|(a, b)| (a - b).powi(2) / (b * b + REL_MSE_EPSILON as f32));
    (squares.sum::<f32>() / 3.0).sqrt()
}

/// Black over purple and orange to pale yellow; green for what is not finite.
fn false_color(x: f32) -> [f32; 3] {
    const STOPS: [[f32; 3]; 5] =
        [[0.0, 0.0, 0.0], [0.34, 0.06, 0.43], [0.73, 0.21, 0.33], [0.98, 0.55, 0.04], [0.99, 1.0, 0.64]];
    if !x.is_finite() {
        return [0.0, 1.0, 0.0];
    }
    let t = x.clamp(0.0, 1.0) * 4.0;
    let i = (t as usize).min(3);
    std::array::from_fn(|c| STOPS[i][c] + (STOPS[i + 1][c] - STOPS[i][c]) * (t - i as f32))
}
