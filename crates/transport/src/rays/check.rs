//! Validation of a scene before a build.

use crate::scene::motion::{Key, MAX_STEPS};
use crate::scene::{MAX_COORDINATE, Scene};
use crate::{Error, Result};

/// Rejects scenes for which a backend would read out of bounds or lose triangles.
/// Errors: [`Error::Data`] for vertex indices out of range, coordinates that are NaN or beyond [`MAX_COORDINATE`], singular
/// transforms, and mesh or object indices out of range.
pub(super) fn check(scene: &Scene) -> Result<()> {
    for (index, mesh) in scene.meshes.iter().enumerate() {
        let count = mesh.positions.len();
        let out_of_range = |triangle: &[u32; 3]| triangle.iter().any(|&vertex| vertex as usize >= count);
        if let Some(at) = mesh.indices.iter().position(out_of_range) {
            return Err(Error::Data(format!(
                "mesh {index} \"{}\": triangle {at} has the vertices {:?}, but there are only {count}",
                mesh.name, mesh.indices[at]
            )));
        }
        let invalid = |position: &[f32; 3]| position.iter().any(|x| x.is_nan() || x.abs() > MAX_COORDINATE);
        let steps = mesh.motion.iter().flat_map(|motion| &motion.positions);
        for positions in steps.clone().chain([&mesh.positions]) {
            if let Some(at) = positions.iter().position(invalid) {
                return Err(Error::Data(format!(
                    "mesh {index} \"{}\": vertex {at} is at {:?}, which is not a position within {MAX_COORDINATE:e} m",
                    mesh.name, positions[at]
                )));
            }
        }
        let number = steps.clone().count();
        let wrong_count = mesh.motion.is_some() && !(2..=MAX_STEPS + 1).contains(&number);
        if wrong_count || steps.into_iter().any(|positions| positions.len() != count) {
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
