//! Comparison of a picture with a reference.

use serde::Serialize;

use super::flip::flip;
use super::picture::Picture;

/// Added to the squared reference in [`Comparison::rel_mse`], so that black pixels do not dominate.
pub const REL_MSE_EPSILON: f64 = 0.01;

/// The divisor of a squared difference in relMSE: the squared reference value plus [`REL_MSE_EPSILON`].
pub fn relative_to(reference: f64) -> f64 {
    reference * reference + REL_MSE_EPSILON
}

/// One pixel in so many, the one with the largest variance, is left out where a pre-pass compares variances: with few paths
/// its variance is mostly chance.
const PIXELS_PER_OUTLIER: usize = 100;

/// Sums over pixels of the variances by two methods. Pixels that are not finite are left out, and so is the hundredth of the
/// others whose sum of both is largest.
pub fn sums_without_outliers(mut pixels: Vec<[f64; 2]>) -> [f64; 2] {
    pixels.retain(|[a, b]| (a + b).is_finite());
    pixels.sort_by(|[a, b], [c, d]| (a + b).total_cmp(&(c + d)));
    pixels.truncate(pixels.len() - pixels.len() / PIXELS_PER_OUTLIER);
    pixels.iter().fold([0.0; 2], |[a, b], [c, d]| [a + c, b + d])
}

/// The fraction of a standard normal distribution with |z| > 3.
const NORMAL_BEYOND_3: f64 = 0.002_699_796;

/// Errors of a picture A against a reference B. Means are over pixels and, unless they are arrays, over channels. Pixels where
/// A or B is not finite are counted and left out.
#[derive(Debug, Clone, Serialize)]
pub struct Comparison {
    /// Width of the window in pixels.
    pub width: u64,
    /// Height of the window in pixels.
    pub height: u64,
    /// Number of pixels that are not finite, in A and in B.
    pub not_finite: [u64; 2],
    /// mean((a − b)² / (b² + 0.01)); NaN (null in JSON) without a pixel to compare.
    pub rel_mse: f64,
    /// √mean((a − b)²).
    pub rmse: f64,
    /// mean(|a − b|).
    pub mae: f64,
    /// Mean of [`flip`]: its LDR variant if both pictures are display-referred, otherwise HDR-FLIP.
    pub flip: f64,
    /// mean(a − b) of R, G, B.
    pub bias: [f64; 3],
    /// Mean of B's R, G, B, to judge the bias by.
    pub reference_mean: [f64; 3],
    /// Present if both pictures have variances.
    pub statistics: Option<Statistics>,
}

/// Whether the difference is noise, by the variances of both pictures. z is a difference over its standard deviation
/// √(variance of A + variance of B), for renders with independent samples. That of the mean counts how paths are stratified and how
/// pixels share them ([`Picture::mean_variance`]).
#[derive(Debug, Clone, Serialize)]
pub struct Statistics {
    /// z of the mean difference of R, G, B over all pixels; beyond ±4 is not noise. Infinite (null in JSON) for a difference
    /// without variance, NaN where a variance is not finite.
    pub bias_z: [f64; 3],
    /// Standard deviation of the pixels' z about zero: 1 for noise as estimated, less for stratified sample sequences.
    pub z_deviation: f64,
    /// Fraction of pixel values with |z| > 3.
    pub beyond_3: f64,
    /// The same fraction for a normal distribution.
    pub beyond_3_expected: f64,
    /// Largest |z| and its pixel (x, y in the picture); absent without a difference.
    pub largest: Option<(f64, [i64; 2])>,
    /// Number of pixel values with a z: those with variance or with a difference.
    pub values: u64,
}

/// FLIP error in [0, 1] of each pixel of A against B, which have equal windows.
pub fn flip_map(a: &Picture, b: &Picture) -> Vec<f32> {
    flip(&b.rgb, &a.rgb, a.size()[0], a.displayed && b.displayed)
}

/// The common window of two pictures of which one is a crop of the other.
///
/// # Errors
/// A sentence if their display windows differ or neither window lies in the other.
pub fn in_common(a: &Picture, b: &Picture) -> Result<(Picture, Picture), String> {
    let inside = |[x0, y0, x1, y1]: [i64; 4], w: [i64; 4]| x0 >= w[0] && y0 >= w[1] && x1 <= w[2] && y1 <= w[3];
    let window = if inside(a.window, b.window) { a.window } else { b.window };
    if a.display != b.display || !(inside(window, a.window) && inside(window, b.window)) {
        // For the error that says which windows differ.
        compare(a, b)?;
    }
    Ok((a.within(window), b.within(window)))
}

/// Compares a picture A with a reference B.
///
/// # Errors
/// A sentence if their windows differ.
pub fn compare(a: &Picture, b: &Picture) -> Result<Comparison, String> {
    for (what, x, y) in [("data", a.window, b.window), ("display", a.display, b.display)] {
        if x != y {
            let show = |[x0, y0, x1, y1]: [i64; 4]| format!("{} x {} from ({x0}, {y0})", x1 - x0, y1 - y0);
            return Err(format!("the pictures' {what} windows differ: {} and {}", show(x), show(y)));
        }
    }
    let finite = |p: &[f32; 3]| p.iter().all(|x| x.is_finite());
    let [mut squared, mut relative, mut absolute] = [0.0; 3];
    let (mut bias, mut reference_mean) = ([0.0; 3], [0.0; 3]);
    let mut not_finite = [0; 2];
    let mut pixels = 0_u64;
    for (x, y) in a.rgb.iter().zip(&b.rgb) {
        not_finite[0] += u64::from(!finite(x));
        not_finite[1] += u64::from(!finite(y));
        if !finite(x) || !finite(y) {
            continue;
        }
        pixels += 1;
        for c in 0..3 {
            let (x, y) = (f64::from(x[c]), f64::from(y[c]));
            let d = x - y;
            squared += d * d;
            relative += d * d / relative_to(y);
            absolute += d.abs();
            bias[c] += d;
            reference_mean[c] += y;
        }
    }
    let (n, values) = (pixels as f64, 3.0 * pixels as f64);
    let flip = flip_map(a, b);
    let [width, height] = a.size().map(|side| side as u64);
    Ok(Comparison {
        width,
        height,
        not_finite,
        rel_mse: relative / values,
        rmse: (squared / values).sqrt(),
        mae: absolute / values,
        flip: flip.iter().map(|e| f64::from(*e)).sum::<f64>() / flip.len() as f64,
        bias: bias.map(|s| s / n),
        reference_mean: reference_mean.map(|s| s / n),
        statistics: statistics(a, b),
    })
}

fn statistics(a: &Picture, b: &Picture) -> Option<Statistics> {
    let [width, _] = a.size();
    let (va, vb) = (a.variance.as_ref()?, b.variance.as_ref()?);
    let (mut difference, mut variance) = ([0.0; 3], [0.0; 3]);
    let (mut values, mut beyond, mut sum_squared) = (0_u64, 0_u64, 0.0);
    let mut largest: Option<(f64, usize)> = None;
    for i in 0..a.rgb.len() {
        for c in 0..3 {
            let d = f64::from(a.rgb[i][c]) - f64::from(b.rgb[i][c]);
            let v = f64::from(va[i][c]) + f64::from(vb[i][c]);
            if !d.is_finite() || v < 0.0 {
                continue;
            }
            if !v.is_finite() {
                // Then z of the mean is not known.
                difference[c] = f64::NAN;
                continue;
            }
            difference[c] += d;
            variance[c] += f64::from(va[i][c]) * a.mean_variance[c] + f64::from(vb[i][c]) * b.mean_variance[c];
            let z = z_score(d, v);
            // Equal values without variance, such as a background, say nothing about noise.
            if v == 0.0 && d == 0.0 {
                continue;
            }
            values += 1;
            beyond += u64::from(z.abs() > 3.0);
            sum_squared += z * z;
            if d != 0.0 && largest.is_none_or(|(most, _)| z.abs() > most) {
                largest = Some((z.abs(), i));
            }
        }
    }
    let at = |i: usize| [a.window[0] + (i % width) as i64, a.window[1] + (i / width) as i64];
    let fraction = |x: f64| if values == 0 { 0.0 } else { x / values as f64 };
    Some(Statistics {
        bias_z: std::array::from_fn(|c| z_score(difference[c], variance[c])),
        z_deviation: fraction(sum_squared).sqrt(),
        beyond_3: fraction(beyond as f64),
        beyond_3_expected: NORMAL_BEYOND_3,
        largest: largest.map(|(z, i)| (z, at(i))),
        values,
    })
}

/// The difference over its standard deviation; zero without difference, whatever the variance.
fn z_score(difference: f64, variance: f64) -> f64 {
    if difference == 0.0 { 0.0 } else { difference / variance.sqrt() }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(rgb: Vec<[f32; 3]>, variance: Option<f32>) -> Picture {
        let window = [5, 7, 5 + rgb.len() as i64, 8];
        let variance = variance.map(|v| vec![[v; 3]; rgb.len()]);
        Picture {
            window,
            display: [0, 0, 100, 100],
            variance,
            rgb,
            alpha: None,
            displayed: false,
            mean_variance: [1.0; 3],
        }
    }

    #[test]
    fn numbers_follow_their_formulas_with_b_as_the_reference() {
        let a = picture(vec![[1.0, 2.0, 3.0], [0.5; 3]], None);
        let b = picture(vec![[1.0, 1.0, 5.0], [0.5; 3]], None);
        let c = compare(&a, &b).unwrap();
        assert!((c.rel_mse - (1.0 / 1.01 + 4.0 / 25.01) / 6.0).abs() < 1e-12);
        assert!((c.rmse - (5.0_f64 / 6.0).sqrt()).abs() < 1e-12);
        assert!((c.mae - 0.5).abs() < 1e-12);
        assert_eq!(c.bias, [0.0, 0.5, -1.0]);
        assert_eq!(c.reference_mean, [0.75, 0.75, 2.75]);
        assert!(c.statistics.is_none());
    }

    #[test]
    fn a_picture_is_itself_with_z_zero() {
        let a = picture(vec![[1.0, 2.0, 3.0], [0.0; 3]], Some(0.0));
        let c = compare(&a, &a).unwrap();
        let s = c.statistics.unwrap();
        assert_eq!((c.rel_mse, s.bias_z, s.beyond_3, s.largest), (0.0, [0.0; 3], 0.0, None));
    }

    #[test]
    fn z_is_the_difference_over_both_deviations() {
        let a = picture(vec![[2.0, 0.0, 0.0]; 4], Some(0.09));
        let b = picture(vec![[0.0; 3]; 4], Some(0.16));
        let s = compare(&a, &b).unwrap().statistics.unwrap();
        // 2 / 0.5 in a pixel, twice that over four of them; one channel in three is beyond 3.
        assert!((s.bias_z[0] - 8.0).abs() < 1e-6);
        assert_eq!(s.bias_z[1..], [0.0, 0.0]);
        assert!((s.beyond_3 - 1.0 / 3.0).abs() < 1e-12);
        let (z, at) = s.largest.unwrap();
        assert!((z - 4.0).abs() < 1e-6);
        assert_eq!(at, [5, 7]);
    }

    #[test]
    fn a_difference_without_variance_is_infinitely_significant() {
        let s = compare(&picture(vec![[1.0; 3]], Some(0.0)), &picture(vec![[0.0; 3]], Some(0.0))).unwrap();
        assert_eq!(s.statistics.unwrap().bias_z, [f64::INFINITY; 3]);
    }

    #[test]
    fn values_that_are_not_finite_are_counted_and_left_out() {
        let a = picture(vec![[f32::NAN, 0.0, 0.0], [1.0; 3]], None);
        let b = picture(vec![[0.0; 3], [1.0; 3]], None);
        let c = compare(&a, &b).unwrap();
        assert_eq!((c.not_finite, c.rel_mse), ([1, 0], 0.0));
        // What noise is to be expected is then not known.
        let mut a = picture(vec![[1.0; 3]; 2], Some(0.1));
        a.variance.iter_mut().for_each(|variance| variance[1][2] = f32::INFINITY);
        let z = compare(&a, &a).unwrap().statistics.unwrap().bias_z;
        assert!(z[..2] == [0.0; 2] && z[2].is_nan(), "{z:?}");
    }

    #[test]
    fn different_windows_are_not_compared() {
        let a = picture(vec![[0.0; 3]; 2], None);
        let mut moved = a.clone();
        moved.window = [6, 7, 8, 8];
        let text = compare(&a, &moved).unwrap_err();
        assert_eq!(text, "the pictures' data windows differ: 2 x 1 from (5, 7) and 2 x 1 from (6, 7)");
    }
}
