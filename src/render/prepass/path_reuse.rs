//! Decides whether first surfaces share what their paths find ([`reuse`]), and in groups of which sizes.
//! Some of the picture's tiles are rendered each way, in two scrambles; their difference is the error.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use rayon::prelude::*;
use tracing::{debug, warn};

use super::comparison::{error, spread};
use super::effort;
use super::rounds::Decided;
use crate::film::compare::relative_to;
use crate::integrator::{Proposal, Reuse, Transport, reuse};
use crate::render::pass::decisions::TechniqueStats;
use crate::render::pass::tile::Tile;
use crate::render::settings::Columns;
use crate::render::settings::RenderSettings;
use crate::render::settings::part::TILE;
use crate::render::settings::techniques::{Choice, Technique};
use crate::sampling::hash;

/// Paths per pixel in each scramble.
const PATHS: u32 = 4;
/// Tiles of the picture over those of each step, and the minimum and maximum of these. The second step takes place where the first
/// is promising.
const TILES: (f64, [f64; 2]) = (128.0, [8.0, 32.0]);
/// Side in pixels of the blocks by whose mean errors are divided: a few paths do not estimate that of a pixel.
const BLOCK: u32 = 4;
/// Standard errors by which a way must gain, and by which the first step may be wrong.
const STANDARD_ERRORS: f64 = 1.28;
/// One pixel of this number has at most the error of the next: with few paths the largest errors are mostly chance.
const LARGEST: usize = 100;

/// A way to render: with groups of these sizes, or none.
type Way = Option<Reuse>;

/// What was decided.
#[derive(Debug)]
pub struct PathReuse {
    stats: TechniqueStats,
}

impl Decided for PathReuse {
    fn stats(&self) -> (Technique, TechniqueStats) {
        (Technique::PathReuse, self.stats)
    }

    fn apply<'a>(&'a self, proposal: Proposal<'a>) -> Proposal<'a> {
        Proposal { reuse: self.stats.sizes, ..proposal }
    }
}

/// A way over another: error times cost, and the standard error of the logarithm of the errors' ratio.
#[derive(Debug, Clone, Copy)]
struct Ratio {
    remaining: f64,
    standard_error: f64,
}

impl PathReuse {
    /// Decides for paths of `transport`. `None` where `settings` turn it off or nothing can be shared, and soon after `stop` is
    /// raised.
    pub fn decide(transport: &Transport, settings: &RenderSettings, stop: &AtomicBool) -> Option<Self> {
        if !settings.asks_for(Technique::PathReuse) || transport.max_depth < 3 {
            return None;
        }
        let always = settings.techniques[Technique::PathReuse] == Choice::On;
        if settings.light_groups.is_some() || !reuse::is_possible(transport) {
            if always {
                warn!(
                    "path re-use: nothing is shared in scenes with motion or blended alpha, with a clamp or groups of lights"
                );
            }
            return None;
        }
        if always {
            let sizes = settings.reuse_sizes.unwrap_or_default();
            let stats = TechniqueStats { on: true, sizes: Some(sizes), ..Default::default() };
            return Some(Self { stats });
        }
        let began = Instant::now();
        let stopped = || stop.load(Ordering::Relaxed) || effort::is_late(settings, began);
        let grid = [settings.width, settings.height].map(|n| n.div_ceil(TILE));
        let (share, [min, max]) = TILES;
        let tiles = (f64::from(grid[0] * grid[1]) / share).clamp(min, max) as u32;
        let all = spread(grid, 2 * tiles);
        let (first_step, second_step) = all.split_at(tiles as usize);
        let usual = Reuse::usual(settings.expected_spp());
        let ways: Vec<Way> = std::iter::once(None).chain(usual.iter().copied().map(Some)).collect();
        let first = compare(transport, settings, first_step, &ways[..2], stopped)?[0];
        debug!("path re-use by {}: {first:?}", usual[0]);
        let (mut remaining, mut sizes) = (first.remaining, None);
        if first.remaining < effort::MAX_REMAINING_SHARED * (STANDARD_ERRORS * first.standard_error).exp() {
            let found = compare(transport, settings, second_step, &ways, stopped)?;
            debug!("path re-use by {usual:?}: {found:?}");
            let (way, best) = usual.iter().zip(found).min_by(|(_, a), (_, b)| a.remaining.total_cmp(&b.remaining))?;
            remaining = best.remaining;
            sizes = Some(*way).filter(|_| {
                best.remaining * (STANDARD_ERRORS * best.standard_error).exp() < effort::MAX_REMAINING_SHARED
            });
        }
        let (on, seconds) = (sizes.is_some(), began.elapsed().as_secs_f64());
        Some(Self { stats: TechniqueStats { on, sizes, remaining: Some(remaining), seconds, ..Default::default() } })
    }
}

/// Renders these tiles in these ways, and compares all others with the first. `None` soon after `stopped`.
fn compare(
    transport: &Transport,
    settings: &RenderSettings,
    tiles: &[[u32; 2]],
    ways: &[Way],
    stopped: impl Fn() -> bool + Sync,
) -> Option<Vec<Ratio>> {
    let of_tile = |position: &[u32; 2]| (!stopped()).then(|| errors(transport, settings, *position, ways));
    let found: Vec<_> = tiles.par_iter().with_max_len(1).map(of_tile).collect::<Option<_>>()?;
    let cost = |way: usize| found.iter().map(|tile| tile[way].1).sum::<f64>().max(1.0);
    // By way and tile.
    let errors: Vec<Vec<f64>> = (0..ways.len())
        .map(|way| {
            let mut all: Vec<f64> = found.iter().flat_map(|tile| &tile[way].0).copied().collect();
            all.sort_by(f64::total_cmp);
            let most = all.len().checked_sub(1 + all.len() / LARGEST).map_or(0.0, |i| all[i]);
            found.iter().map(|tile| tile[way].0.iter().map(|error| error.min(most)).sum()).collect()
        })
        .collect();
    let sum = |way: usize| errors[way].iter().sum::<f64>();
    let ratio = |way: usize| {
        let sums = [way, 0].map(sum);
        if sums.iter().any(|sum| !sum.is_finite() || *sum <= 0.0) {
            return Ratio { remaining: 1.0, standard_error: 0.0 };
        }
        // The deviation of a ratio of sums, to the first order.
        let squares = errors[way].iter().zip(&errors[0]).map(|(a, b)| (a / sums[0] - b / sums[1]).powi(2));
        Ratio { remaining: sums[0] / sums[1] * cost(way) / cost(0), standard_error: squares.sum::<f64>().sqrt() }
    };
    Some((1..ways.len()).map(ratio).collect())
}

/// Relative squared errors of the pixels of a tile rendered in these ways, and the cost in rays.
fn errors(transport: &Transport, settings: &RenderSettings, position: [u32; 2], ways: &[Way]) -> Vec<(Vec<f64>, f64)> {
    let RenderSettings { width, height, .. } = *settings;
    let scramble = |way: Way, number: u32| {
        let seed = hash(transport.seed ^ hash(0x7265_7573 + number));
        let transport =
            Transport { seed, proposal: Proposal { reuse: way, ..transport.proposal }, ..transport.clone() };
        let mut tile = Tile::new(position, width, height, Columns { layers: 0, ..settings.columns() });
        let cost = effort::cost(&tile.pass(&transport, settings, PATHS).counts);
        (tile.stats.iter().map(|stats| stats.mean()).collect::<Vec<_>>(), cost)
    };
    let found: Vec<_> = ways.iter().map(|way| [0, 1].map(|number| scramble(*way, number))).collect();
    // Noise favours no way.
    let columns = (width - position[0] * TILE).min(TILE);
    let block = |i: usize| (i as u32 / columns / BLOCK * TILE + i as u32 % columns / BLOCK) as usize;
    let mut means = [(0.0, [0.0; 3]); (TILE * TILE) as usize];
    for (i, color) in found.iter().flatten().flat_map(|(colors, _)| colors.iter().enumerate()) {
        let (n, sums) = &mut means[block(i)];
        *n += 1.0;
        (0..3).for_each(|c| sums[c] += f64::from(color[c]));
    }
    let of_pixel = |(i, colors): (usize, [[f32; 3]; 2])| {
        let (n, sums) = means[block(i)];
        error(&colors, sums.map(|sum| relative_to(sum / n))).unwrap_or(f64::INFINITY)
    };
    let way = |[(a, cost), (b, more)]: &[(Vec<[f32; 3]>, f64); 2]| {
        (a.iter().zip(b).map(|(a, b)| [*a, *b]).enumerate().map(of_pixel).collect(), cost + more)
    };
    found.iter().map(way).collect()
}
