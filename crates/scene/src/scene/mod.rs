//! Plain scene data: filled by an importer or by [`Scene::add`] and [`Camera::look_at`], read by everything downstream.
//! Only [`import`] knows of files; nothing here knows of rays.

use std::sync::Arc;

use glam::{Affine3A, DVec3, Vec2, Vec3, Vec4};

pub mod alpha;
pub mod build;
pub mod calibration;
pub mod camera;
mod choose;
pub mod environment;
pub mod framing;
pub mod import;
pub mod lights;
pub mod material;
pub mod mesh;
pub mod motion;
pub mod placed;
pub mod sky;
pub mod texture;

pub use calibration::Calibration;
pub use camera::{Camera, Projection};
#[doc(hidden)]
pub use choose::choose;
pub use environment::Environment;
pub use framing::Framing;
pub use lights::{LightKey, LightNode, MAX_RADIUS, PunctualKind, PunctualLight};
pub use material::{AlphaMode, Encoding, Material, TextureRef, TextureSlot, Textures};
pub use mesh::{Deformation, Instance, MAX_COORDINATE, Mesh, Object, Positions};
pub use motion::Motion;
pub use placed::{FieldOfView, Orbit, PlacedCamera};
pub use sky::ClearSky;
pub use texture::{Filter, Image, Texels, Texture, Wrap};

/// A scene, ready to be built into ray queries. Lengths in metres; glTF's axes (+y up, right-handed).
#[derive(Debug, Clone, Default)]
pub struct Scene {
    /// Triangle meshes, one per glTF primitive.
    pub meshes: Vec<Arc<Mesh>>,
    /// Groups of meshes that are placed together, one per glTF mesh.
    pub objects: Vec<Object>,
    /// Placements of objects. The importer bakes the transform of an object that is placed once into its meshes.
    pub instances: Vec<Instance>,
    /// Materials; every mesh refers to one.
    pub materials: Vec<Material>,
    /// Decoded pictures; the importer keeps only those that a reachable material samples.
    pub images: Vec<Arc<Image>>,
    /// Pictures with their samplers.
    pub textures: Vec<Texture>,
    /// Point, spot and directional lights, in world space.
    pub lights: Vec<PunctualLight>,
    /// Their nodes, as far as they have any.
    pub light_nodes: Vec<LightNode>,
    /// Cameras, in world space. An imported scene has at least one: a view that frames the scene if the file has no
    /// camera. The renderer reads them through [`Scene::camera`].
    pub cameras: Vec<Camera>,
    /// Light from infinity; `None` for black.
    pub environment: Option<Environment>,
    /// Where the coordinates of this scene begin, in those of the file, metres. The importer moves scenes that are far from the
    /// file's origin to their eye, as 32 bits would round their coordinates.
    pub origin: DVec3,
    /// What surfaces reach over a played animation, by which all its frames are framed; `None` where none is played.
    pub reach: Option<Arc<AnimatedBounds>>,
}

/// A triangle in a scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Primitive {
    /// Index into [`Scene::instances`].
    pub instance: u32,
    /// Index into [`Scene::meshes`].
    pub mesh: u32,
    /// Index into [`Mesh::indices`].
    pub prim: u32,
}

/// The points that surfaces reach over a whole animation.
#[derive(Debug, Clone)]
pub struct AnimatedBounds {
    /// Lower and upper corner of their box, world space, metres.
    pub bounds: [Vec3; 2],
    /// Centre of the box and the largest distance of a point from it.
    pub sphere: (DVec3, f64),
    /// The view that shows them all.
    pub framing: Framing,
}

impl Scene {
    /// Adds a mesh with a material of its own, as an object that is placed once at its own coordinates (world space).
    /// Returns the index of the new instance, through which it can be moved.
    pub fn add(&mut self, mut mesh: Mesh, material: Material) -> usize {
        let (index, object) = (self.meshes.len() as u32, self.objects.len() as u32);
        self.reach = None;
        mesh.material = self.materials.len() as u32;
        self.materials.push(material);
        self.objects.push(Object { name: mesh.name.clone(), meshes: index..index + 1 });
        self.instances.push(Instance { name: mesh.name.clone(), object, ..Default::default() });
        self.meshes.push(mesh.into());
        self.instances.len() - 1
    }

    /// Number of triangles of an object.
    pub fn triangles(&self, object: u32) -> usize {
        self.objects[object as usize].meshes.clone().map(|mesh| self.meshes[mesh as usize].indices.len()).sum()
    }

    /// Camera `index` for a picture of `width` by `height` pixels. A camera with a [`Camera::framing`] is fitted to the
    /// picture's aspect; every other one is returned unchanged.
    pub fn camera(&self, index: usize, width: u32, height: u32) -> Camera {
        let mut camera = self.cameras[index].clone();
        if let Some(framing) = &camera.framing {
            camera.to_world = framing.to_world(f64::from(width) / f64::from(height));
        }
        camera
    }

    /// Adds a view that shows all of the scene ([`Camera::framed`]), unless there is a camera of its name.
    pub fn frame(&mut self) {
        if self.cameras.iter().any(|camera| camera.name == Framing::NAME) {
            return;
        }
        let framing = self.reach.as_ref().map(|reach| reach.framing.clone()).unwrap_or_else(|| {
            let mut framing = Framing::default();
            self.points().for_each(|p| framing.include(p));
            framing
        });
        self.cameras.push(Camera::framed(framing));
    }

    /// Does anything move while the shutter is open?
    pub fn moves(&self) -> bool {
        self.meshes.iter().any(|mesh| mesh.motion.is_some())
            || self.instances.iter().any(|instance| instance.motion.is_some())
            || self.cameras.iter().any(|camera| camera.motion.is_some())
            || self.lights.iter().any(|light| !light.motion.is_empty())
    }

    /// Does a mesh, an instance or a camera have other transforms or positions one frame before or after?
    pub fn has_velocities(&self) -> bool {
        self.meshes.iter().any(|mesh| mesh.adjacent_frames.is_some())
            || self.instances.iter().any(|instance| instance.adjacent_frames.is_some())
            || self.cameras.iter().any(|camera| camera.adjacent_frames.is_some())
    }

    /// For each mesh: does it move or deform while the shutter is open?
    pub fn moving_meshes(&self) -> Vec<bool> {
        let mut moving: Vec<bool> = self.meshes.iter().map(|mesh| mesh.motion.is_some()).collect();
        for instance in self.instances.iter().filter(|instance| instance.motion.is_some()) {
            let Object { meshes, .. } = &self.objects[instance.object as usize];
            moving[meshes.start as usize..meshes.end as usize].fill(true);
        }
        moving
    }

    /// Does the mesh have a front only ([`Material::is_single_sided`])?
    #[inline]
    pub fn is_single_sided(&self, mesh: u32) -> bool {
        self.materials[self.meshes[mesh as usize].material as usize].is_single_sided()
    }

    /// Does a ray of this direction meet the back of a triangle? The front is where the winding is counter-clockwise or, under a
    /// transform that mirrors, clockwise. `time` is in [0, 1] of the shutter.
    #[inline]
    pub fn is_back(&self, Primitive { instance, mesh, prim }: Primitive, direction: Vec3, time: f32) -> bool {
        let mesh = &self.meshes[mesh as usize];
        let vertices = mesh.indices[prim as usize];
        let [a, b, c] = match &mesh.motion {
            None => vertices.map(|i| Vec3::from_array(mesh.positions[i as usize])),
            Some(motion) => motion.corners(vertices, time),
        };
        let (e, f) = (b - a, c - a);
        match self.instances[instance as usize].at(time) {
            None => e.cross(f).dot(direction) > 0.0,
            // Me × Mf = det(M) M⁻ᵀ(e × f)
            Some(Affine3A { matrix3: m, .. }) => (m * e).cross(m * f).dot(direction) * m.determinant().signum() > 0.0,
        }
    }

    /// Do rays hit the same surfaces in the other scene? True only if the scenes share their meshes in memory.
    pub fn has_surfaces_of(&self, other: &Self) -> bool {
        let meshes = |scene: &Self| scene.meshes.iter().map(Arc::as_ptr).collect::<Vec<_>>();
        let images = |scene: &Self| scene.images.iter().map(Arc::as_ptr).collect::<Vec<_>>();
        let placements = |scene: &Self| {
            let placement =
                |i: &Instance| (scene.objects[i.object as usize].meshes.clone(), i.transform, i.motion.clone());
            scene.instances.iter().map(placement).collect::<Vec<_>>()
        };
        // Alpha decides which hits count, unless all materials are opaque.
        let opaque = |scene: &Self| scene.materials.iter().all(|material| material.alpha_mode == AlphaMode::Opaque);
        let same_alpha = || {
            (&self.materials, &self.textures) == (&other.materials, &other.textures) && images(self) == images(other)
        };
        let single_sided = |scene: &Self| scene.materials.iter().map(Material::is_single_sided).collect::<Vec<_>>();
        meshes(self) == meshes(other)
            && self.has_bodies() == other.has_bodies()
            && single_sided(self) == single_sided(other)
            && placements(self) == placements(other)
            && (opaque(self) && opaque(other) || same_alpha())
    }

    /// Does any material bound a medium, so that backends must list all hits of a ray?
    pub fn has_bodies(&self) -> bool {
        self.materials.iter().any(Material::bounds_body)
    }

    /// Is there a light source, or are all materials unlit?
    pub fn is_lit(&self) -> bool {
        let all_unlit = !self.materials.is_empty() && self.materials.iter().all(|m| m.unlit);
        all_unlit
            || self.materials.iter().any(Material::is_emissive)
            || self.environment.is_some()
            || !self.lights.is_empty()
    }

    /// Adds [`Environment::studio`] to a scene without light; returns whether it did.
    pub fn light_if_dark(&mut self) -> bool {
        let dark = !self.is_lit();
        if dark {
            self.environment = Some(Environment::studio());
        }
        dark
    }

    /// Radius in metres of a sphere that contains every placed mesh that can be seen; 0 for an empty scene.
    pub fn radius(&self) -> f32 {
        self.bounds().map_or(0.0, |[low, high]| 0.5 * (high - low).length())
    }

    /// World-space lower and upper corner of an axis-aligned box that contains every placed mesh, metres; `None` for an
    /// empty scene. It is the smallest such box if no instance is rotated.
    pub fn bounds(&self) -> Option<[Vec3; 2]> {
        self.boxes(|mesh, _| self.is_seen(mesh))
            .map(|(_, corners)| corners)
            .reduce(|[l, h], [low, high]| [l.min(low), h.max(high)])
    }

    /// Height of the lowest point, over a played animation, metres; `None` for an empty scene.
    pub fn lowest(&self) -> Option<f32> {
        let bounds = self.reach.as_ref().map(|reach| reach.bounds).or_else(|| self.bounds());
        bounds.map(|[low, _]| low.y)
    }

    /// Centre of [`Self::bounds`] and the largest distance of a vertex from it, over a played animation, metres; (0, 0) for an
    /// empty scene.
    pub fn enclosing_sphere(&self) -> (DVec3, f64) {
        if let Some(reach) = &self.reach {
            return reach.sphere;
        }
        let Some([low, high]) = self.bounds() else { return (DVec3::ZERO, 0.0) };
        let centre = 0.5 * (low.as_dvec3() + high.as_dvec3());
        let radius = self.points().map(|p| p.distance(centre)).fold(0.0, f64::max);
        (centre, radius)
    }

    /// Linear RGBA in [0, 1] of a texture at coordinates `uv` of the set that it reads ([`TextureRef::select`]). The
    /// texture's transform is applied here. Non-finite coordinates read texel (0, 0).
    #[inline]
    pub fn sample_texture(&self, texture: &TextureRef, uv: Vec2) -> Vec4 {
        let (own, image, uv) = self.sampled(texture, uv);
        own.rgba(image, uv, texture.encoding)
    }

    /// Alpha of [`Self::sample_texture`], at lower cost.
    fn sample_alpha(&self, texture: &TextureRef, uv: Vec2) -> f32 {
        let (own, image, uv) = self.sampled(texture, uv);
        own.alpha(image, uv)
    }

    fn sampled(&self, texture: &TextureRef, uv: Vec2) -> (&Texture, &Image, Vec2) {
        let uv = texture.transform.map_or(uv, |transform| transform.transform_point2(uv));
        let own = &self.textures[texture.texture as usize];
        (own, &self.images[own.image as usize], uv)
    }

    /// World-space vertices of all placed meshes.
    fn points(&self) -> impl Iterator<Item = DVec3> {
        let seen: Vec<bool> = (0..self.meshes.len() as u32).map(|mesh| self.is_seen(mesh)).collect();
        self.instances.iter().flat_map(move |instance| {
            let transform = instance.transform;
            let placed = move |p: [f32; 3]| {
                let p = Vec3::from_array(p);
                transform.map_or(p, |t| t.transform_point3(p)).as_dvec3()
            };
            let meshes = self.objects[instance.object as usize].meshes.clone();
            let meshes: Vec<u32> = meshes.filter(|&mesh| seen[mesh as usize]).collect();
            meshes.into_iter().flat_map(|mesh| self.meshes[mesh as usize].positions.iter().copied()).map(placed)
        })
    }

    /// World-space lower and upper corner of a box around each placed mesh of those that `take` takes by index and value, with the indices of instance and
    /// mesh.
    pub fn boxes(&self, take: impl Fn(u32, &Mesh) -> bool) -> impl Iterator<Item = ([u32; 2], [Vec3; 2])> {
        let mesh_box = |(index, mesh): (u32, &Arc<Mesh>)| {
            let positions = if take(index, mesh) { &mesh.positions[..] } else { &[] };
            let points = positions.iter().map(|&p| Vec3::from_array(p));
            points.fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(l, h), p| (l.min(p), h.max(p)))
        };
        let mesh_boxes: Vec<_> = (0..).zip(&self.meshes).map(mesh_box).collect();
        (0..).zip(&self.instances).flat_map(move |(index, instance)| {
            let meshes = self.objects[instance.object as usize].meshes.clone();
            let boxes: Vec<_> = meshes.map(|mesh| (mesh, mesh_boxes[mesh as usize])).collect();
            let placed = |(l, h): (Vec3, Vec3)| match instance.transform {
                None => [l, h],
                Some(t) => (0..8).fold([Vec3::INFINITY, Vec3::NEG_INFINITY], |[low, high], corner| {
                    let pick = |axis: usize| if corner >> axis & 1 == 0 { l[axis] } else { h[axis] };
                    let p = t.transform_point3(Vec3::new(pick(0), pick(1), pick(2)));
                    [low.min(p), high.max(p)]
                }),
            };
            let boxes = boxes.into_iter().filter(|(_, (l, h))| l.x <= h.x);
            boxes.map(move |(mesh, corners)| ([index, mesh], placed(corners)))
        })
    }
}

#[cfg(test)]
mod tests {
    use glam::vec3;

    use super::*;

    #[test]
    fn a_camera_that_is_added_to_a_framed_scene_is_the_one_that_is_rendered() {
        let mut scene = Scene::default();
        scene.add(Mesh::new(vec![[0.0; 3], [2.0, 0.0, 0.0], [0.0, 1.0, 0.0]], vec![[0, 1, 2]]), Material::default());
        scene.frame();
        let pushed = Camera::look_at(vec3(1.0, 2.0, 3.0), Vec3::ZERO, 0.5);
        scene.cameras.push(pushed.clone());
        assert_eq!(scene.camera(1, 40, 10).to_world, pushed.to_world);
        // The framed view stays where it was, and still fits the picture.
        let [square, wide] = [10, 40].map(|width| scene.camera(0, width, 10));
        assert!(square.name == Framing::NAME && square.to_world != wide.to_world);
        assert_eq!(square.to_world, scene.cameras[0].to_world);
        scene.cameras.swap(0, 1);
        assert_eq!(scene.camera(0, 40, 10).to_world, pushed.to_world);
        scene.frame();
        assert_eq!(scene.cameras.len(), 2);
    }

    #[test]
    fn scenes_share_rays_only_if_their_surfaces_have_the_same_sides() {
        let mut scene = Scene::default();
        scene.add(Mesh::new(vec![[0.0; 3], [2.0, 0.0, 0.0], [0.0, 1.0, 0.0]], vec![[0, 1, 2]]), Material::default());
        let mut other = scene.clone();
        assert!(scene.has_surfaces_of(&other));
        other.materials[0].double_sided = true;
        assert!(!scene.has_surfaces_of(&other));
    }

    #[test]
    fn a_camera_looks_at_its_target_with_up_up() {
        for (eye, target) in [(vec3(1.0, 2.0, 3.0), vec3(0.0, 0.5, -1.0)), (Vec3::Y, Vec3::ZERO)] {
            let to_camera = Camera::look_at(eye, target, 0.5).to_world.inverse();
            let seen = to_camera.transform_point3(target);
            assert!((seen + Vec3::Z * eye.distance(target)).length() < 1e-5, "{seen}");
            let up = if eye == Vec3::Y { Vec3::Z } else { Vec3::Y };
            let up = to_camera.transform_vector3(up);
            assert!(up.x.abs() < 1e-6 && up.y > 0.0, "{up}");
        }
    }
}
