//! Cameras with their world transforms.

use glam::{DAffine3, DMat3};

use super::transforms::axis;
use crate::scene;
use crate::scene::import::document::cameras::Camera;

/// The camera at its node's world transform; `None` if the transform leaves no viewing direction.
pub fn place(from: &Camera, name: String, world: &DAffine3) -> Option<scene::Camera> {
    let z = axis(world, 2)?;
    let y = axis(world, 1)?;
    let y = (y - z * y.dot(z)).try_normalize()?;
    let to_world = DAffine3 { matrix3: DMat3::from_cols(y.cross(z), y, z), translation: world.translation };
    let to_world = to_world.as_affine3a();
    let placed = scene::Camera::new(name, from.projection, to_world);
    to_world.is_finite().then_some(scene::Camera { aspect: from.aspect, clip: from.clip, ..placed })
}
