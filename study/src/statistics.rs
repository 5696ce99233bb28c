//! Summaries of values, the same for every study.

use statrs::statistics::{Data, Median};

/// Middle of the values, NaN of none.
pub fn median(values: &[f64]) -> f64 {
    Median::median(&Data::new(values.to_vec()))
}

/// Mean of the values, NaN of none.
pub(crate) fn mean_of(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, n) = values.fold((0.0, 0.0), |(sum, n), x| (sum + x, n + 1.0));
    sum / n
}

/// Standard deviation of normal values, from their median deviation.
pub(crate) fn robust_deviation(values: &[f64]) -> f64 {
    let middle = median(values);
    1.4826 * median(&values.iter().map(|x| (x - middle).abs()).collect::<Vec<_>>())
}

/// Standard error of the median of normal values: 1.2533 times that of their mean.
pub(crate) fn median_error(values: &[f64]) -> f64 {
    1.2533 * robust_deviation(values) / (values.len() as f64).sqrt()
}

/// Number, sum and sum of squares.
#[derive(Debug, Clone, Copy, Default)]
pub struct Sums {
    n: f64,
    sum: f64,
    squares: f64,
}

impl Sums {
    pub fn add(&mut self, x: f64) {
        self.n += 1.0;
        self.sum += x;
        self.squares += x * x;
    }

    pub fn join(&mut self, other: &Self) {
        self.n += other.n;
        self.sum += other.sum;
        self.squares += other.squares;
    }

    pub fn mean(&self) -> f64 {
        self.sum / self.n
    }

    pub fn variance(&self) -> f64 {
        ((self.squares - self.sum * self.sum / self.n) / (self.n - 1.0)).max(0.0)
    }

    /// Standard error of the mean.
    pub fn error(&self) -> f64 {
        (self.variance() / self.n).sqrt()
    }
}

/// Mean and sample variance of the values, summed twice: exact where [`Sums`] would cancel.
pub fn moments(values: &[f64]) -> (f64, f64) {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    (mean, values.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / (n - 1.0))
}

/// The one of the values that is farthest from zero, with its sign; zero of none.
pub fn farthest(values: impl Iterator<Item = f64>) -> f64 {
    values.max_by(|a, b| a.abs().total_cmp(&b.abs())).unwrap_or(0.0)
}
