//! Sizes of a scene.

use crate::scene::import::report::SceneCounts;
use crate::scene::{self, Deformation, Mesh, Scene, Texels};

pub fn mesh_bytes(mesh: &Mesh) -> u64 {
    let texcoords = mesh.texcoords.iter().flatten().chain(mesh.more_texcoords.iter().map(|(_, set)| set));
    let bytes = size_of_val(&mesh.positions[..])
        + size_of_val(&mesh.indices[..])
        + mesh.normals.as_deref().map_or(0, size_of_val)
        + [&mesh.tangents, &mesh.coat_tangents].map(|t| t.as_deref().map_or(0, size_of_val)).iter().sum::<usize>()
        + texcoords.map(|set| size_of_val(&set[..])).sum::<usize>()
        + mesh.colors.as_deref().map_or(0, size_of_val)
        + mesh.motion.as_ref().map_or(0, Deformation::bytes);
    bytes as u64
}

pub fn image_bytes(image: &scene::Image) -> u64 {
    let bytes = match &image.texels {
        Texels::Rgb8(t) => size_of_val(t.as_slice()),
        Texels::Rgba8(t) => size_of_val(t.as_slice()),
        Texels::Rgba16(t) => size_of_val(t.as_slice()),
    };
    bytes as u64
}

pub fn count(scene: &Scene) -> SceneCounts {
    SceneCounts {
        triangles: scene.meshes.iter().map(|mesh| mesh.indices.len() as u64).sum(),
        instanced_triangles: scene.instances.iter().map(|i| scene.triangles(i.object) as u64).sum(),
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
