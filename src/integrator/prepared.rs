//! A scene that is ready to be rendered: built once, shared by passes, jobs and replicas.

use std::sync::Arc;

use super::{Geometry, Materials};
use crate::Result;
use crate::film::cryptomatte;
use crate::light::Lights;
use crate::rays::{self, Backend, RayQueries};
use crate::scene::Scene;

/// What does not depend on a render's settings.
pub struct PreparedScene<'a> {
    /// What is there.
    pub scene: Arc<Scene>,
    /// What rays hit.
    pub rays: Box<dyn RayQueries + 'a>,
    /// Instances' transforms, prepared for shading.
    pub geometry: Geometry,
    /// Materials, prepared for shading.
    pub materials: Materials,
    /// What shines, with the tables to sample it.
    pub lights: Lights,
    /// Hashes of names.
    pub names: Names,
}

/// Hashes of names, for Cryptomatte.
#[derive(Debug)]
pub struct Names {
    /// Of each instance.
    pub objects: Vec<u32>,
    /// Of each material.
    pub materials: Vec<u32>,
}

impl<'a> PreparedScene<'a> {
    /// Builds ray queries and tables, with the threads of the current rayon pool.
    ///
    /// # Errors
    /// As [`rays::build`].
    pub fn build(scene: Arc<Scene>, backend: Backend) -> Result<Self> {
        let rays = rays::build(backend, Arc::clone(&scene))?;
        Ok(Self::new(scene, rays))
    }

    /// With ray queries that were built from the same surfaces.
    pub fn new(scene: Arc<Scene>, rays: Box<dyn RayQueries + 'a>) -> Self {
        let geometry = Geometry::new(&scene);
        let materials = Materials::new(&scene);
        let lights = Lights::new(&scene, scene.radius());
        let names = Names {
            objects: scene.instances.iter().map(|instance| cryptomatte::id(&instance.name)).collect(),
            materials: scene.materials.iter().map(|material| cryptomatte::id(&material.name)).collect(),
        };
        Self { scene, rays, geometry, materials, lights, names }
    }
}
