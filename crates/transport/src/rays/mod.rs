//! Ray queries over batches of rays, [`RayQueries`], with two backends: Embree 4 as the system provides it ([`embree`]), and
//! obvhs ([`cwbvh`]).

use std::sync::Arc;

use crate::Result;
use crate::scene::Scene;

mod batch;
mod build;
mod check;
pub mod cwbvh;
pub mod embree;
mod queries;

pub use batch::{AnyHit, HitBatch, MISS, RayBatch, RayOrder};
pub use build::Watch;
pub use queries::{BackendInfo, RayQueries};

bismar_scene::named_variants! {
    /// Which library answers ray queries.
    pub enum Backend {
        /// Embree 4, as installed on the system.
        Embree = "embree",
        /// obvhs, a BVH library in pure Rust.
        Obvhs = "obvhs",
    }
}

/// Builds the acceleration structure of a scene, with as many threads as the current rayon pool has.
///
/// # Errors
/// See [`embree::EmbreeRays::build`] and [`cwbvh::ObvhsRays::build`].
pub fn build(backend: Backend, scene: Arc<Scene>) -> Result<Box<dyn RayQueries>> {
    build_watched(backend, scene, &|_| true)
}

/// Builds the acceleration structure of a scene and reports progress to `watch`, which may stop it.
///
/// # Errors
/// The errors of [`build`], and [`Error::Interrupted`](crate::Error::Interrupted) if `watch` stops the build.
pub fn build_watched(backend: Backend, scene: Arc<Scene>, watch: Watch) -> Result<Box<dyn RayQueries>> {
    Ok(match backend {
        Backend::Embree => {
            // Embree has its own thread pool.
            let options = embree::EmbreeOptions { threads: rayon::current_num_threads(), ..Default::default() };
            Box::new(embree::EmbreeRays::build(scene, &options, watch)?)
        }
        Backend::Obvhs => Box::new(cwbvh::ObvhsRays::build(scene, &cwbvh::ObvhsOptions::default(), watch)?),
    })
}
