//! The part of the backend that queries read.

use std::sync::Arc;

use embree4_sys as sys;

use super::device::SceneHandle;
use crate::scene::Scene;

/// A committed Embree scene, with the data that maps hits to instances and meshes.
pub(super) struct CommittedScene {
    pub(super) top: SceneHandle,
    pub(super) scene: Arc<Scene>,
    pub(super) placements: Vec<Placement>,
    pub(super) has_alpha: bool,
}

/// The instance and mesh of a geometry of the top scene.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Placement {
    /// Index into [`Scene::instances`].
    pub(super) instance: u32,
    /// Index into [`Scene::meshes`]; for an instance geometry that of its first mesh.
    pub(super) mesh: u32,
}

impl CommittedScene {
    /// Instance and mesh of a hit from Embree's geometry and instance ids.
    pub(super) fn placement_of(&self, geometry: u32, instance: u32) -> Placement {
        if instance == sys::RTC_INVALID_GEOMETRY_ID {
            self.placements[geometry as usize]
        } else {
            let placement = self.placements[instance as usize];
            Placement { mesh: placement.mesh + geometry, ..placement }
        }
    }
}
