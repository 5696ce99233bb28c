//! Directions as points of the unit square, and histograms over it that can be sampled.
//!
//! The sphere is unfolded as an octahedron (Engelhardt and Dachsbacher 2008, *Octahedron Environment Maps*). With
//! |ω|₁ = |x| + |y| + |z|, a density p on the unit square is p/(4 |ω|₁³) per solid angle.

use crate::lanes::{F, V3, sign};
use crate::sampling::warp::ONE_MINUS_EPSILON;

/// Bins along a side of the square.
pub const SIDE: usize = 32;
/// Bins of a histogram.
pub const BINS: usize = SIDE * SIDE;

/// Points of the unit square for unit directions.
#[inline(always)]
fn to_square(w: V3) -> (F, F) {
    let scale = F::ONE / norm(w);
    let (x, y) = (w.x * scale, w.y * scale);
    let below = w.z.simd_lt(F::ZERO);
    let folded = |a: F, b: F| below.select((F::ONE - b.abs()) * sign(a), a);
    let half = |a: F| a.mul_add(F::HALF, F::HALF).fast_max(F::ZERO).fast_min(F::splat(ONE_MINUS_EPSILON));
    (half(folded(x, y)), half(folded(y, x)))
}

/// Unit directions for points of the unit square.
#[inline(always)]
pub(crate) fn from_square(u: F, v: F) -> V3 {
    let (x, y) = (u.mul_sub(F::splat(2.0), F::ONE), v.mul_sub(F::splat(2.0), F::ONE));
    let z = F::ONE - x.abs() - y.abs();
    let fold = (F::ZERO - z).fast_max(F::ZERO);
    let (x, y) = (x - sign(x) * fold, y - sign(y) * fold);
    let w = V3 { x, y, z };
    w * (F::ONE / w.length_squared().sqrt())
}

/// |ω|₁.
#[inline(always)]
fn norm(w: V3) -> F {
    w.x.abs() + w.y.abs() + w.z.abs()
}

/// 4 |ω|₁³: solid angle in steradians per unit area of the square.
#[inline(always)]
pub(crate) fn steradians(w: V3) -> F {
    let n = norm(w);
    F::splat(4.0) * n * n * n
}

/// The bins that hold unit directions.
#[inline(always)]
pub fn bins(w: V3) -> [u32; 8] {
    let (u, v) = to_square(w);
    let side = F::splat(SIDE as f32);
    let bin = (u * side).trunc().mul_add(side, (v * side).trunc());
    bin.to_array().map(|bin| bin as u32)
}

/// A histogram that can be sampled. It is stored in few bits, so that many histograms stay in the cache. Samples and densities
/// both follow the rounded values. Its rows are one line of the cache.
#[derive(Debug, Clone)]
#[repr(C, align(64))]
pub struct Histogram {
    /// Cumulative probabilities at the start of each row, in units of 2⁻¹⁶.
    rows: [u16; SIDE],
    /// Cumulative probabilities at the start of each column of a row, in units of 2⁻⁸.
    columns: [[u8; SIDE]; SIDE],
}

/// A sampled row of a histogram.
#[derive(Debug, Clone, Copy, Default)]
pub struct Row {
    row: usize,
    /// Position in the row, in [0, 1).
    y: f32,
    /// Its probability in units of 2⁻¹⁶.
    probability: f32,
}

impl Histogram {
    /// A histogram in proportion to `weights`, each finite and ≥ 0; uniform on the square if all are zero or their sum overflows.
    pub fn new(weights: &[f32; BINS]) -> Self {
        let mut of_rows = [0.0; SIDE];
        let mut columns = [[0; SIDE]; SIDE];
        for ((sum, starts), row) in of_rows.iter_mut().zip(&mut columns).zip(weights.as_chunks::<SIDE>().0) {
            (*starts, *sum) = starts_of(row);
        }
        let (rows, total) = starts_of(&of_rows);
        // The sum may overflow.
        if total.is_finite() { Self { rows, columns } } else { Self::new(&[0.0; BINS]) }
    }

    /// Density on the unit square in bin `bin`.
    #[inline(always)]
    pub fn density(&self, bin: u32) -> f32 {
        let (row, column) = (bin as usize / SIDE % SIDE, bin as usize % SIDE);
        probability(&self.rows, row) * probability(&self.columns[row], column) * OF_BINS
    }

    /// Samples a row by a random number in [0, 1).
    #[inline(always)]
    pub(crate) fn draw_row(&self, u: f32) -> Row {
        let (row, y, probability) = invert(&self.rows, u);
        Row { row, y, probability }
    }

    /// Samples a point of the unit square in a sampled row by a random number in [0, 1); the third value is its density.
    #[inline(always)]
    pub(crate) fn draw_in(&self, Row { row, y, probability }: Row, v: f32) -> (f32, f32, f32) {
        let (column, x, of_row) = invert(&self.columns[row % SIDE], v);
        ((row as f32 + y) / SIDE as f32, (column as f32 + x) / SIDE as f32, probability * of_row * OF_BINS)
    }
}

/// Density of a bin per unit of its row's and its column's probability.
const OF_BINS: f32 = BINS as f32 / (<u16 as Fraction>::ONE * <u8 as Fraction>::ONE);

/// An integer type that holds fractions of one.
trait Fraction: Copy + Default + Ord + Into<f32> {
    /// The value of one.
    const ONE: f32;

    /// Rounds down; saturates below one.
    fn from_f32(value: f32) -> Self;
}

impl Fraction for u16 {
    const ONE: f32 = 65536.0;

    #[inline(always)]
    fn from_f32(value: f32) -> Self {
        value as Self
    }
}

impl Fraction for u8 {
    const ONE: f32 = 256.0;

    #[inline(always)]
    fn from_f32(value: f32) -> Self {
        value as Self
    }
}

/// Cumulative probabilities at the start of each of a row of weights, and the sum of the weights.
fn starts_of<P: Fraction>(weights: &[f32; SIDE]) -> ([P; SIDE], f32) {
    let total: f32 = weights.iter().sum();
    let mut sum = 0.0;
    let starts = std::array::from_fn(|i| {
        let start = if total > 0.0 { sum / total } else { i as f32 / SIDE as f32 };
        sum += weights[i];
        P::from_f32((start * P::ONE).round())
    });
    (starts, total)
}

/// Probability of interval `i`.
#[inline(always)]
fn probability<P: Fraction>(starts: &[P; SIDE], i: usize) -> f32 {
    let end = if i + 1 < SIDE { starts[i + 1].into() } else { P::ONE };
    end - starts[i].into()
}

/// The interval that contains `u` in [0, 1), the position of `u` in it in [0, 1), and its probability.
#[inline(always)]
fn invert<P: Fraction>(starts: &[P; SIDE], u: f32) -> (usize, f32, f32) {
    let at = u * P::ONE;
    let whole = P::from_f32(at);
    let i = starts.iter().map(|start| u8::from(*start <= whole)).sum::<u8>().max(1) as usize - 1;
    let size = probability(starts, i);
    (i, ((at - starts[i].into()) / size).clamp(0.0, ONE_MINUS_EPSILON), size)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::SplitMix64;
    use crate::sampling::warp;
    use glam::Vec3;

    #[test]
    fn directions_come_back_from_the_square() {
        let mut random = SplitMix64(1);
        for _ in 0..20_000 {
            let w = V3::splat(warp::sphere(random.f32(), random.f32()));
            let (u, v) = to_square(w);
            let back = from_square(u, v).lane(0);
            assert!((back - w.lane(0)).length() < 2e-6, "{back}");
        }
        for axis in [Vec3::X, Vec3::Y, Vec3::Z, -Vec3::X, -Vec3::Y, -Vec3::Z] {
            let (u, v) = to_square(V3::splat(axis));
            assert!((from_square(u, v).lane(0) - axis).length() < 2e-6);
        }
    }

    #[test]
    fn the_square_covers_the_sphere_once() {
        // ∫ dω/(4 |ω|₁³) = 1: of uniform directions, the mean of 4π over it. 10⁶ of them, with a deviation each of 0.6.
        let mut random = SplitMix64(2);
        let n = 1_000_000;
        let mut sum = 0.0;
        for _ in 0..n / 8 {
            let w = V3::gather(std::array::from_fn(|_| warp::sphere(random.f32(), random.f32())));
            sum += steradians(w).to_array().iter().map(|s| 4.0 * std::f64::consts::PI / f64::from(*s)).sum::<f64>();
        }
        assert!((sum / f64::from(n) - 1.0).abs() < 0.005, "{sum}");
    }

    #[test]
    fn samples_have_the_stated_density() {
        let mut random = SplitMix64(3);
        let mut weights = [0.0; BINS];
        weights.iter_mut().for_each(|w| *w = if random.f32() < 0.5 { 0.0 } else { random.f32().powi(4) });
        weights[BINS - 1] = 0.0;
        let histogram = Histogram::new(&weights);
        let weights = weights.map(f64::from);
        let total: f64 = weights.iter().sum();
        let n = 400_000;
        let (mut counts, mut odd) = ([0u32; BINS], 0);
        for _ in 0..n {
            let (u, v, density) = histogram.draw_in(histogram.draw_row(random.f32()), random.f32());
            let w = from_square(F::splat(u), F::splat(v));
            let bin = bins(w)[0];
            counts[bin as usize] += 1;
            // Points on the edge of a bin may be rounded out of it.
            odd += u32::from(density != histogram.density(bin));
        }
        let (mut chi2, mut freedom, mut astray) = (0.0, -1.0, 0);
        for (bin, count) in counts.iter().enumerate() {
            let expected = weights[bin] / total * f64::from(n);
            let stated = f64::from(histogram.density(bin as u32)) / BINS as f64 * f64::from(n);
            // Sixteen bits one way, eight the other; the last begins a part before the end at least.
            let row: f64 = weights[bin / SIDE * SIDE..][..SIDE].iter().sum();
            let steps = 1e-3 * expected + (4e-5 + 1.5 * row / total / 256.0) * f64::from(n);
            assert!((expected - stated).abs() < steps, "{bin}");
            if stated >= 5.0 {
                chi2 += (f64::from(*count) - stated).powi(2) / stated;
                freedom += 1.0;
            } else if stated == 0.0 {
                astray += count;
            }
        }
        assert!(astray < 20 && odd < 200, "{astray} {odd}");
        // Six standard deviations: a false alarm in 10⁹.
        let z = (chi2 - freedom) / f64::sqrt(2.0 * freedom);
        assert!(z.abs() < 6.0, "{z}");
    }

    #[test]
    fn a_histogram_without_weights_or_with_too_large_ones_is_uniform() {
        for weights in [[0.0; BINS], [f32::MAX; BINS]] {
            let histogram = Histogram::new(&weights);
            assert!((0..BINS as u32).all(|bin| (histogram.density(bin) - 1.0).abs() < 1e-5));
            assert_eq!(histogram.draw_in(histogram.draw_row(0.0), 0.0), (0.0, 0.0, 1.0));
        }
    }
}
