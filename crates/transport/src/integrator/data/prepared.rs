//! A scene prepared for rendering, shared by passes, jobs and replicas.

use std::sync::Arc;

use crate::Result;
use crate::film::cryptomatte;
use crate::integrator::surface::geometry::Geometry;
use crate::integrator::surface::materials::Materials;
use crate::light::Lights;
use crate::rays::{self, Backend, RayQueries};
use crate::scene::{Camera, Scene};

/// A scene with its acceleration structure and tables; independent of render settings. Clones share all.
#[derive(Clone)]
pub struct PreparedScene<'a> {
    pub scene: Arc<Scene>,
    pub rays: Arc<dyn RayQueries + 'a>,
    /// Instance transforms, prepared for shading.
    pub geometry: Arc<Geometry>,
    /// Materials, prepared for shading.
    pub materials: Arc<Materials>,
    /// The lights, with their sampling tables.
    pub lights: Arc<Lights>,
    pub names: Arc<Names>,
}

#[derive(Debug)]
pub struct Names {
    /// By instance.
    pub objects: Vec<u32>,
    pub materials: Vec<u32>,
}

impl<'a> PreparedScene<'a> {
    /// Builds the acceleration structure and the tables, with the threads of the current rayon pool.
    ///
    /// # Errors
    /// The errors of [`rays::build`].
    pub fn build(scene: Arc<Scene>, backend: Backend) -> Result<Self> {
        let rays = rays::build(backend, Arc::clone(&scene))?;
        Ok(Self::new(scene, rays))
    }

    /// Builds the tables; `rays` were built from the same surfaces.
    pub fn new(scene: Arc<Scene>, rays: Box<dyn RayQueries + 'a>) -> Self {
        Self::after(scene, rays.into(), None)
    }

    /// Builds the tables, and reuses those of `previous` that belong to the same environment. `rays` were built from the same
    /// surfaces as `scene`.
    pub fn after(scene: Arc<Scene>, rays: Arc<dyn RayQueries + 'a>, previous: Option<&Self>) -> Self {
        let geometry = Geometry::new(&scene);
        let materials = Materials::new(&scene);
        let lights = Lights::after(&scene, scene.radius(), previous.map(|p| (&*p.scene, &*p.lights)));
        let names = Names {
            objects: scene.instances.iter().map(|instance| cryptomatte::id(&instance.name)).collect(),
            materials: scene.materials.iter().map(|material| cryptomatte::id(&material.name)).collect(),
        };
        Self {
            scene,
            rays,
            geometry: geometry.into(),
            materials: materials.into(),
            lights: lights.into(),
            names: names.into(),
        }
    }

    /// The same scene with one more camera, which does not move. All tables are shared.
    pub fn with_camera(&self, camera: Camera) -> Self {
        let mut scene = Scene::clone(&self.scene);
        scene.cameras.push(camera);
        Self { scene: scene.into(), ..self.clone() }
    }

    /// The ray query backend, if `other` has the same surfaces.
    pub fn rays_of(&self, other: &Scene) -> Option<Arc<dyn RayQueries + 'a>> {
        self.scene.has_surfaces_of(other).then(|| Arc::clone(&self.rays))
    }
}
