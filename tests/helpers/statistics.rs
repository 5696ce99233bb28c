//! The statistics that correctness is judged by: z-tests and chi-square tests with a stated false-alarm rate.

use std::f64::consts::PI;

use glam::Vec3;
use statrs::distribution::{ChiSquared, ContinuousCDF, Normal};

/// Chance that a whole family of tests raises an alarm though all is well.
pub const FALSE_ALARM: f64 = 1e-4;

/// The level of one of `tests` tests so that all together have [`FALSE_ALARM`] (Šidák).
pub fn level(tests: usize) -> f64 {
    1.0 - (1.0 - FALSE_ALARM).powf(1.0 / tests as f64)
}

/// Largest |z| that one of `tests` two-sided z-tests may show.
pub fn z_limit(tests: usize) -> f64 {
    Normal::new(0.0, 1.0).unwrap().inverse_cdf(1.0 - 0.5 * level(tests))
}

#[derive(Debug, Default, Clone, Copy)]
pub struct Mean {
    pub n: f64,
    pub mean: f64,
    m2: f64,
}

impl Mean {
    pub fn add(&mut self, x: f64) {
        self.n += 1.0;
        let d = x - self.mean;
        self.mean += d / self.n;
        self.m2 += d * (x - self.mean);
    }

    /// The statistics of numbers that are larger by `x`.
    pub fn shifted(self, x: f64) -> Self {
        Self { mean: self.mean + x, ..self }
    }

    pub fn standard_error(&self) -> f64 {
        (self.m2 / (self.n - 1.0) / self.n).sqrt()
    }

    /// Standard errors of both from another mean.
    pub fn z_to(&self, other: &Mean) -> f64 {
        (self.mean - other.mean) / self.standard_error().hypot(other.standard_error())
    }

    /// Standard errors from `expected`. Values that all agree to rounding are judged by rounding.
    pub fn z(&self, expected: f64) -> f64 {
        if self.mean == expected {
            return 0.0;
        }
        let rounding = 4.0 * f64::from(f32::EPSILON) * expected.abs();
        (self.mean - expected) / self.standard_error().max(rounding)
    }
}

/// Cells of the sphere: rows of equal θ, columns of equal φ.
const ROWS: usize = 32;
const COLUMNS: usize = 64;
/// Are `samples` directions from `sample` (`None` for a failed one) distributed with density `pdf` per solid angle, which is integrated by
/// `fine`² midpoints a cell? Panics with
/// the table's worst cells when the chi-square test at one of `tests` tests' level says no, or when the pdf's integral
/// exceeds one by more than the quadrature's error.
pub fn chi_square_directions(
    name: &str,
    tests: usize,
    (samples, fine): (usize, usize),
    mut sample: impl FnMut() -> Option<Vec3>,
    pdf: impl Fn(Vec3) -> f64,
) {
    let mut expected = vec![0.0f64; ROWS * COLUMNS + 1];
    for row in 0..ROWS {
        for column in 0..COLUMNS {
            let mut sum = 0.0;
            for i in 0..fine {
                let theta = PI * (row as f64 + (i as f64 + 0.5) / fine as f64) / ROWS as f64;
                for j in 0..fine {
                    let phi = 2.0 * PI * (column as f64 + (j as f64 + 0.5) / fine as f64) / COLUMNS as f64;
                    sum += pdf(direction(theta, phi)) * theta.sin();
                }
            }
            let area = PI / ROWS as f64 * 2.0 * PI / COLUMNS as f64 / (fine * fine) as f64;
            expected[row * COLUMNS + column] = sum * area * samples as f64;
        }
    }
    let total: f64 = expected.iter().sum::<f64>() / samples as f64;
    assert!(total < 1.005, "{name}: the pdf integrates to {total}");
    // What the pdf does not account for are failed samples.
    let last = expected.len() - 1;
    expected[last] = (1.0 - total).max(0.0) * samples as f64;

    let mut observed = vec![0u32; expected.len()];
    for _ in 0..samples {
        let cell = match sample() {
            Some(w) => {
                let theta = f64::from(w.z.clamp(-1.0, 1.0)).acos();
                let phi = f64::from(w.y).atan2(f64::from(w.x)).rem_euclid(2.0 * PI);
                let row = ((theta / PI * ROWS as f64) as usize).min(ROWS - 1);
                row * COLUMNS + ((phi / (2.0 * PI) * COLUMNS as f64) as usize).min(COLUMNS - 1)
            }
            None => last,
        };
        observed[cell] += 1;
    }

    chi_square(name, tests, &observed, &expected, |i| format!("({}, {})", i / COLUMNS, i % COLUMNS));
}

/// Do `observed` counts agree with `expected` ones? Panics with the worst cells, named by `cell`, when the chi-square
/// test at one of `tests` tests' level says no.
pub fn chi_square(name: &str, tests: usize, observed: &[u32], expected: &[f64], cell: impl Fn(usize) -> String) {
    // Cells below five expected are pooled.
    let (mut statistic, mut cells, mut rare) = (0.0, 0usize, (0.0, 0.0));
    let mut worst: Vec<(f64, usize)> = Vec::new();
    for (i, (&e, &o)) in expected.iter().zip(observed).enumerate() {
        if e < 5.0 {
            rare.0 += e;
            rare.1 += f64::from(o);
        } else {
            let term = (f64::from(o) - e).powi(2) / e;
            statistic += term;
            cells += 1;
            worst.push((term, i));
        }
    }
    if rare.0 >= 5.0 {
        statistic += (rare.1 - rare.0).powi(2) / rare.0;
        cells += 1;
    } else {
        assert!(rare.1 <= rare.0 + 40.0, "{name}: {} samples where {} are expected", rare.1, rare.0);
    }
    assert!(cells >= 2, "{name}: too few cells for a test");
    let p = 1.0 - ChiSquared::new((cells - 1) as f64).unwrap().cdf(statistic);
    worst.sort_by(|a, b| b.0.total_cmp(&a.0));
    let table: Vec<String> = worst
        .iter()
        .take(5)
        .map(|&(_, i)| format!("cell {}: {} for {:.1}", cell(i), observed[i], expected[i]))
        .collect();
    assert!(p > level(tests), "{name}: p = {p:.2e}, chi² = {statistic:.1} over {cells} cells; {}", table.join("; "));
}

/// Unit vector of polar angle `theta` from +z.
pub fn direction(theta: f64, phi: f64) -> Vec3 {
    let (s, c) = theta.sin_cos();
    Vec3::new((s * phi.cos()) as f32, (s * phi.sin()) as f32, c as f32)
}
