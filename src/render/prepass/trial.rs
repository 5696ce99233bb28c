//! The trial: which techniques pay in this picture. Groups of its pixels are rendered in each way, with the same points of the
//! sequence (common random numbers), in two scrambles whose difference is the error. Techniques are taken one after the other,
//! first the one that leaves least of error times cost, each beside those that were taken before.
//!
//! The trial has scrambles of its own, and nothing of it is in the picture: what decides about a pixel must not be its light.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use glam::Vec3;
use rayon::prelude::*;
use tracing::debug;

use super::effort;
use crate::film::compare::relative_to;
use crate::integrator::clients::ScatteredSums;
use crate::integrator::{PixelTask, Proposal, Reuse, Transport, WaveCounts};
use crate::render::pass::decisions::TechniqueStats;
use crate::render::pass::sampler::with_buffers;
use crate::render::settings::RenderSettings;
use crate::render::settings::part::TILE;
use crate::render::settings::techniques::{Choice, Technique};
use crate::sampling::hash;

/// Fraction of error times cost that a technique must take away.
pub const GAIN: f64 = 0.05;
/// Standard errors by which a ratio is above or below that when a trial ends, and by which it must be below 1 where its budget is
/// spent before.
const CERTAINTY: [f64; 2] = [1.64, 0.5];
/// A trial, and a round of learning, may cost this share of what the technique can take away of the picture's cost.
const BUDGET: f64 = 0.15;

/// Relative standard error to which ways that pay are told apart.
const PRECISION: f64 = 0.15;
/// Standard error of the logarithm of what is expected: of the estimate of a learner, which takes points for independent, or of a
/// trial beside other techniques.
const EXPECTED_ERROR: f64 = 0.5;

/// Groups of the first step: pixels of the picture over those of as many tiles, and the minimum and maximum.
const FIRST_GROUPS: (f64, [f64; 2]) = (128.0, [8.0, 32.0]);
/// Most paths of a group of pixels all over the picture in each scramble.
const PATHS: u32 = 512;
/// Most paths of such a pixel, and where it is to be seen whether guiding pays. What stratified points gain, which a field spoils,
/// and rare light show with many.
const PIXEL_PATHS: [u32; 2] = [32, 64];
/// Pixels of such a group over those of the picture, at most.
const SMALL_SHARE: f64 = 1.0 / 512.0;
/// All pictures of at least so many paths per pixel decide alike.
const REFERENCE_SPP: u32 = 64;
/// Paths per pixel of a tile in each scramble: where it is to be seen whether sharing pays at all, and the most where it does.
const TILE_PATHS: [u32; 2] = [2, 8];
/// Side in pixels of the blocks of a tile by whose mean errors are divided: a few paths do not estimate that of a pixel.
const BLOCK: u32 = 4;
/// One pixel in this number of groups has at most the error of the next: the largest errors are mostly chance.
const LARGEST: usize = 6;
/// Steps of the R2 sequence (Roberts 2018): the inverse of the plastic number, and its square.
const R2: [f64; 2] = [0.754_877_666_246_693, 0.569_840_290_998_053];

/// A technique that may be used, with what it has learned.
pub trait Candidate {
    /// Which one it is.
    fn technique(&self) -> Technique;

    /// The ways in which it can change a proposal; none if it has learned that it does not pay. The first is the usual one.
    fn ways<'a>(&'a self, of: Proposal<'a>) -> Vec<Proposal<'a>>;

    /// What is known of it before the trial.
    fn stats(&self) -> TechniqueStats {
        TechniqueStats::default()
    }
}

/// What was decided about a candidate.
#[derive(Debug, Clone, Copy)]
pub struct Decided {
    /// The number of its way that is used, if one is.
    pub way: Option<usize>,
    /// What was found.
    pub stats: TechniqueStats,
}

/// May so many paths be spent on a technique that leaves at least so much of a picture with so many paths per pixel?
pub fn affords(settings: &RenderSettings, spp: u32, paths: f64, remaining: f64) -> bool {
    paths <= BUDGET * (1.0 - remaining) * settings.pixels() * f64::from(spp)
}

/// Decides which candidates are used for paths of `plain`. After `stop` is raised no more are.
pub fn decide(
    candidates: &[&dyn Candidate],
    plain: &Transport,
    settings: &RenderSettings,
    stop: &AtomicBool,
) -> Vec<Decided> {
    let began = Instant::now();
    let stopped = || stop.load(Ordering::Relaxed) || effort::is_late(settings, began);
    let asked_for = |i: &usize| settings.techniques[candidates[*i].technique()] == Choice::On;
    let (asked, mut open): (Vec<_>, Vec<_>) = (0..candidates.len()).partition(asked_for);
    let begin = |candidate: &&dyn Candidate| Decided { way: None, stats: candidate.stats() };
    let mut decided: Vec<_> = candidates.iter().map(begin).collect();
    let mut trial = Trial::new(plain.clone(), settings);
    for i in asked {
        let Some(way) = candidates[i].ways(trial.base.proposal).first().copied() else { continue };
        decided[i].stats.sizes = trial.new_sizes(&way);
        (decided[i].way, decided[i].stats.on) = (Some(0), true);
        trial.base.proposal = way;
    }
    'all: while !open.is_empty() {
        let mut best: Option<(usize, usize, Tried)> = None;
        for i in std::mem::take(&mut open) {
            let began = Instant::now();
            let ways = candidates[i].ways(trial.base.proposal);
            let kinds = ways.first().map_or(&[][..], |way| trial.kinds(way));
            // By its learner, or beside fewer techniques.
            let mut expected = decided[i].stats.remaining;
            let mut least: Option<(usize, Tried)> = None;
            for kind in kinds {
                // Where the usual way does not pay by few paths, the others are not tried.
                if least.as_ref().is_some_and(|(_, tried)| !tried.ratio.pays()) {
                    break;
                }
                expected = least.take().map(|(_, tried)| tried.ratio.remaining).or(expected);
                let all = if *kind == Kind::Few { &ways[..1] } else { &ways[..] };
                for (way, proposal) in all.iter().enumerate() {
                    let Some(tried) = trial.compare(proposal, *kind, expected, &stopped) else { break 'all };
                    let Tried { ratio, groups } = &tried;
                    debug!("{:?}, way {way}, {} of {kind:?}: {ratio:?}", candidates[i].technique(), groups.len());
                    if least.as_ref().is_none_or(|(_, least)| ratio.remaining < least.ratio.remaining) {
                        least = Some((way, tried));
                    }
                }
            }
            let Some((way, tried)) = least else { continue };
            let stats = &mut decided[i].stats;
            stats.seconds += began.elapsed().as_secs_f64();
            stats.remaining = Some(tried.ratio.remaining);
            stats.standard_error = Some(tried.ratio.remaining * tried.ratio.log_error);
            stats.sizes = trial.new_sizes(&ways[way]);
            if tried.ratio.pays() {
                open.push(i);
                if best.as_ref().is_none_or(|(.., best)| tried.ratio.remaining < best.ratio.remaining) {
                    best = Some((i, way, tried));
                }
            }
        }
        let Some((i, way, tried)) = best else { break };
        open.retain(|other| *other != i);
        (decided[i].way, decided[i].stats.on) = (Some(way), true);
        let way = candidates[i].ways(trial.base.proposal)[way];
        trial.adopt(way, tried.groups);
    }
    decided
}

/// A way over the base.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Ratio {
    /// Error times cost.
    remaining: f64,
    /// The standard error of its logarithm.
    log_error: f64,
    /// The number of equal groups that would be as uncertain.
    groups: f64,
}

impl Ratio {
    /// The standard error of the logarithm, larger if few groups tell (about Student's t).
    fn uncertainty(self) -> f64 {
        (1.0 + 1.5 / (self.groups - 1.0).max(1e-3)) * self.log_error.max(1e-3)
    }

    /// The bound that lies so many standard errors above it.
    fn bound(self, errors: f64) -> f64 {
        self.remaining * (errors * self.uncertainty()).exp()
    }

    /// The mean with what is expected, by precision.
    fn with(self, expected: f64) -> Self {
        let weights = [self.uncertainty(), EXPECTED_ERROR].map(|error| error.powi(-2));
        let sum = weights[0] + weights[1];
        let log = (weights[0] * self.remaining.ln() + weights[1] * expected.max(1e-3).ln()) / sum;
        Self { remaining: log.exp(), log_error: sum.powf(-0.5), groups: f64::INFINITY }
    }

    /// Does the way take away as much as it must, and probably something?
    fn pays(self) -> bool {
        self.remaining < 1.0 - GAIN && self.bound(CERTAINTY[1]) < 1.0
    }

    /// Is that as certain as it must be, or its contrary?
    fn is_decided(self) -> bool {
        [-1.0, 1.0].iter().all(|sign| (self.bound(sign * CERTAINTY[0]) < 1.0 - GAIN) == self.pays())
    }
}

/// A way that has been tried.
struct Tried {
    ratio: Ratio,
    groups: Vec<Group>,
}

/// What groups of pixels are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    /// All over the picture, which tells most.
    Pixels,
    /// The same, with more paths.
    Long,
    /// Tiles, where paths are shared: with few paths per pixel.
    Few,
    /// Tiles with more paths: the more there are, the less of the error is of what is not shared.
    Many,
}

impl Kind {
    fn is_of_tiles(self) -> bool {
        matches!(self, Self::Few | Self::Many)
    }
}

/// A group of pixels, rendered in some way.
struct Group {
    /// Block by block.
    pixels: Vec<[u32; 2]>,
    /// Their mean radiance in both scrambles, but for the emission that the camera sees directly: that has the same error in all
    /// ways, and camera rays of its own where it is large ([`allocation`](super::allocation)).
    scattered: [Vec<Vec3>; 2],
    /// The mean of that emission.
    emitted: Vec<Vec3>,
    cost: f64,
}

/// Renders groups of pixels in several ways.
struct Trial<'a> {
    base: Transport<'a>,
    settings: &'a RenderSettings,
    /// Positions of tiles, in the order in which they are rendered.
    tiles: Vec<[u32; 2]>,
    /// Paths per pixel in each scramble, by kind of group.
    paths: [u32; 4],
    /// The base, by kind of group.
    rendered: [Vec<Group>; 4],
}

impl<'a> Trial<'a> {
    fn new(base: Transport<'a>, settings: &'a RenderSettings) -> Self {
        let tiles = spread([settings.width, settings.height].map(|n| n.div_ceil(TILE)));
        let spp = settings.expected_spp();
        let ([few, most], of_pixel) = (TILE_PATHS, |most| 1 << spp.clamp(1, most).ilog2());
        let [usual, long] = PIXEL_PATHS.map(of_pixel);
        let paths = [usual, long, few, (spp / 8).clamp(few, most)];
        Self { base, settings, tiles, paths, rendered: Default::default() }
    }

    /// Sizes of groups of path re-use that a way brings.
    fn new_sizes(&self, way: &Proposal) -> Option<Reuse> {
        way.reuse.filter(|_| self.base.proposal.reuse.is_none())
    }

    /// By which groups a way is compared with the base, one after the other while it pays.
    fn kinds(&self, way: &Proposal) -> &'static [Kind] {
        match [way, &self.base.proposal].map(|proposal| proposal.reuse.is_some()) {
            [_, true] => &[Kind::Many],
            [true, false] => &[Kind::Few, Kind::Many],
            [false, false] if way.field.is_some() => &[Kind::Long],
            [false, false] => &[Kind::Pixels],
        }
    }

    /// Makes a way the base, of which groups are rendered.
    fn adopt(&mut self, way: Proposal<'a>, groups: Vec<Group>) {
        let kind = self.kinds(&way).last().map_or(0, |kind| *kind as usize);
        self.rendered = Default::default();
        self.rendered[kind] = groups;
        self.base.proposal = way;
    }

    /// Compares a way with the base on more and more groups, until that is decided or a step is not worth its cost. The result is
    /// the mean with what is `expected`, by precision, and what is expected to pay is not refused before: where light is rare, few
    /// paths of the base show how noisy it is. `None` soon after `stopped`.
    fn compare(
        &mut self,
        way: &Proposal,
        kind: Kind,
        expected: Option<f64>,
        stopped: &(dyn Fn() -> bool + Sync),
    ) -> Option<Tried> {
        let (share, [min, max]) = FIRST_GROUPS;
        let number = kind as usize;
        let paths = f64::from(self.size(kind) * self.paths[number]);
        let ready = self.rendered[number].len();
        let spp = self.settings.expected_spp().min(REFERENCE_SPP);
        let affords = |groups: usize, remaining: f64| {
            let renders = groups + groups.saturating_sub(ready);
            affords(self.settings, spp, 2.0 * paths * renders as f64, remaining)
        };
        let least = expected.unwrap_or(1.0);
        let mut groups = ((self.tiles.len() as f64 / share).clamp(min, max) as usize).min(self.tiles.len());
        while groups > 2 && kind.is_of_tiles() && !affords(groups, least.min(0.5)) {
            groups /= 2;
        }
        let mut tried = Vec::new();
        loop {
            let before = [self.rendered[number].len(), tried.len()];
            let tasks: Vec<_> = (0..2).flat_map(|of| (before[of]..groups).map(move |i| (of, i))).collect();
            let render = |(of, i): &(usize, usize)| {
                let proposal = if *of == 0 { &self.base.proposal } else { way };
                (!stopped()).then(|| self.render(*proposal, kind, *i))
            };
            let mut found: Vec<_> = tasks.par_iter().with_max_len(1).map(render).collect::<Option<_>>()?;
            tried.extend(found.split_off(groups.saturating_sub(before[0])));
            self.rendered[number].extend(found);
            let pairs: Vec<_> = tried.iter().zip(&self.rendered[number]).collect();
            let ratio = ratio(pairs.iter().map(|(way, base)| errors(way, base)).collect(), cost(&pairs));
            let ratio = expected.map_or(ratio, |expected| ratio.with(expected));
            let next = (2 * groups).min(self.tiles.len());
            let suffices = if ratio.pays() { ratio.log_error < PRECISION } else { least >= 1.0 - GAIN };
            let least = (ratio.remaining * (-CERTAINTY[0] * ratio.log_error).exp()).min(least);
            if (ratio.is_decided() && suffices) || next == groups || !affords(next, least) {
                return Some(Tried { ratio, groups: tried });
            }
            groups = next;
        }
    }

    /// Pixels of a whole group. In small pictures those all over it have few.
    fn size(&self, kind: Kind) -> u32 {
        if kind.is_of_tiles() {
            return TILE * TILE;
        }
        let most = PATHS / self.paths[kind as usize];
        ((self.settings.pixels() * SMALL_SHARE) as u32).clamp(most.min(4), most)
    }

    /// The pixels of a group, block by block.
    fn pixels(&self, kind: Kind, number: usize) -> Vec<[u32; 2]> {
        let RenderSettings { width, height, .. } = *self.settings;
        if !kind.is_of_tiles() {
            let n = self.size(kind);
            let at = |i: u32| spread_point(number as f64 * f64::from(n) + f64::from(i), [width, height]);
            return (0..n).map(at).collect();
        }
        let [x0, y0] = self.tiles[number].map(|n| n * TILE);
        let [x1, y1] = [width.min(x0 + TILE), height.min(y0 + TILE)];
        let mut pixels: Vec<_> = (y0..y1).flat_map(|y| (x0..x1).map(move |x| [x, y])).collect();
        pixels.sort_by_key(|at| block(*at));
        pixels
    }

    /// Renders a group in both scrambles.
    fn render(&self, proposal: Proposal, kind: Kind, number: usize) -> Group {
        let pixels = self.pixels(kind, number);
        let counts = self.base.half(self.paths[kind as usize]);
        let tasks: Vec<_> = (0..).zip(&pixels).map(|(i, pixel)| PixelTask::first(*pixel, counts, i)).collect();
        with_buffers(|buffers| {
            let wave = buffers.wave();
            wave.counts = WaveCounts::default();
            let mut emitted = vec![Vec3::ZERO; tasks.len()];
            let scattered = [0, 1].map(|scramble| {
                let seed = hash(self.base.seed ^ hash(0x7472_6961 + scramble));
                let transport = Transport { seed, proposal, ..self.base.clone() };
                let mut scattered = vec![Vec3::ZERO; tasks.len()];
                let mut sums = ScatteredSums { scattered: &mut scattered, emitted: &mut emitted };
                wave.run(&transport, &tasks, &mut sums);
                scattered.iter_mut().for_each(|sum| *sum /= counts.paths as f32);
                scattered
            });
            emitted.iter_mut().for_each(|sum| *sum /= (2 * counts.paths) as f32);
            Group { pixels, scattered, emitted, cost: effort::cost(&wave.counts, &proposal) }
        })
    }
}

/// All positions of a grid, the first of them all over it.
fn spread([columns, rows]: [u32; 2]) -> Vec<[u32; 2]> {
    let mut order: Vec<_> = (0..rows).flat_map(|y| (0..columns).map(move |x| [x, y])).collect();
    let index = |[x, y]: [u32; 2]| (y * columns + x) as usize;
    // Those that the sequence meets change places with the first ones.
    let (mut place, mut next): (Vec<usize>, _) = ((0..order.len()).collect(), 0);
    for i in 0..order.len() {
        let found = index(spread_point(i as f64, [columns, rows]));
        if place[found] >= next {
            let other = index(order[next]);
            order.swap(next, place[found]);
            place.swap(found, other);
            next += 1;
        }
    }
    order
}

/// A point of the R2 sequence, in a grid of this size.
fn spread_point(number: f64, size: [u32; 2]) -> [u32; 2] {
    [0, 1].map(|axis| ((R2[axis] * (number + 1.0)).fract() * f64::from(size[axis])) as u32)
}

/// Which block a pixel is in.
fn block([x, y]: [u32; 2]) -> [u32; 2] {
    [y / BLOCK, x / BLOCK]
}

/// Costs of ways and of bases.
fn cost(pairs: &[(&Group, &Group)]) -> [f64; 2] {
    pairs.iter().fold([0.0; 2], |sum, (way, base)| [sum[0] + way.cost, sum[1] + base.cost])
}

/// Relative squared errors of a group's pixels in two ways.
fn errors(way: &Group, base: &Group) -> [Vec<f64>; 2] {
    let alike = |a: &[u32; 2], b: &[u32; 2]| block(*a) == block(*b);
    let mut found = [Vec::new(), Vec::new()];
    let mut first = 0;
    for block in way.pixels.chunk_by(alike) {
        let pixels = first..first + block.len();
        first = pixels.end;
        // The mean of both ways: noise favours none.
        let mean = |of: &[&[Vec3]]| {
            of.iter().flat_map(|of| &of[pixels.clone()]).sum::<Vec3>() / (of.len() * block.len()) as f32
        };
        let [[a, b], [c, d]] = [&way.scattered, &base.scattered];
        let mean = mean(&[a, b, c, d]) + mean(&[&way.emitted, &base.emitted]);
        for (found, [a, b]) in found.iter_mut().zip([&way.scattered, &base.scattered]) {
            found.extend(pixels.clone().map(|i| {
                let of = |c: usize| f64::from(a[i][c] - b[i][c]).powi(2) / relative_to(f64::from(mean[c]));
                let error = of(0) + of(1) + of(2);
                if error.is_finite() { error } else { f64::INFINITY }
            }));
        }
    }
    found
}

/// The ratio of two ways by the errors of their pixels, group by group, and by their costs.
fn ratio(groups: Vec<[Vec<f64>; 2]>, cost: [f64; 2]) -> Ratio {
    // By way and group.
    let sums = [0, 1].map(|way| {
        let mut all: Vec<f64> = groups.iter().flat_map(|group| &group[way]).copied().collect();
        all.sort_by(f64::total_cmp);
        let most = all.len().checked_sub(1 + groups.len() / LARGEST).map_or(0.0, |i| all[i]);
        groups.iter().map(|group| group[way].iter().map(|error| error.min(most)).sum::<f64>()).collect::<Vec<_>>()
    });
    let all = [0, 1].map(|way| sums[way].iter().sum::<f64>());
    if !all.iter().chain(&cost).all(|sum| sum.is_finite() && *sum > 0.0) {
        // Without error there is none to take away.
        return Ratio { remaining: 1.0, log_error: 0.0, groups: f64::INFINITY };
    }
    // The deviation of a ratio of sums, to the first order.
    let both = || sums[0].iter().zip(&sums[1]).map(|(a, b)| [a / all[0], b / all[1]]);
    let squares: f64 = both().map(|[a, b]| (a - b).powi(2)).sum();
    let groups = 4.0 / both().map(|[a, b]| (a + b).powi(2)).sum::<f64>();
    Ratio { remaining: all[0] / all[1] * cost[0] / cost[1], log_error: squares.sqrt(), groups }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tiles_are_spread_and_each_comes_once() {
        for size in [[20, 15], [3, 1], [1, 1], [7, 40]] {
            let order = spread(size);
            let mut sorted = order.clone();
            sorted.sort_unstable();
            sorted.dedup();
            assert_eq!(sorted.len() as u32, size[0] * size[1]);
        }
        // Each of twelve equal parts has about a twelfth of the first ones.
        let mut counts = [0; 12];
        spread([20, 15])[..60].iter().for_each(|[x, y]| counts[(y / 5 * 4 + x / 5) as usize] += 1);
        assert!(counts.iter().all(|count| (3..=7).contains(count)), "{counts:?}");
    }

    #[test]
    fn no_pixel_alone_decides_and_uncertain_gains_are_none() {
        let group = |of: f64| [vec![of; 256], vec![1.0; 256]];
        let half = ratio(vec![group(0.5); 8], [2.0, 2.0]);
        assert!(half.remaining == 0.5 && half.log_error == 0.0 && half.pays() && half.is_decided());
        let dear = ratio(vec![group(0.5); 8], [4.0, 2.0]);
        assert!(dear.remaining == 1.0 && !dear.pays() && dear.is_decided());
        let mut firefly = vec![group(0.5); 24];
        firefly[2][0][17] = 1e6;
        firefly[1][0][3] = f64::INFINITY;
        assert_eq!(ratio(firefly, [1.0; 2]).remaining, 0.5);
        let uneven = ratio([0.1, 0.1, 0.1, 0.1, 0.1, 0.1, 0.1, 6.5].map(group).to_vec(), [1.0; 2]);
        assert!(uneven.remaining < 0.95 && !uneven.pays() && !uneven.is_decided(), "{uneven:?}");
        // What is expected counts where groups tell little.
        assert!(uneven.with(0.2).pays() && !uneven.with(0.9).pays());
        assert!((half.with(5.0).remaining - 0.5).abs() < 1e-3 && half.with(5.0).pays());
        // One group that has all of the error is no evidence.
        let mut one = vec![[vec![0.0; 256], vec![0.0; 256]]; 8];
        one[3] = group(0.5);
        assert!(!ratio(one.clone(), [1.0; 2]).pays() && !ratio(one, [1.0; 2]).is_decided());
        let black = ratio(vec![[vec![0.0; 256], vec![0.0; 256]]; 8], [1.0; 2]);
        assert!(black.remaining == 1.0 && !black.pays() && black.is_decided());
    }

    #[test]
    fn errors_are_relative_to_the_mean_of_a_block() {
        let pixels: Vec<_> = (0..8u32).flat_map(|y| (0..10).map(move |x| [x, y])).collect();
        let mut pixels = pixels;
        pixels.sort_by_key(|at| block(*at));
        let bright = |[x, _]: [u32; 2]| if x < BLOCK { 10.0 } else { 0.1 };
        let all = |by: f32| pixels.iter().map(|at| Vec3::splat(bright(*at) as f32 * by)).collect::<Vec<_>>();
        let (scattered, emitted) = ([all(1.1), all(0.9)], all(2.0));
        let group =
            || Group { pixels: pixels.clone(), scattered: scattered.clone(), emitted: emitted.clone(), cost: 1.0 };
        let [way, base] = errors(&group(), &group());
        assert_eq!(way, base);
        for (at, error) in pixels.iter().zip(&way) {
            let expected = 3.0 * (0.2_f64 * bright(*at)).powi(2) / relative_to(3.0 * bright(*at));
            assert!((error / expected - 1.0).abs() < 1e-4, "{at:?}: {error} {expected}");
        }
    }
}
