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
    pub rays: Arc<dyn RayQueries + 'a>,
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
        Self::after(scene, rays.into(), None)
    }

    /// As [`Self::new`], with the tables of `previous` where they are of the same environment.
    pub fn after(scene: Arc<Scene>, rays: Arc<dyn RayQueries + 'a>, previous: Option<&Self>) -> Self {
        let geometry = Geometry::new(&scene);
        let materials = Materials::new(&scene);
        let lights = Lights::after(&scene, scene.radius(), previous.map(|p| (&*p.scene, &p.lights)));
        let names = Names {
            objects: scene.instances.iter().map(|instance| cryptomatte::id(&instance.name)).collect(),
            materials: scene.materials.iter().map(|material| cryptomatte::id(&material.name)).collect(),
        };
        Self { scene, rays, geometry, materials, lights, names }
    }

    /// Its ray queries, if they would answer for another scene's surfaces alike.
    pub fn rays_of(&self, other: &Scene) -> Option<Arc<dyn RayQueries + 'a>> {
        self.scene.has_surfaces_of(other).then(|| Arc::clone(&self.rays))
    }
}
