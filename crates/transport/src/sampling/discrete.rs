//! Sampling of discrete distributions that preserves the stratification of the random number.

/// Random numbers are multiples of 2⁻²³. The cumulative distribution function is rounded to them, so that [`Discrete::pmf`]
/// is exactly the probability of [`Discrete::sample`].
const GRID: f64 = (1u32 << 23) as f64;

/// A distribution over 0..len, sampled by inversion. Inversion is monotone in the random number, so stratified numbers choose
/// stratified outcomes; an alias table would not preserve this. A guide table makes the search constant time on average
/// (Chen and Asau 1974, *On Generating Random Variates from an Empirical Distribution*).
#[derive(Debug, Clone)]
pub struct Discrete {
    /// `len + 1` values from 0 to 1.
    cdf: Vec<f32>,
    /// For each of 2^k ≥ 2 `len` equal steps of the random number, the first outcome that it can be.
    guide: Vec<u32>,
    total: f64,
}

impl Discrete {
    /// A distribution in proportion to `weights`, each finite and ≥ 0. `None` if none is positive or there are more than 2³².
    pub fn new(weights: impl ExactSizeIterator<Item = f32>) -> Option<Self> {
        let n = weights.len();
        u32::try_from(n).ok()?;
        let mut sums = Vec::with_capacity(n + 1);
        let mut total = 0.0f64;
        sums.push(0.0);
        for w in weights {
            total += f64::from(w);
            sums.push(total);
        }
        if total <= 0.0 || !total.is_finite() {
            return None;
        }
        let cdf: Vec<f32> = sums.iter().map(|s| ((s / total * GRID).round() / GRID) as f32).collect();
        let mut at = 0u32;
        let steps = (2 * n).next_power_of_two();
        let guide = (0..steps)
            .map(|k| {
                let u = k as f64 / steps as f64;
                while at as usize + 1 < n && f64::from(cdf[at as usize + 1]) <= u {
                    at += 1;
                }
                at
            })
            .collect();
        Some(Self { cdf, guide, total })
    }

    /// The outcome for `u` in [0, 1), and the position of `u` within the outcome's interval: a new uniform number in [0, 1).
    #[inline]
    pub fn sample(&self, u: f32) -> (u32, f32) {
        // The length is a power of two, so the product is exact.
        let mut i = self.guide[(u * self.guide.len() as f32) as usize] as usize;
        while i + 2 < self.cdf.len() && self.cdf[i + 1] <= u {
            i += 1;
        }
        let width = self.cdf[i + 1] - self.cdf[i];
        let fresh = if width > 0.0 { (u - self.cdf[i]) / width } else { 0.0 };
        (i as u32, fresh.clamp(0.0, super::warp::ONE_MINUS_EPSILON))
    }

    #[inline]
    pub fn pmf(&self, i: u32) -> f32 {
        self.cdf[i as usize + 1] - self.cdf[i as usize]
    }

    pub fn total(&self) -> f64 {
        self.total
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn outcomes_have_exactly_the_reported_probability() {
        for weights in [vec![1.0f32], vec![0.0, 3.0, 1.0, 0.0], vec![5.0, 1e-6, 0.25, 7.5, 2.0, 0.0, 1.0]] {
            let table = Discrete::new(weights.iter().copied()).unwrap();
            // Every number of the 23-bit grid, counted: no statistics needed.
            let mut count = vec![0u32; weights.len()];
            for k in 0..(1u32 << 23) {
                let (i, fresh) = table.sample(k as f32 / GRID as f32);
                assert!((0.0..1.0).contains(&fresh));
                count[i as usize] += 1;
            }
            let total: f32 = weights.iter().sum();
            for (i, w) in weights.iter().enumerate() {
                let p = f64::from(count[i]) / GRID;
                assert_eq!(p as f32, table.pmf(i as u32));
                assert!((p - f64::from(w / total)).abs() <= 1.0 / GRID, "{i}: {p}");
            }
        }
    }

    #[test]
    fn nothing_to_choose_is_none() {
        assert!(Discrete::new([].into_iter()).is_none());
        assert!(Discrete::new([0.0, 0.0].into_iter()).is_none());
    }
}
