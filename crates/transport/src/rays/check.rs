//! What a ray query backend takes for granted of a scene, checked once before the build.

use crate::scene::motion::{Key, MOST_STEPS};
use crate::scene::{FARTHEST, Scene};
use crate::{Error, Result};

/// Refuses what would make a backend read out of bounds or lose triangles: indices beyond the vertices, coordinates
/// that are not numbers or beyond [`FARTHEST`], transforms that cannot be inverted, ranges beyond their table.
pub(super) fn check(scene: &Scene) -> Result<()> {
    for (index, mesh) in scene.meshes.iter().enumerate() {
        let count = mesh.positions.len();
        let beyond = |triangle: &[u32; 3]| triangle.iter().any(|&vertex| vertex as usize >= count);
        if let Some(at) = mesh.indices.iter().position(beyond) {
            return Err(Error::Data(format!(
                "mesh {index} \"{}\": triangle {at} has the vertices {:?}, but there are only {count}",
                mesh.name, mesh.indices[at]
            )));
        }
        let astray = |position: &[f32; 3]| position.iter().any(|x| x.is_nan() || x.abs() > FARTHEST);
        let steps = mesh.motion.iter().flat_map(|motion| &motion.positions);
        for positions in steps.clone().chain([&mesh.positions]) {
            if let Some(at) = positions.iter().position(astray) {
                return Err(Error::Data(format!(
                    "mesh {index} \"{}\": vertex {at} is at {:?}, which is not a place within {FARTHEST:e} m",
                    mesh.name, positions[at]
                )));
            }
        }
        let number = steps.clone().count();
        let many = mesh.motion.is_some() && !(2..=MOST_STEPS + 1).contains(&number);
        if many || steps.into_iter().any(|positions| positions.len() != count) {
            let name = &mesh.name;
            return Err(Error::Data(format!(
                "mesh {index} \"{name}\": {number} steps that are not all {count} vertices"
            )));
        }
    }
    for (index, object) in scene.objects.iter().enumerate() {
        if object.meshes.start > object.meshes.end || object.meshes.end as usize > scene.meshes.len() {
            return Err(Error::Data(format!(
                "object {index} \"{}\" has the meshes {:?}, but there are only {}",
                object.name,
                object.meshes,
                scene.meshes.len()
            )));
        }
    }
    for (index, instance) in scene.instances.iter().enumerate() {
        if instance.object as usize >= scene.objects.len() {
            return Err(Error::Data(format!(
                "instance {index} \"{}\" places object {}, but there are only {}",
                instance.name,
                instance.object,
                scene.objects.len()
            )));
        }
        let keys = instance.motion.iter().flat_map(|motion| motion.keys()).map(Key::transform);
        if keys.chain(instance.transform).any(|t| !(t.is_finite() && t.inverse().is_finite())) {
            return Err(Error::Data(format!(
                "instance {index} \"{}\" has a transform that cannot be inverted; is a scale zero?",
                instance.name
            )));
        }
    }
    Ok(())
}
