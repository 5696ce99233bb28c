//! The read-only input of path tracing.

use std::sync::Arc;

use super::camera::CameraRays;
use super::dimensions::MAX_SEGMENTS;
use super::light_layers::{LightKind, LightLayerTable, LightNumber};
use super::prepared::Names;
use super::proposal::Proposal;
use crate::balance::{Counts, Heuristic};
use crate::integrator::surface::geometry::Geometry;
use crate::integrator::surface::geometry::SurfacePoint;
use crate::integrator::surface::materials::Materials;
use crate::light::Lights;
use crate::rays::{HitBatch, RayBatch, RayQueries};
use crate::sampling::FilterSampler;
use crate::scene::Scene;

/// Bounces of a path at smooth glass that are not counted, at most: those behind are. It ends paths that glass has trapped.
pub(crate) const MAX_GLASS_BOUNCES: u32 = 24;

/// Everything that paths read and no path changes.
#[derive(Clone)]
pub struct Transport<'a> {
    pub scene: &'a Scene,
    pub rays: &'a dyn RayQueries,
    /// Instance transforms, prepared for shading.
    pub geometry: &'a Geometry,
    /// Materials, prepared for shading.
    pub materials: &'a Materials,
    /// The lights, with their sampling tables.
    pub lights: &'a Lights,
    pub names: &'a Names,
    pub camera: CameraRays,
    /// Samples positions in the pixel filter.
    pub filter: FilterSampler,
    pub heuristic: Heuristic,
    /// Largest number of path segments, less those after bounces that do not count ([`RayHistory`](super::history::RayHistory)).
    pub max_depth: u32,
    /// Seed of all random sequences.
    pub seed: u32,
    /// Clamps of single light contributions, the largest value of a colour channel: at first surfaces, and at later ones.
    /// Infinite for no clamp. Light that the camera sees directly is never clamped.
    pub limits: [f32; 2],
    /// Is the environment invisible to camera rays?
    pub hides_environment: bool,
    /// Do rays from the camera and their mirror images pass back faces of single-sided materials
    /// ([`back_faces`](crate::integrator::through::back_faces))?
    pub culls_back_faces: bool,
    /// Do shadow rays pass bodies of smooth glass, straight ([`glass_shadows`](crate::integrator::through::glass_shadows))?
    pub straight_glass_shadows: bool,
    /// Height in metres of the ground that catches shadows ([`ground`](crate::integrator::clients::ground)), if there is one.
    pub ground: Option<f32>,
    /// Layers of the lights, where they are not by kind.
    pub layers: Option<Arc<LightLayerTable>>,
    /// What light samples and directions are drawn by.
    pub proposal: Proposal<'a>,
}

impl Transport<'_> {
    /// Largest number of path segments, all counted.
    pub fn longest_path(&self) -> u32 {
        let uncounted = if self.materials.has_smooth_bodies { MAX_GLASS_BOUNCES } else { 0 };
        self.max_depth.saturating_add(uncounted).min(MAX_SEGMENTS)
    }

    /// Layer of a light of a kind, which `of` finds in the table.
    #[inline]
    pub fn layer(&self, kind: LightKind, of: impl FnOnce(&LightLayerTable) -> u8) -> u8 {
        self.layers.as_deref().map_or(kind.layer(), of)
    }

    /// Layer of a light that a light sample has chosen.
    #[inline]
    pub(crate) fn sampled_layer(&self, light: LightNumber) -> u8 {
        self.layer(light.kind(), |layers| layers.sampled(light))
    }

    /// The surface point that a ray hit.
    #[inline]
    pub fn point(&self, rays: &RayBatch, hits: &HitBatch, ray: usize) -> SurfacePoint<'_> {
        self.geometry.point(self.scene, hits.primitive(ray), (hits.u[ray], hits.v[ray]), rays.time(ray))
    }

    /// One sample of each technique per path, where lights can be sampled; for paths whose light share nobody learns.
    pub fn half(&self, paths: u32) -> Counts {
        if self.lights.has_extent() { Counts::half(paths) } else { Counts::bsdf_only(paths) }
    }

    /// Does the wave cull back faces?
    pub fn culls(&self) -> bool {
        self.culls_back_faces && self.materials.has_single_sided
    }

    /// Do shadow rays pass bodies of smooth glass, and are there any?
    pub fn passes_bodies(&self) -> bool {
        self.straight_glass_shadows && self.materials.has_smooth_bodies
    }

    /// Samples per path beyond first surfaces (environment, area lights, BSDF): one light sample and one BSDF sample.
    pub fn deeper_samples_per_path(&self) -> [f32; 3] {
        Counts::half(1).samples_per_path(self.proposal.lights.environment_probability)
    }
}
