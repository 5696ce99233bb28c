//! The trait of a backend.

use super::batch::{HitBatch, RayBatch, RayOrder};

/// What a backend says of itself, for `--stats` and picture headers.
#[derive(Debug, Clone)]
pub struct BackendInfo {
    /// `embree` or `obvhs`.
    pub name: &'static str,
    /// Library version.
    pub version: String,
    /// Instruction set that traversal uses.
    pub isa: String,
    /// Seconds that the build took.
    pub build_seconds: f64,
    /// Bytes of the acceleration structure.
    pub memory_bytes: u64,
    /// The most that the library held at once while it built, where it says so.
    pub peak_bytes: Option<u64>,
}

/// A scene that rays can be shot at. Surfaces with alpha are resolved inside: a hit is a hit that counts.
pub trait RayQueries: Send + Sync {
    /// Closest hits; resizes `hits` to the batch.
    fn closest_hits(&self, rays: &RayBatch, order: RayOrder, hits: &mut HitBatch);
    /// Is anything in each ray's interval? Resizes `occluded` to the batch.
    fn occluded(&self, rays: &RayBatch, order: RayOrder, occluded: &mut Vec<bool>);
    /// What it is.
    fn info(&self) -> &BackendInfo;
}

impl<T: RayQueries + ?Sized> RayQueries for &T {
    fn closest_hits(&self, rays: &RayBatch, order: RayOrder, hits: &mut HitBatch) {
        (**self).closest_hits(rays, order, hits);
    }

    fn occluded(&self, rays: &RayBatch, order: RayOrder, occluded: &mut Vec<bool>) {
        (**self).occluded(rays, order, occluded);
    }

    fn info(&self) -> &BackendInfo {
        (**self).info()
    }
}
