//! Estimators on discrete images: the passes that a tile takes, sample by sample, through `balance`'s own functions.

use glam::Vec3;

use super::domain::{Atom, Domain, Image};
use crate::balance::efficiency;
use crate::balance::pilot::{Candidates, Caution, Spreads};
use crate::balance::{Balance, Cost, Counts, Finding, Heuristic, Moments, Technique};

/// Who is tested.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Subject {
    /// A method of `--balance`.
    Method(Balance),
    /// The paper's passes and formula, with a ridge of one pseudo-observation.
    Ridge,
    /// The paper's passes, and the share that is best against the worst integrand, with a ridge of two.
    Minimax,
    /// Positive control of unbiasedness: a pixel's own pilot is weighed anew by a share that follows from that pilot.
    Biased,
    /// Positive control of safety: after a pilot of a quarter, the share that minimises the second moment of the pixel's
    /// own samples, without pseudo-observations.
    Unsafe,
}

impl Subject {
    /// Whom the tables show.
    pub fn shown() -> Vec<Self> {
        Balance::all().iter().map(|&b| Self::Method(b)).chain([Self::Ridge, Self::Minimax]).collect()
    }

    /// Does it learn from samples?
    pub fn learns(self) -> bool {
        !matches!(self, Subject::Method(balance) if !balance.learns())
    }

    /// Whose passes it takes.
    fn passes(self) -> Balance {
        if let Subject::Method(balance) = self { balance } else { Balance::SecondOrder }
    }

    /// The share for a pixel's next pass from what it has itself seen, as [`Balance::share`].
    pub fn share(self, seen: &Moments) -> Option<f32> {
        match self {
            Subject::Method(balance) => balance.share(seen),
            Subject::Ridge => Some(seen.second_order_ridge(1.0)),
            Subject::Minimax => Some(seen.minimax_ridge(2.0)),
            Subject::Biased | Subject::Unsafe => None,
        }
    }

    /// For tables.
    pub fn name(self) -> String {
        match self {
            Subject::Method(balance) => balance.name(),
            Subject::Ridge => "ridge".to_owned(),
            Subject::Minimax => "minimax".to_owned(),
            Subject::Biased => "biased control".to_owned(),
            Subject::Unsafe => "unguarded control".to_owned(),
        }
    }

    fn heuristic(self) -> Heuristic {
        self.passes().heuristic()
    }
}

/// What one replica gave one pixel.
#[derive(Debug, Clone, Copy)]
pub struct Shot {
    /// The picture's value.
    pub estimate: [f64; 3],
    /// Its exact variance at the shares that were chosen: Σ_k (n_k/N)² V(α_k), as passes are uncorrelated. Without meaning
    /// for the biased control.
    pub variance: [f64; 3],
    /// Share of light samples of the last pass.
    pub share: f32,
}

/// Independent random numbers (SplitMix64; Steele, Lea and Flood 2014).
#[derive(Debug, Clone)]
pub struct Random(u64);

impl Random {
    /// The stream of a number.
    pub fn new(stream: u64) -> Self {
        let mut random = Self(stream);
        Self(random.bits())
    }

    fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Uniform in [0, 1).
    fn uniform(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1u64 << 53) as f64
    }
}

/// One pixel under way.
#[derive(Debug, Clone)]
struct State {
    /// Over paths.
    sum: [f64; 3],
    /// Σ n_k² V_k.
    variance: [f64; 3],
    moments: Moments,
    share: f32,
}

/// One picture of `paths` paths a pixel.
pub fn replica(image: &Image, subject: Subject, paths: u32, random: &mut Random) -> Vec<Shot> {
    let mut run = Run {
        image,
        subject,
        random,
        states: vec![
            State { sum: [0.0; 3], variance: [0.0; 3], moments: Moments::default(), share: 0.5 };
            image.pixels.len()
        ],
    };
    match subject {
        Subject::Method(_) | Subject::Ridge | Subject::Minimax => run.method(paths),
        Subject::Biased => run.pilot_by(paths / 4, paths, |_, state, _| {
            // Counts must be able to reach the total.
            state.moments.second_order().clamp(0.25, 0.75)
        }),
        Subject::Unsafe => run.unguarded_minimum(paths),
    }
    let n = f64::from(paths);
    let shot =
        |s: &State| Shot { estimate: s.sum.map(|x| x / n), variance: s.variance.map(|v| v / (n * n)), share: s.share };
    run.states.iter().map(shot).collect()
}

/// Samples of either technique cost the same here.
pub const EQUAL_COST: Cost = Cost { fixed: 1.0, light: 1.0, bsdf: 1.0 };

struct Run<'a> {
    image: &'a Image,
    subject: Subject,
    random: &'a mut Random,
    states: Vec<State>,
}

impl Run<'_> {
    /// As `render::tile` does it.
    fn method(&mut self, paths: u32) {
        let (balance, mut done) = (self.subject.passes(), 0);
        while let Some(pass) = balance.next_pass(done, Some(paths), None) {
            match balance.pilot(done, pass) {
                Some(pilot) => {
                    let n = self.states.len();
                    let (mut shares, candidates) = (vec![], Candidates::two(Caution::DIRECT));
                    let Image { width, guides, .. } = self.image;
                    self.pilot_by(pilot, pass, |pixel, _, findings| {
                        if shares.is_empty() {
                            let spreads = Spreads::new(&candidates, findings, n, pilot);
                            shares = (0..n).map(|i| spreads.choose(i, *width, guides, EQUAL_COST).light).collect();
                        }
                        shares[pixel]
                    });
                }
                None => {
                    let (n, mut findings) = (self.states.len(), Vec::new());
                    (0..n).for_each(|i| self.at_once(i, pass, &mut findings));
                    if balance.learns_at_once(done) {
                        let shares = efficiency::shares(&findings, n, self.image.width, EQUAL_COST);
                        self.states.iter_mut().zip(shares).for_each(|(state, share)| state.share = share);
                    }
                }
            }
            if balance.learns() {
                for state in &mut self.states {
                    state.share = self.subject.share(&state.moments).unwrap_or(state.share);
                }
            }
            done += pass;
        }
    }

    fn at_once(&mut self, pixel: usize, paths: u32, findings: &mut Vec<Finding>) {
        let counts = Counts::new(self.states[pixel].share, paths);
        self.trace(pixel, counts, counts, true, findings);
        self.vary(pixel, counts);
    }

    /// A pass that begins with a pilot of equal counts, all of it weighed by the total counts of the share that `choose`
    /// says of a pixel, its state and the pilot's findings.
    fn pilot_by(&mut self, pilot: u32, paths: u32, mut choose: impl FnMut(usize, &State, &[Finding]) -> f32) {
        let mut findings = Vec::new();
        for pixel in 0..self.states.len() {
            let half = Counts::half(pilot);
            self.trace(pixel, half, half, false, &mut findings);
        }
        let shares: Vec<_> = self.states.iter().enumerate().map(|(i, s)| choose(i, s, &findings)).collect();
        let totals: Vec<_> = shares.iter().map(|&share| Counts::new(share, paths)).collect();
        for finding in findings.iter().filter(|f| f.radiance.is_finite() && f.radiance.max_element() > 0.0) {
            let pixel = finding.pixel as usize;
            let added = finding.at(totals[pixel].over(Counts::half(pilot)));
            self.states[pixel].sum.iter_mut().zip(added.to_array()).for_each(|(s, x)| *s += f64::from(x));
        }
        for (pixel, &total) in totals.iter().enumerate() {
            self.trace(pixel, total.after(Counts::half(pilot)), total, true, &mut Vec::new());
            self.vary(pixel, total);
            self.states[pixel].share = total.alpha();
        }
    }

    fn unguarded_minimum(&mut self, paths: u32) {
        let pilot = paths / 4;
        for pixel in 0..self.states.len() {
            let mut findings = Vec::new();
            let half = Counts::half(pilot);
            self.trace(pixel, half, half, true, &mut findings);
            self.vary(pixel, half);
            let moment = |alpha: f32| {
                let one = |f: &Finding| f.radiance.length_squared() / (1.0 + (2.0 * alpha - 1.0) * f.r);
                findings.iter().map(one).sum::<f32>()
            };
            let shares = (0..=64).map(|i| (i as f32 / 64.0).clamp(1e-3, 1.0 - 1e-3));
            let best = shares.min_by(|&a, &b| moment(a).total_cmp(&moment(b))).unwrap_or(0.5);
            self.states[pixel].share = if findings.is_empty() { 0.5 } else { best };
            self.at_once(pixel, paths - pilot, &mut findings);
        }
    }

    fn vary(&mut self, pixel: usize, counts: Counts) {
        let variance = self.image.pixels[pixel].variance(self.subject.heuristic(), counts);
        let n = f64::from(counts.paths);
        self.states[pixel].variance.iter_mut().zip(variance).for_each(|(sum, v)| *sum += n * n * v);
    }

    /// Takes `counts` samples, weighed by `weighed`; adds them to the pixel's sum if `add`, and what they saw to its
    /// moments and to `findings`.
    fn trace(&mut self, pixel: usize, counts: Counts, weighed: Counts, add: bool, findings: &mut Vec<Finding>) {
        let domain: &Domain = &self.image.pixels[pixel];
        let heuristic = self.subject.heuristic();
        let learns = self.subject.learns();
        let state = &mut self.states[pixel];
        for (by_light, n) in [(true, counts.light), (false, counts.bsdf)] {
            for index in 0..n {
                let atom: &Atom = domain.sample(by_light, self.random.uniform());
                if atom.f == [0.0; 3] {
                    continue;
                }
                if add {
                    let found = atom.found(heuristic, weighed, by_light);
                    state.sum.iter_mut().zip(found).for_each(|(s, x)| *s += x);
                }
                if learns {
                    // What is broken is learned from too: the balance has to stand it.
                    let (a_l, a_b) = (f64::from(weighed.light_a_path()), f64::from(weighed.bsdf_a_path()));
                    let z = atom.f.map(|f| 2.0 * f / (a_l * atom.light + a_b * atom.bsdf));
                    let y = atom.f.map(|f| 2.0 * f / (atom.light + atom.bsdf));
                    let w: f64 = (0..3).map(|c| y[c] * z[c]).sum();
                    let r = atom.r() as f32;
                    state.moments.add(w as f32, r, z.iter().sum::<f64>() as f32);
                    let technique = if by_light { Technique::Light } else { Technique::Bsdf };
                    let radiance = Vec3::from_array(y.map(|y| (0.5 * y) as f32));
                    findings.push(Finding { pixel: pixel as u32, technique, lamp: false, index, r, radiance });
                }
            }
        }
    }
}
