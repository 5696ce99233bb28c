//! A stopwatch at both ends of every query.

use std::sync::Mutex;
use std::time::Instant;

use bismar::rays::{AnyHit, BackendInfo, HitBatch, RayBatch, RayOrder, RayQueries};
use bismar_study::clock::{process_seconds, thread_seconds};
use bismar_study::rays::stream::Kind;

/// Where one thread's time goes, in seconds.
#[derive(Clone, Copy, Default)]
pub struct Shares {
    pub camera_queries: f64,
    pub bounce_queries: f64,
    pub shadow_queries: f64,
    /// From the hits to the next query: surfaces, light samples, BSDF samples.
    pub shading: f64,
    /// From the shadow query to the next bounce: what it let through is added to the paths.
    pub adding: f64,
    /// From a wave's last query to the next wave's first: paths into pixels, balances, tiles, camera rays.
    pub folding: f64,
}

/// Times queries and what lies between them. For one thread.
pub struct Stopwatch<'a> {
    pub inner: &'a dyn RayQueries,
    /// When the first query began: wall clock, processor seconds of the process.
    pub first: Mutex<Option<(Instant, f64)>>,
    state: Mutex<(Shares, Option<(Kind, f64)>)>,
}

impl<'a> Stopwatch<'a> {
    pub fn new(inner: &'a dyn RayQueries) -> Self {
        Self { inner, first: Mutex::default(), state: Mutex::default() }
    }

    pub fn shares(&self) -> Shares {
        self.state.lock().expect("one thread").0
    }

    fn time(&self, kind: Kind, order: RayOrder, query: impl FnOnce()) {
        self.first.lock().expect("one thread").get_or_insert_with(|| (Instant::now(), process_seconds()));
        let start = thread_seconds();
        query();
        let end = thread_seconds();
        let (shares, last) = &mut *self.state.lock().expect("one thread");
        let camera = kind == Kind::Closest && order == RayOrder::Coherent;
        if let Some((before, ended)) = *last {
            let gap = match (before, camera) {
                (_, true) => &mut shares.folding,
                (Kind::Closest, false) => &mut shares.shading,
                (Kind::Occluded, false) => &mut shares.adding,
            };
            *gap += start - ended;
        }
        let inside = match kind {
            Kind::Occluded => &mut shares.shadow_queries,
            Kind::Closest if camera => &mut shares.camera_queries,
            Kind::Closest => &mut shares.bounce_queries,
        };
        *inside += end - start;
        *last = Some((kind, end));
    }
}

impl RayQueries for Stopwatch<'_> {
    fn closest_hits(&self, rays: &RayBatch, order: RayOrder, hits: &mut HitBatch) {
        self.time(Kind::Closest, order, || self.inner.closest_hits(rays, order, hits));
    }

    fn closest_front_hits(&self, rays: &RayBatch, hits: &mut HitBatch) {
        self.time(Kind::Closest, RayOrder::Incoherent, || self.inner.closest_front_hits(rays, hits));
    }

    fn occluded(&self, rays: &RayBatch, order: RayOrder, occluded: &mut Vec<bool>) {
        self.time(Kind::Occluded, order, || self.inner.occluded(rays, order, occluded));
    }

    fn all_hits(&self, rays: &RayBatch, found: &mut Vec<AnyHit>) {
        self.inner.all_hits(rays, found);
    }

    fn info(&self) -> &BackendInfo {
        self.inner.info()
    }
}
