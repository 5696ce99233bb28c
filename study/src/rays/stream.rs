//! Ray streams: recorded batches of real renders, the same for every backend.

use std::sync::Arc;
use std::sync::Mutex;
use std::sync::atomic::AtomicBool;

use bismar::Result;
use bismar::integrator::PreparedScene;
use bismar::rays::{AnyHit, BackendInfo, HitBatch, RayBatch, RayOrder, RayQueries};
use bismar::render::{Balance, PixelFilter, RenderSettings, render};
use bismar::sampling::SplitMix64;
use bismar::scene::{Scene, TextureSlot};
use glam::{Vec3, Vec4};

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    Closest,
    Occluded,
}

/// One batch, as the renderer handed it over.
#[derive(Debug, Clone)]
pub struct Query {
    pub kind: Kind,
    /// Order that the renderer declared.
    pub order: RayOrder,
    pub rays: RayBatch,
}

/// Forwards queries and records every batch in order. For one thread.
pub struct Recorder<'a> {
    inner: &'a dyn RayQueries,
    tape: Mutex<Vec<Query>>,
}

impl<'a> Recorder<'a> {
    pub fn new(inner: &'a dyn RayQueries) -> Self {
        Self { inner, tape: Mutex::default() }
    }

    pub fn into_tape(self) -> Vec<Query> {
        self.tape.into_inner().unwrap_or_else(|poisoned| poisoned.into_inner())
    }

    fn record(&self, kind: Kind, order: RayOrder, rays: &RayBatch) {
        let mut tape = self.tape.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
        tape.push(Query { kind, order, rays: rays.clone() });
    }
}

impl RayQueries for Recorder<'_> {
    fn closest_hits(&self, rays: &RayBatch, order: RayOrder, hits: &mut HitBatch) {
        self.record(Kind::Closest, order, rays);
        self.inner.closest_hits(rays, order, hits);
    }

    fn closest_front_hits(&self, rays: &RayBatch, hits: &mut HitBatch) {
        self.inner.closest_front_hits(rays, hits);
    }

    fn occluded(&self, rays: &RayBatch, order: RayOrder, occluded: &mut Vec<bool>) {
        self.record(Kind::Occluded, order, rays);
        self.inner.occluded(rays, order, occluded);
    }

    fn all_hits(&self, rays: &RayBatch, found: &mut Vec<AnyHit>) {
        self.inner.all_hits(rays, found);
    }

    fn info(&self) -> &BackendInfo {
        self.inner.info()
    }
}

#[derive(Debug, Clone)]
pub struct Stream {
    pub name: String,
    /// The batches, all of one kind and order.
    pub queries: Vec<Query>,
}

impl Stream {
    pub fn rays(&self) -> usize {
        self.queries.iter().map(|q| q.rays.len()).sum()
    }
}

/// Fewer rays than this say nothing about speed.
const FEWEST: usize = 256;
/// Rays a batch of the sorted and shuffled streams, about as the renderer has them.
const BATCH: usize = 4096;
/// Roughness of all surfaces for the glossy stream.
const GLOSSY: f32 = 0.25;

/// Records the streams of the first camera's view with about `rays` rays each. Camera, shadow and later bounces are those of a
/// path-traced picture as it is; `diffuse` and `glossy` are first bounces with every surface made diffuse, or a metal of
/// roughness ¼ (what alpha cuts out stays cut out); two more have the diffuse ones shuffled, and sorted by octant and origin.
/// Streams of few rays are omitted. Must be called on a pool of one thread.
pub fn record(scene: &Scene, backend: &dyn RayQueries, rays: usize) -> Result<Vec<Stream>> {
    let of = |scene: &Scene, max_depth: u32| -> Result<_> {
        let side = (rays as f64).sqrt().ceil() as u32;
        let settings = RenderSettings {
            width: side,
            height: side,
            spp: Some(1),
            balance: Balance::Half,
            filter: PixelFilter::Box,
            max_depth,
            ..RenderSettings::even()
        };
        let recorder = Recorder::new(backend);
        let scene = PreparedScene::new(Arc::new(scene.clone()), Box::new(&recorder));
        render(&scene, &settings, &AtomicBool::new(false), &|_| {})?;
        drop(scene);
        Ok(parted(recorder.into_tape()))
    };
    let surfaces = |diffuse: bool| {
        let mut scene = scene.clone();
        for material in &mut scene.materials {
            material.metallic = if diffuse { 0.0 } else { 1.0 };
            material.roughness = if diffuse { 1.0 } else { GLOSSY };
            material.specular = if diffuse { 0.0 } else { 1.0 };
            material.base_color = Vec4::new(0.8, 0.8, 0.8, material.base_color.w);
            (material.textures[TextureSlot::MetallicRoughness], material.unlit) = (None, false);
        }
        scene
    };
    let [camera, shadow, _, later] = of(scene, RenderSettings::even().max_depth)?;
    let [_, _, diffuse, _] = of(&surfaces(true), 2)?;
    let [_, _, glossy, _] = of(&surfaces(false), 2)?;
    let apart = [("diffuse-shuffled", shuffled(&diffuse)), ("diffuse-sorted", sorted(&diffuse))];
    let whole = [("camera", camera), ("shadow", shadow), ("diffuse", diffuse), ("glossy", glossy), ("later", later)];
    let all = whole.into_iter().chain(apart).map(|(name, queries)| {
        let queries = thinned(queries, rays);
        Stream { name: name.to_owned(), queries }
    });
    Ok(all.filter(|stream| stream.rays() >= FEWEST).collect())
}

/// The batches of camera rays, shadow rays, first bounces and later ones.
fn parted(tape: Vec<Query>) -> [Vec<Query>; 4] {
    let mut all: [Vec<Query>; 4] = Default::default();
    let mut depth = 0;
    for query in tape {
        let part = match (query.kind, query.order) {
            (Kind::Occluded, _) => 1,
            (Kind::Closest, RayOrder::Coherent) => {
                depth = 0;
                0
            }
            (Kind::Closest, RayOrder::Incoherent) => {
                depth += 1;
                if depth == 1 { 2 } else { 3 }
            }
        };
        all[part].push(query);
    }
    all
}

/// Batches at regular intervals, with about `rays` rays in all.
fn thinned(queries: Vec<Query>, rays: usize) -> Vec<Query> {
    let all = queries.iter().map(|q| q.rays.len()).sum::<usize>();
    let (mut seen, mut taken) = (0, 0);
    let wanted = |seen: usize| (seen as f64 * (rays as f64 / all as f64).min(1.0)) as usize;
    let take = |query: &Query| {
        seen += query.rays.len();
        let take = taken < wanted(seen);
        taken += if take { query.rays.len() } else { 0 };
        take
    };
    queries.into_iter().filter(take).collect()
}

/// The rays in another order, in new batches.
fn reordered(queries: &[Query], arrange: impl FnOnce(&mut Vec<(u32, u32)>)) -> Vec<Query> {
    let places = |(q, query): (usize, &Query)| (0..query.rays.len() as u32).map(move |i| (q as u32, i));
    let mut order = queries.iter().enumerate().flat_map(places).collect::<Vec<_>>();
    arrange(&mut order);
    let batch = |part: &[(u32, u32)]| {
        let mut rays = RayBatch::default();
        for &(q, i) in part {
            let (from, i) = (&queries[q as usize].rays, i as usize);
            rays.push(from.origin(i), from.direction(i), from.tnear[i], from.tfar[i], from.key[i]);
        }
        Query { kind: Kind::Closest, order: RayOrder::Incoherent, rays }
    };
    order.chunks(BATCH).map(batch).collect()
}

fn shuffled(queries: &[Query]) -> Vec<Query> {
    reordered(queries, |order| {
        let mut random = SplitMix64(1);
        for i in (1..order.len()).rev() {
            order.swap(i, random.bits() as usize % (i + 1));
        }
    })
}

/// Sorted by the octant of the direction, then along a Morton curve through the origins.
fn sorted(queries: &[Query]) -> Vec<Query> {
    let origins = || queries.iter().flat_map(|q| (0..q.rays.len()).map(|i| q.rays.origin(i)));
    let (low, high) = origins().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(l, h), p| (l.min(p), h.max(p)));
    let scale = 1023.0 / (high - low).max_element().max(f32::MIN_POSITIVE);
    let spread = |x: f32| (0..10).fold(0_u32, |all, bit| all | ((x as u32 >> bit & 1) << (3 * bit)));
    let key = |&(q, i): &(u32, u32)| {
        let rays = &queries[q as usize].rays;
        let (d, p) = (rays.direction(i as usize), (rays.origin(i as usize) - low) * scale);
        let octant = u32::from(d.x < 0.0) | u32::from(d.y < 0.0) << 1 | u32::from(d.z < 0.0) << 2;
        (octant, spread(p.x) | spread(p.y) << 1 | spread(p.z) << 2)
    };
    reordered(queries, |order| order.sort_by_key(key))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn query(n: usize, seed: u32) -> Query {
        let mut rays = RayBatch::default();
        for i in 0..n as u32 {
            let bits = |k: u32| f32::from_bits((i * 8 + k + seed).wrapping_mul(2_654_435_761) & 0xbfff_ffff);
            rays.push(Vec3::new(bits(0), bits(1), bits(2)), Vec3::new(bits(3), bits(4), -0.0), 0.0, f32::INFINITY, i);
        }
        Query { kind: Kind::Closest, order: RayOrder::Incoherent, rays }
    }

    #[test]
    fn other_orders_have_the_same_rays_and_thinning_leaves_some_from_everywhere() {
        let queries = vec![query(5000, 1), query(3000, 9)];
        let keys = |queries: &[Query]| {
            let mut all = queries.iter().flat_map(|q| q.rays.origin[0].iter().map(|x| x.to_bits())).collect::<Vec<_>>();
            all.sort_unstable();
            all
        };
        for other in [shuffled(&queries), sorted(&queries)] {
            assert_eq!(keys(&other), keys(&queries));
            assert_ne!(other[0].rays.key, queries[0].rays.key[..other[0].rays.len()]);
        }
        let many = (0..100).map(|i| query(10, i)).collect::<Vec<_>>();
        let few = thinned(many, 200);
        assert!((18..=22).contains(&few.len()), "{}", few.len());
    }
}
