//! FLIP: the perceived difference of two pictures when they are alternated. After Andersson, Nilsson,
//! Akenine-Möller, Oskarsson, Åström and Fairchild, "FLIP: A Difference Evaluator for Alternating Images", HPG 2020, and
//! for high dynamic range Andersson, Nilsson, Shirley and Akenine-Möller, "Visualizing Errors in Rendered High Dynamic
//! Range Images", Eurographics 2021. Constants are those of the authors' implementation (flip-evaluator 1.7), to which
//! `tests/flip.rs` compares this one.

use std::f32::consts::PI;

use glam::{Mat3, Vec3};
use rayon::prelude::*;

use crate::color::luminance;

/// Pixels per degree of visual angle: 0.7 m from a screen that is 0.7 m and 3840 pixels wide.
const PIXELS_PER_DEGREE: f32 = 67.020_64;

/// FLIP error of each pixel in [0, 1], row by row, of linear RGB `test` against `reference` with `width` pixels per row. If
/// `displayed`, the values are display-referred in [0, 1] (LDR-FLIP). Otherwise the error is the largest over a range of
/// exposures (HDR-FLIP). Values that are not finite count as black.
pub fn flip(reference: &[[f32; 3]], test: &[[f32; 3]], width: usize, displayed: bool) -> Vec<f32> {
    let clean = |p: &[f32; 3]| Vec3::from(p.map(|x| if x.is_finite() { x } else { 0.0 }));
    let [reference, test] = [reference, test].map(|all| all.iter().map(clean).collect::<Vec<_>>());
    if reference.is_empty() || width == 0 {
        return Vec::new();
    }
    let shown = |pixels: &[Vec3], f: &(dyn Fn(Vec3) -> Vec3 + Sync)| -> Vec<Vec3> {
        pixels.par_iter().map(|p| f(*p).clamp(Vec3::ZERO, Vec3::ONE)).collect()
    };
    if displayed {
        return difference(&shown(&reference, &|p| p), &shown(&test, &|p| p), width);
    }
    let mut worst = vec![0.0_f32; reference.len()];
    for exposure in exposures(&reference) {
        let gain = exposure.exp2();
        let f = |p: Vec3| tone_mapped(p.max(Vec3::ZERO) * gain);
        let error = difference(&shown(&reference, &f), &shown(&test, &f), width);
        worst.iter_mut().zip(error).for_each(|(worst, e)| *worst = worst.max(e));
    }
    worst
}

/// Coefficients of K. Narkowicz's fit of ACES, with a factor 0.6 on the input.
const ACES: [f32; 6] = [0.6 * 0.6 * 2.51, 0.6 * 0.03, 0.0, 0.6 * 0.6 * 2.43, 0.6 * 0.59, 0.14];

fn tone_mapped(x: Vec3) -> Vec3 {
    let [a, b, c, d, e, f] = ACES;
    (x * x * a + x * b + c) / (x * x * d + x * e + f)
}

/// Exposures in stops, from that which maps the brightest pixel to 0.85 to that which maps the median one to 0.85.
fn exposures(reference: &[Vec3]) -> Vec<f32> {
    const SHOWN: f32 = 0.85;
    let [a, b, c] = std::array::from_fn(|i| SHOWN * ACES[i + 3] - ACES[i]);
    let bright = (-b + (b * b - 4.0 * a * c).sqrt()) / (2.0 * a);
    let bright = bright.max((-b - (b * b - 4.0 * a * c).sqrt()) / (2.0 * a));
    let mut all: Vec<f32> = reference.iter().map(|p| luminance(p.max(Vec3::ZERO))).collect();
    all.sort_unstable_by(f32::total_cmp);
    let (middle, most) = (all.len() / 2, all[all.len() - 1]);
    let median = if all.len().is_multiple_of(2) { 0.5 * (all[middle - 1] + all[middle]) } else { all[middle] };
    // The bound is for black pictures.
    let [start, stop] = [most, median].map(|l| (bright / l.max(1e-6)).log2());
    let n = ((stop - start).ceil() as usize).clamp(2, 64);
    (0..n).map(|i| start + (stop - start) * i as f32 / (n - 1) as f32).collect()
}

/// FLIP of two pictures of linear RGB in [0, 1].
fn difference(reference: &[Vec3], test: &[Vec3], width: usize) -> Vec<f32> {
    let colors = [reference, test].map(|picture| perceived(picture, width));
    let features = [reference, test].map(|picture| features(picture, width));
    let most = hyab(hunt(Vec3::Y), hunt(Vec3::Z)).powf(COLOR_EXPONENT);
    let n = colors[0].len();
    (0..n)
        .into_par_iter()
        .map(|i| {
            let color = redistributed(hyab(colors[0][i], colors[1][i]).powf(COLOR_EXPONENT), most);
            let [a, b] = [features[0][i], features[1][i]];
            let feature = (a.0 - b.0).abs().max((a.1 - b.1).abs());
            let feature = (std::f32::consts::FRAC_1_SQRT_2 * feature).powf(FEATURE_EXPONENT);
            color.powf(1.0 - feature)
        })
        .collect()
}

const COLOR_EXPONENT: f32 = 0.7;
const FEATURE_EXPONENT: f32 = 0.5;
/// Width of features in degrees of visual angle.
const FEATURE_WIDTH: f32 = 0.082;

/// Maps differences up to 0.4 of the largest to the lower 0.95 of the scale.
fn redistributed(difference: f32, most: f32) -> f32 {
    const KNEE: f32 = 0.4;
    const TARGET: f32 = 0.95;
    let knee = KNEE * most;
    match difference < knee {
        true => difference * TARGET / knee,
        false => TARGET + (difference - knee) / (most - knee) * (1.0 - TARGET),
    }
}

/// Filters the colours by contrast sensitivity functions, which are sums of Gaussians in an opponent space (Johnson and
/// Fairchild), and converts them to CIELAB with the Hunt effect.
fn perceived(picture: &[Vec3], width: usize) -> Vec<Vec3> {
    const RADIUS_WIDTH: f32 = 0.04;
    let radius = (3.0 * (RADIUS_WIDTH / (2.0 * PI * PI)).sqrt() * PIXELS_PER_DEGREE).ceil() as i32;
    // A term a·sqrt(π/b)·exp(−π²d²/b) of the two-dimensional kernel is the product of two of these.
    let gaussian = |a: f32, b: f32| -> Vec<f32> {
        let at = |i: i32| {
            let d = i as f32 / PIXELS_PER_DEGREE;
            (a * (PI / b).sqrt()).sqrt() * (-PI * PI * d * d / b).exp()
        };
        (-radius..=radius).map(at).collect()
    };
    let normalised = |kernel: Vec<f32>| {
        let sum: f32 = kernel.iter().sum();
        kernel.into_iter().map(|k| k / sum).collect::<Vec<_>>()
    };
    let (achromatic, red_green) = (normalised(gaussian(1.0, 0.0047)), normalised(gaussian(1.0, 0.0053)));
    let (wide, narrow) = (gaussian(34.1, 0.04), gaussian(13.5, 0.025));
    let total = wide.iter().sum::<f32>().powi(2) + narrow.iter().sum::<f32>().powi(2);
    let opponent: Vec<Vec3> = picture.par_iter().map(|p| opponent(*p)).collect();
    let blurred = |component: usize, kernel: &[f32]| {
        let plane: Vec<f32> = opponent.iter().map(|p| p[component]).collect();
        convolve(&plane, width, kernel, kernel)
    };
    let (y, cx) = (blurred(0, &achromatic), blurred(1, &red_green));
    let (a, b) = (blurred(2, &wide), blurred(2, &narrow));
    (0..y.len())
        .into_par_iter()
        .map(|i| hunt(from_opponent(Vec3::new(y[i], cx[i], (a[i] + b[i]) / total)).clamp(Vec3::ZERO, Vec3::ONE)))
        .collect()
}

/// Strengths of edges and of points at each pixel.
fn features(picture: &[Vec3], width: usize) -> Vec<(f32, f32)> {
    let deviation = 0.5 * FEATURE_WIDTH * PIXELS_PER_DEGREE;
    let radius = (3.0 * deviation).ceil() as i32;
    let kernel = |f: &dyn Fn(f32) -> f32| -> Vec<f32> {
        let values =
            (-radius..=radius).map(|i| i as f32).map(|x| f(x) * (-x * x / (2.0 * deviation * deviation)).exp());
        let values: Vec<f32> = values.collect();
        // Positive and negative weights each add up to one.
        let sum = |sign: f32| values.iter().map(|v| (v * sign).max(0.0)).sum::<f32>().max(f32::MIN_POSITIVE);
        let (plus, minus) = (sum(1.0), sum(-1.0));
        values.iter().map(|v| if *v > 0.0 { v / plus } else { v / minus }).collect()
    };
    let smooth = kernel(&|_| 1.0);
    let edge = kernel(&|x| -x);
    let point = kernel(&|x| (x / deviation).powi(2) - 1.0);
    let grey: Vec<f32> = picture.par_iter().map(|p| (opponent(*p).x + 16.0) / 116.0).collect();
    let along = |x: &[f32], y: &[f32]| convolve(&grey, width, x, y);
    let (ex, ey) = (along(&edge, &smooth), along(&smooth, &edge));
    let (px, py) = (along(&point, &smooth), along(&smooth, &point));
    (0..grey.len()).map(|i| (ex[i].hypot(ey[i]), px[i].hypot(py[i]))).collect()
}

/// Convolution with a kernel along x and one along y; pixels outside have the value of the nearest one inside.
fn convolve(plane: &[f32], width: usize, x_kernel: &[f32], y_kernel: &[f32]) -> Vec<f32> {
    let height = plane.len() / width;
    let radius = x_kernel.len() / 2;
    let mut rows = vec![0.0; plane.len()];
    rows.par_chunks_mut(width).zip(plane.par_chunks(width)).for_each(|(out, row)| {
        let mut padded = vec![row[0]; radius];
        padded.extend_from_slice(row);
        padded.resize(width + 2 * radius, row[width - 1]);
        for (k, weight) in x_kernel.iter().enumerate() {
            out.iter_mut().zip(&padded[k..]).for_each(|(o, p)| *o += weight * p);
        }
    });
    let mut all = vec![0.0; plane.len()];
    all.par_chunks_mut(width).enumerate().for_each(|(y, out)| {
        for (k, weight) in y_kernel.iter().enumerate() {
            let from = (y + k).saturating_sub(radius).min(height - 1);
            out.iter_mut().zip(&rows[from * width..]).for_each(|(o, p)| *o += weight * p);
        }
    });
    all
}

/// Linear sRGB to XYZ, from the exact primaries.
const TO_XYZ: Mat3 = Mat3::from_cols(
    Vec3::new(10_135_552.0 / 24_577_794.0, 2_613_072.0 / 12_288_897.0, 1_425_312.0 / 73_733_382.0),
    Vec3::new(8_788_810.0 / 24_577_794.0, 8_788_810.0 / 12_288_897.0, 8_788_810.0 / 73_733_382.0),
    Vec3::new(4_435_075.0 / 24_577_794.0, 887_015.0 / 12_288_897.0, 70_074_185.0 / 73_733_382.0),
);
/// XYZ of the white point D65.
const WHITE: Vec3 = Vec3::new(0.950_428_55, 1.0, 1.088_900_4);

/// Linear RGB to the opponent space Y, Cx, Cz: CIELAB without the cube root.
fn opponent(rgb: Vec3) -> Vec3 {
    let n = TO_XYZ * rgb / WHITE;
    Vec3::new(116.0 * n.y - 16.0, 500.0 * (n.x - n.y), 200.0 * (n.y - n.z))
}

fn from_opponent(color: Vec3) -> Vec3 {
    let y = (color.x + 16.0) / 116.0;
    let n = Vec3::new(y + color.y / 500.0, y, y - color.z / 200.0);
    TO_XYZ.inverse() * (n * WHITE)
}

/// CIELAB of linear RGB with the Hunt effect: less chroma at low lightness.
fn hunt(rgb: Vec3) -> Vec3 {
    const DELTA: f32 = 6.0 / 29.0;
    let n = TO_XYZ * rgb / WHITE;
    let root = |t: f32| if t > DELTA.powi(3) { t.cbrt() } else { t / (3.0 * DELTA * DELTA) + 4.0 / 29.0 };
    let [x, y, z] = n.to_array().map(root);
    let lightness = 116.0 * y - 16.0;
    Vec3::new(lightness, 0.01 * lightness * 500.0 * (x - y), 0.01 * lightness * 200.0 * (y - z))
}

/// The HyAB distance: city-block in lightness, Euclidean in chroma.
fn hyab(a: Vec3, b: Vec3) -> f32 {
    let d = a - b;
    d.x.abs() + d.y.hypot(d.z)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_picture_has_no_difference_from_itself_and_green_from_blue_has_all() {
        let grey: Vec<_> = (0..600).map(|i| [i as f32 / 300.0; 3]).collect();
        for displayed in [false, true] {
            assert_eq!(flip(&grey, &grey, 30, displayed), vec![0.0; 600]);
        }
        let [green, blue] = [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(|c| vec![c; 600]);
        assert!(flip(&green, &blue, 30, true).iter().all(|e| (e - 1.0).abs() < 1e-3));
        assert!(flip(&[], &[], 30, false).is_empty());
        let black = vec![[0.0; 3]; 600];
        assert!(flip(&black, &black, 30, false).iter().all(|e| *e == 0.0));
        let broken = vec![[f32::NAN, f32::INFINITY, -1.0]; 600];
        assert!(flip(&broken, &grey, 30, false).iter().all(|e| (0.0..=1.0).contains(e)));
    }
}
