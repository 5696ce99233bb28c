//! How much a scene holds.

use std::sync::Arc;

use crate::scene::import::report::SceneCounts;
use crate::scene::{self, Deformation, Instance, Mesh, Scene, Texels};

/// Bytes of a mesh's arrays.
pub fn mesh_bytes(mesh: &Mesh) -> u64 {
    fn of<T>(values: Option<&Vec<T>>) -> usize {
        values.map_or(0, |v| size_of_val(v.as_slice()))
    }
    let bytes = size_of_val(&mesh.positions[..])
        + of(Some(&mesh.indices))
        + of(mesh.normals.as_ref())
        + of(mesh.tangents.as_ref())
        + mesh.texcoords.iter().map(|t| of(t.as_ref())).sum::<usize>()
        + of(mesh.colors.as_ref())
        + mesh.motion.as_ref().map_or(0, Deformation::bytes);
    bytes as u64
}

/// Bytes of a picture's texels.
pub fn image_bytes(image: &scene::Image) -> u64 {
    let bytes = match &image.texels {
        Texels::Rgb8(t) => size_of_val(t.as_slice()),
        Texels::Rgba8(t) => size_of_val(t.as_slice()),
        Texels::Rgba16(t) => size_of_val(t.as_slice()),
    };
    bytes as u64
}

pub fn count(scene: &Scene) -> SceneCounts {
    let triangles = |meshes: &[Arc<Mesh>]| meshes.iter().map(|m| m.indices.len() as u64).sum::<u64>();
    let of_instance = |i: &Instance| {
        let range = &scene.objects[i.object as usize].meshes;
        triangles(&scene.meshes[range.start as usize..range.end as usize])
    };
    SceneCounts {
        triangles: triangles(&scene.meshes),
        instanced_triangles: scene.instances.iter().map(of_instance).sum(),
        meshes: scene.meshes.len() as u64,
        objects: scene.objects.len() as u64,
        instances: scene.instances.len() as u64,
        materials: scene.materials.len() as u64,
        images: scene.images.len() as u64,
        lights: scene.lights.len() as u64,
        cameras: scene.cameras.len() as u64,
        geometry_bytes: scene.meshes.iter().map(|mesh| mesh_bytes(mesh)).sum(),
        image_bytes: scene.images.iter().map(|image| image_bytes(image)).sum(),
    }
}
