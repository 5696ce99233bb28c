//! Cameras with their world transforms.

use glam::{Affine3A, DAffine3, DVec3, Mat3A, Vec3A};

use super::transforms::axis;
use crate::scene;
use crate::scene::import::document::cameras::Camera;

/// The camera at its node's world transform; `None` if the transform leaves no viewing direction.
pub fn place(from: &Camera, name: String, world: &DAffine3) -> Option<scene::Camera> {
    let z = axis(world, 2)?;
    let y = axis(world, 1)?;
    let y = (y - z * y.dot(z)).try_normalize()?;
    let to_world = camera_to_world(y.cross(z), y, z, world.translation);
    to_world.is_finite().then_some(scene::Camera {
        name,
        projection: from.projection,
        aspect: from.aspect,
        to_world,
        motion: None,
        adjacent_frames: None,
        framing: None,
        clip: Some(from.clip),
    })
}

fn camera_to_world(x: DVec3, y: DVec3, z: DVec3, eye: DVec3) -> Affine3A {
    let column = |v: DVec3| Vec3A::from(v.as_vec3());
    Affine3A { matrix3: Mat3A::from_cols(column(x), column(y), column(z)), translation: column(eye) }
}
