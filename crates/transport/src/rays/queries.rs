//! The interface of ray query backends.

use super::batch::{AnyHit, HitBatch, RayBatch, RayOrder};

/// Description of a backend, for `--stats` and image headers.
#[derive(Debug, Clone)]
pub struct BackendInfo {
    /// `embree` or `obvhs`.
    pub name: &'static str,
    pub version: String,
    pub isa: String,
    pub build_seconds: f64,
    /// Size of the acceleration structure in bytes.
    pub memory_bytes: u64,
    /// Peak memory of the library during the build, in bytes, if it reports that.
    pub peak_bytes: Option<u64>,
}

/// Ray queries against a scene. Alpha cutouts and alpha blending are resolved by the backend: reported hits are opaque.
pub trait RayQueries: Send + Sync {
    /// Finds the closest hit of each ray; resizes `hits` to the batch.
    fn closest_hits(&self, rays: &RayBatch, order: RayOrder, hits: &mut HitBatch);
    /// As [`closest_hits`](Self::closest_hits), but backs of [single-sided](crate::scene::Scene::is_single_sided) meshes are no hits.
    fn closest_front_hits(&self, rays: &RayBatch, hits: &mut HitBatch);
    /// Tests whether anything lies in each ray's interval; resizes `occluded` to the batch.
    fn occluded(&self, rays: &RayBatch, order: RayOrder, occluded: &mut Vec<bool>);
    /// Replaces `found` by all hits in each ray's interval, of surfaces whatever their alpha. They come in any order, a triangle
    /// sometimes twice. For scenes that [have bodies](crate::scene::Scene::has_bodies).
    fn all_hits(&self, rays: &RayBatch, found: &mut Vec<AnyHit>);
    /// Name, version and costs of the backend.
    fn info(&self) -> &BackendInfo;
}

impl<T: RayQueries + ?Sized> RayQueries for &T {
    fn closest_hits(&self, rays: &RayBatch, order: RayOrder, hits: &mut HitBatch) {
        (**self).closest_hits(rays, order, hits);
    }

    fn closest_front_hits(&self, rays: &RayBatch, hits: &mut HitBatch) {
        (**self).closest_front_hits(rays, hits);
    }

    fn occluded(&self, rays: &RayBatch, order: RayOrder, occluded: &mut Vec<bool>) {
        (**self).occluded(rays, order, occluded);
    }

    fn all_hits(&self, rays: &RayBatch, found: &mut Vec<AnyHit>) {
        (**self).all_hits(rays, found);
    }

    fn info(&self) -> &BackendInfo {
        (**self).info()
    }
}
