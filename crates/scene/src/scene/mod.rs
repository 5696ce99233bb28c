//! Plain scene data: what an importer fills and everything downstream reads. It knows nothing of rays or files
//! (only [`import`] does).

use std::sync::Arc;

use glam::Vec3;

pub mod alpha;
pub mod camera;
mod choose;
pub mod environment;
pub mod framing;
pub mod import;
pub mod lights;
pub mod material;
pub mod mesh;
pub mod motion;
pub mod texture;

pub use camera::{Camera, Projection};
#[doc(hidden)]
pub use choose::choose;
pub use environment::Environment;
pub use framing::Framing;
pub use lights::{LightKey, PunctualKind, PunctualLight};
pub use material::{AlphaMode, Encoding, Material, TextureRef, TextureSlot, Textures};
pub use mesh::{FARTHEST, Instance, Mesh, Object, Positions};
pub use motion::{Deformation, Motion};
pub use texture::{Filter, Image, Texels, Texture, Wrap};

/// A scene, ready to be built into ray queries. Lengths in metres, glTF axes (+y up, right-handed).
#[derive(Debug, Clone, Default)]
pub struct Scene {
    /// Triangle meshes, one a glTF primitive.
    pub meshes: Vec<Arc<Mesh>>,
    /// Groups of meshes that are placed together, one a glTF mesh.
    pub objects: Vec<Object>,
    /// Placements of objects. An object that is placed once has its transform baked into its meshes.
    pub instances: Vec<Instance>,
    /// Materials; every mesh names one.
    pub materials: Vec<Material>,
    /// Decoded pictures, only those that a reachable material samples.
    pub images: Vec<Arc<Image>>,
    /// Pictures with their sampler.
    pub textures: Vec<Texture>,
    /// Point, spot and directional lights, in world space.
    pub lights: Vec<PunctualLight>,
    /// Cameras, in world space; at least one (a framed view when the file has none). What renders asks
    /// [`Scene::camera`].
    pub cameras: Vec<Camera>,
    /// What the framed view, the last of the cameras, is fitted to; of a file without a camera, or where it was asked for.
    pub framing: Option<Box<Framing>>,
    /// Light from infinity.
    pub environment: Option<Environment>,
}

impl Scene {
    /// Number of triangles of an object.
    pub fn triangles(&self, object: u32) -> usize {
        self.objects[object as usize].meshes.clone().map(|mesh| self.meshes[mesh as usize].indices.len()).sum()
    }

    /// Camera `index` for a picture of `width` by `height`: the framed view fits it.
    pub fn camera(&self, index: usize, width: u32, height: u32) -> Camera {
        match &self.framing {
            Some(framing) if index + 1 == self.cameras.len() => framing.camera(f64::from(width) / f64::from(height)),
            _ => self.cameras[index].clone(),
        }
    }

    /// Adds the framed view to a file's cameras, unless it or another of its name is there.
    pub fn frame(&mut self) {
        if self.cameras.iter().any(|camera| camera.name == Framing::NAME) {
            return;
        }
        let mut framing = Box::<Framing>::default();
        for instance in &self.instances {
            let transform = instance.transform;
            let placed = |p: &[f32; 3]| {
                let p = Vec3::from_array(*p);
                transform.map_or(p, |t| t.transform_point3(p)).as_dvec3()
            };
            let meshes = self.objects[instance.object as usize].meshes.clone();
            let points = meshes.flat_map(|mesh| self.meshes[mesh as usize].positions.iter());
            points.for_each(|p| framing.include(placed(p)));
        }
        self.cameras.push(framing.camera(1.0));
        self.framing = Some(framing);
    }

    /// Does anything move while the shutter is open?
    pub fn moves(&self) -> bool {
        self.meshes.iter().any(|mesh| mesh.motion.is_some())
            || self.instances.iter().any(|instance| instance.motion.is_some())
            || self.cameras.iter().any(|camera| camera.motion.is_some())
            || self.lights.iter().any(|light| !light.motion.is_empty())
    }

    /// Is anything elsewhere, or seen from elsewhere, a frame before or after, as far as that is known?
    pub fn has_velocities(&self) -> bool {
        self.meshes.iter().any(|mesh| mesh.adjacent_frames.is_some())
            || self.instances.iter().any(|instance| instance.adjacent_frames.is_some())
            || self.cameras.iter().any(|camera| camera.adjacent_frames.is_some())
    }

    /// Of each mesh, whether it is elsewhere, or has another form, at some time that the shutter is open.
    pub fn moving_meshes(&self) -> Vec<bool> {
        let mut moving: Vec<bool> = self.meshes.iter().map(|mesh| mesh.motion.is_some()).collect();
        for instance in self.instances.iter().filter(|instance| instance.motion.is_some()) {
            let Object { meshes, .. } = &self.objects[instance.object as usize];
            moving[meshes.start as usize..meshes.end as usize].fill(true);
        }
        moving
    }

    /// Would rays meet the same surfaces in the other scene? Says so only where both share their meshes.
    pub fn has_surfaces_of(&self, other: &Self) -> bool {
        let meshes = |scene: &Self| scene.meshes.iter().map(Arc::as_ptr).collect::<Vec<_>>();
        let images = |scene: &Self| scene.images.iter().map(Arc::as_ptr).collect::<Vec<_>>();
        let placed = |scene: &Self| {
            let place = |i: &Instance| (scene.objects[i.object as usize].meshes.clone(), i.transform, i.motion.clone());
            scene.instances.iter().map(place).collect::<Vec<_>>()
        };
        // Whether a ray goes through them.
        let opaque = |scene: &Self| scene.materials.iter().all(|material| material.alpha_mode == AlphaMode::Opaque);
        let alike = || {
            (&self.materials, &self.textures) == (&other.materials, &other.textures) && images(self) == images(other)
        };
        meshes(self) == meshes(other) && placed(self) == placed(other) && (opaque(self) && opaque(other) || alike())
    }

    /// Does anything in it shine, or is all of it shown without light?
    pub fn is_lit(&self) -> bool {
        let unlit = !self.materials.is_empty() && self.materials.iter().all(|m| m.unlit);
        unlit
            || self.materials.iter().any(Material::is_emissive)
            || self.environment.is_some()
            || !self.lights.is_empty()
    }

    /// Lights a scene in which nothing shines by [`Environment::studio`]; says whether it did.
    pub fn light_if_dark(&mut self) -> bool {
        let dark = !self.is_lit();
        if dark {
            self.environment = Some(Environment::studio());
        }
        dark
    }

    /// Radius in metres of a sphere around everything, 0 for an empty scene.
    pub fn radius(&self) -> f32 {
        let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        for mesh_box in self.boxes() {
            low = low.min(mesh_box.0);
            high = high.max(mesh_box.1);
        }
        if low.x > high.x { 0.0 } else { 0.5 * (high - low).length() }
    }

    /// World-space corners (lowest, highest) of a box around each placed mesh.
    fn boxes(&self) -> impl Iterator<Item = (Vec3, Vec3)> {
        let own: Vec<(Vec3, Vec3)> = self
            .meshes
            .iter()
            .map(|mesh| {
                let points = mesh.positions.iter().map(|&p| Vec3::from_array(p));
                points.fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(l, h), p| (l.min(p), h.max(p)))
            })
            .collect();
        self.instances.iter().flat_map(move |instance| {
            let own: Vec<_> = self.objects[instance.object as usize].meshes.clone().map(|m| own[m as usize]).collect();
            own.into_iter().filter(|(l, h)| l.x <= h.x).map(|(l, h)| match instance.transform {
                None => (l, h),
                Some(t) => (0..8).fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), corner| {
                    let pick = |axis: usize| if corner >> axis & 1 == 0 { l[axis] } else { h[axis] };
                    let p = t.transform_point3(Vec3::new(pick(0), pick(1), pick(2)));
                    (low.min(p), high.max(p))
                }),
            })
        })
    }
}
