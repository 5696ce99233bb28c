//! `bismar compare A.exr B.exr`

use std::path::{Path, PathBuf};

use clap::Args;
use serde::Serialize;

use crate::console::{Paths, Verdict, print, print_json, say};
use crate::film::compare::{Comparison, REL_MSE_EPSILON, compare};
use crate::film::{Picture, atomic, exr_file, preview};
use crate::{Error, Result};

/// Compare a picture with a reference: relMSE, RMSE, MAE, bias, and z where both carry variance.
#[derive(Debug, Args)]
pub struct CompareArgs {
    /// The picture.
    a: PathBuf,
    /// The reference: what relMSE divides by, and what a bias is measured from.
    b: PathBuf,
    /// Print JSON.
    #[arg(long)]
    json: bool,
    /// Exit with 1 if relMSE is beyond this, or A has a value that is not finite.
    #[arg(long, value_name = "X", value_parser = positive_or_zero)]
    max_relmse: Option<f64>,
    /// Exit with 1 if a channel's bias has |z| beyond this; both pictures must carry variance.
    #[arg(long, value_name = "X", value_parser = positive_or_zero)]
    max_z: Option<f64>,
    /// Write a picture of the difference: .png of |A - B| / sqrt(B^2 + 0.01) in false colours (black 0 to pale
    /// yellow 1, green not finite), or .exr of A - B.
    #[arg(long, value_name = "FILE")]
    diff: Option<PathBuf>,
}

fn positive_or_zero(text: &str) -> std::result::Result<f64, String> {
    text.parse().ok().filter(|x: &f64| *x >= 0.0 && x.is_finite()).ok_or("not a number of 0 or more".into())
}

#[derive(Serialize)]
struct Report<'a> {
    a: &'a Path,
    b: &'a Path,
    reference: &'static str,
    #[serde(flatten)]
    comparison: &'a Comparison,
    max_relmse: Option<f64>,
    max_z: Option<f64>,
    within: bool,
}

pub fn run(args: &CompareArgs) -> Result<Verdict> {
    if let Some(path) = &args.diff {
        if !has_extension(path, "png") && !has_extension(path, "exr") {
            return Err(Error::Usage(format!("--diff {}: the name must end in .png or .exr", path.display())));
        }
        let mut paths = Paths::default();
        [&args.a, &args.b].into_iter().try_for_each(|picture| paths.reads("the picture", picture))?;
        paths.writes("--diff", path)?;
        atomic::check(path)?;
    }
    let (a, b) = (exr_file::read(&args.a)?, exr_file::read(&args.b)?);
    let comparison =
        compare(&a, &b).map_err(|why| Error::Data(format!("{} and {}: {why}", args.a.display(), args.b.display())))?;
    let failures = failures(args, &comparison)?;
    if let Some(path) = &args.diff {
        write_difference(path, &a, &b)?;
    }
    if args.json {
        let (max_relmse, max_z) = (args.max_relmse, args.max_z);
        let within = failures.is_empty();
        let (a, b, comparison) = (&args.a, &args.b, &comparison);
        print_json(&Report { a, b, reference: "b", comparison, max_relmse, max_z, within })?;
    } else {
        print(table(args, &comparison))?;
    }
    for failure in &failures {
        say(failure);
    }
    Ok(if failures.is_empty() { Verdict::Done } else { Verdict::Beyond })
}

fn failures(args: &CompareArgs, comparison: &Comparison) -> Result<Vec<String>> {
    let mut failures = Vec::new();
    if let Some(most) = args.max_relmse {
        // NaN is beyond everything.
        if comparison.rel_mse.is_nan() || comparison.rel_mse > most {
            failures.push(format!("relMSE {} is beyond {most}", short(comparison.rel_mse)));
        }
        if comparison.not_finite[0] > 0 {
            failures.push(format!("{} pixels of A are not finite", comparison.not_finite[0]));
        }
    }
    if let Some(most) = args.max_z {
        let Some(statistics) = &comparison.statistics else {
            return Err(Error::Data(
                "--max-z: both pictures must carry variance (channels variance.R, .G, .B): render with --aov variance"
                    .into(),
            ));
        };
        for (z, channel) in statistics.bias_z.iter().zip(["R", "G", "B"]) {
            if z.is_nan() || z.abs() > most {
                failures.push(format!("{channel}: the bias has z = {}, beyond {most}", short(*z)));
            }
        }
    }
    Ok(failures)
}

fn short(x: f64) -> String {
    if x == 0.0 || (1e-3..1e4).contains(&x.abs()) { format!("{x:.4}") } else { format!("{x:.3e}") }
}

fn table(args: &CompareArgs, c: &Comparison) -> String {
    let row = |name: &str, values: &[f64; 3]| {
        format!("{name:<10}{:>12}{:>12}{:>12}\n", short(values[0]), short(values[1]), short(values[2]))
    };
    let mut text = format!("A  {}\nB  {}  (the reference)\n", args.a.display(), args.b.display());
    text += &format!("{} x {} pixels\n\n", c.width, c.height);
    if c.not_finite != [0, 0] {
        text += &format!("not finite, left out: {} pixels of A, {} of B\n\n", c.not_finite[0], c.not_finite[1]);
    }
    for (name, value) in [("relMSE", c.rel_mse), ("RMSE", c.rmse), ("MAE", c.mae)] {
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
    let [x0, y0, x1, y1] = a.window;
    preview::write_rgb8(path, (x1 - x0) as u32, (y1 - y0) as u32, &bytes.collect::<Vec<_>>())
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
