//! Compared pictures as text, JSON and CSV.

use std::io::Write;
use std::path::{Path, PathBuf};

use serde::{Serialize, Serializer};

use crate::film::atomic;
use crate::film::compare::Comparison;

/// What `--json` prints of a pair.
#[derive(Serialize)]
pub struct Report<'a> {
    #[serde(serialize_with = "shown")]
    pub a: &'a Path,
    #[serde(serialize_with = "shown")]
    pub b: &'a Path,
    pub reference: &'static str,
    #[serde(flatten)]
    pub comparison: &'a Comparison,
    pub max_relmse: Option<f64>,
    pub max_flip: Option<f64>,
    pub max_z: Option<f64>,
    pub within: bool,
}

/// A path in JSON, as errors show it: it need not be UTF-8.
pub fn shown<S: Serializer>(path: &Path, to: S) -> Result<S::Ok, S::Error> {
    to.collect_str(&path.display())
}

pub struct Pair {
    pub a: PathBuf,
    pub b: PathBuf,
    pub comparison: Comparison,
    /// Thresholds that it exceeds, as text.
    pub failures: Vec<String>,
}

/// " and N more", or nothing for 0.
pub(crate) fn and_more(n: usize) -> String {
    if n == 0 { String::new() } else { format!(" and {n} more") }
}

pub fn write_csv(path: &Path, reports: &[Report]) -> crate::Result<()> {
    let quoted = |path: &Path| format!("\"{}\"", path.display().to_string().replace('"', "\"\""));
    atomic::write(path, |file| {
        writeln!(file, "a,b,width,height,rel_mse,rmse,mae,flip,bias_r,bias_g,bias_b,z_r,z_g,z_b,within")?;
        for report in reports {
            let c = report.comparison;
            let [r, g, b] = c.bias;
            // z needs the variance of both pictures.
            let z = c.statistics.as_ref().map(|s| s.bias_z.map(|z| z.to_string())).unwrap_or_default();
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

/// A number with four decimals, or in scientific notation.
pub fn short(x: f64) -> String {
    if x == 0.0 || (1e-3..1e4).contains(&x.abs()) { format!("{x:.4}") } else { format!("{x:.3e}") }
}

/// Table with one line per pair.
pub fn overview(pairs: &[Pair]) -> String {
    let mut text = format!("{:>12}{:>12}{:>12}{:>12}  picture\n", "relMSE", "RMSE", "MAE", "FLIP");
    for Pair { a, comparison: c, .. } in pairs {
        let [rel_mse, rmse, mae, flip] = [c.rel_mse, c.rmse, c.mae, c.flip].map(short);
        let name = a.file_name().unwrap_or_default().display();
        text += &format!("{rel_mse:>12}{rmse:>12}{mae:>12}{flip:>12}  {name}\n");
    }
    text.trim_end().to_owned()
}

pub fn table(Pair { a, b, comparison: c, .. }: &Pair) -> String {
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
        None => text += "\nno z: not both pictures have variance",
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
