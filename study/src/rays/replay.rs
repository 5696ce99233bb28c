//! Timed replay of a stream by a backend.

use bismar::rays::{HitBatch, RayQueries};
use bismar::sampling::SplitMix64;

use super::stream::{Kind, Query, Stream};
use crate::clock::thread_seconds;

/// Shortest time of a measurement in seconds; streams are replayed as often as that takes.
const LEAST_SECONDS: f64 = 0.02;

pub type Sink = (HitBatch, Vec<bool>);

/// Traces a query; the answer replaces the one before.
pub fn answer(backend: &dyn RayQueries, Query { kind, order, rays }: &Query, (hits, occluded): &mut Sink) {
    match kind {
        Kind::Closest => backend.closest_hits(rays, *order, hits),
        Kind::Occluded => backend.occluded(rays, *order, occluded),
    }
}

/// Seconds of both for a replay, alternating who is first: neither finds caches and clocks in a better state
/// than the other.
pub(super) fn in_turn(both: [&dyn RayQueries; 2], stream: &Stream, round: usize, sink: &mut Sink) -> [f64; 2] {
    let once = both.map(|backend| replay(backend, stream, sink));
    let least = once[0].min(once[1]).max(1e-9);
    let times = ((LEAST_SECONDS / least).ceil() as usize).clamp(2, 1000);
    let mut sums = [0.0; 2];
    for turn in round..round + times {
        for which in if turn.is_multiple_of(2) { [0, 1] } else { [1, 0] } {
            sums[which] += replay(both[which], stream, sink);
        }
    }
    sums.map(|sum| sum / times as f64)
}

/// Blocks of memory of random sizes: what is allocated while they are there lies elsewhere than the time before. Where it
/// lies can matter as much as what it is: Mytkowicz et al. (2009), *Producing Wrong Data Without Doing Anything Obviously
/// Wrong!*
pub(super) fn spaces(random: &mut SplitMix64) -> Vec<Vec<u8>> {
    let mut block = || std::hint::black_box(Vec::with_capacity(16 + (random.bits() >> 51) as usize));
    (0..64).map(|_| block()).collect()
}

/// Processor seconds of this thread for one replay.
/// Contender and baseline are to write to the same places: where columns lie matters as much as a tree in small scenes.
pub(super) fn replay(backend: &dyn RayQueries, stream: &Stream, sink: &mut Sink) -> f64 {
    let start = thread_seconds();
    stream.queries.iter().for_each(|query| answer(backend, query, sink));
    thread_seconds() - start
}
