//! Picture of a difference, in false colours or as signed values.

use std::path::Path;

use crate::Result;
use crate::cli::options::has_ending;
use crate::film::compare::REL_MSE_EPSILON;
use crate::film::{Picture, exr_file, preview};

/// Writes the file of `--diff`: signed A - B for .exr, else the relative difference in false colours.
pub(crate) fn write_difference(path: &Path, a: &Picture, b: &Picture) -> Result<()> {
    let pairs = a.rgb.iter().zip(&b.rgb);
    if has_ending(path, &["exr"]) {
        let signed = pairs.map(|(x, y)| std::array::from_fn(|c| x[c] - y[c])).collect::<Vec<_>>();
        return exr_file::write_rgb(path, a.window, a.display, &signed);
    }
    let bytes = pairs.flat_map(|(x, y)| false_color(relative_difference(x, y)).map(preview::to_byte));
    let [width, height] = a.size();
    preview::write_rgb8(path, width as u32, height as u32, &bytes.collect::<Vec<_>>())
}

/// Root mean square over the channels of (a - b) / sqrt(b^2 + 0.01): the square root of a pixel's relMSE.
fn relative_difference(a: &[f32; 3], b: &[f32; 3]) -> f32 {
    let squares = a.iter().zip(b).map(|(a, b)| (a - b).powi(2) / (b * b + REL_MSE_EPSILON as f32));
    (squares.sum::<f32>() / 3.0).sqrt()
}

/// Black over purple and orange to pale yellow; green for what is not finite.
pub fn false_color(x: f32) -> [f32; 3] {
    const STOPS: [[f32; 3]; 5] =
        [[0.0, 0.0, 0.0], [0.34, 0.06, 0.43], [0.73, 0.21, 0.33], [0.98, 0.55, 0.04], [0.99, 1.0, 0.64]];
    if !x.is_finite() {
        return [0.0, 1.0, 0.0];
    }
    let t = x.clamp(0.0, 1.0) * 4.0;
    let i = (t as usize).min(3);
    std::array::from_fn(|c| STOPS[i][c] + (STOPS[i + 1][c] - STOPS[i][c]) * (t - i as f32))
}
