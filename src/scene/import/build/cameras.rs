//! Cameras in their places, and the framed view for files without one.

use glam::{Affine3A, DAffine3, DVec3, Mat3A, Vec3A};

use crate::scene::import::document::cameras::Camera;
use crate::scene::{self, Projection};

/// The camera as its node places it; `None` when the node's transform leaves no direction to look along.
pub fn place(from: &Camera, name: String, world: &DAffine3) -> Option<scene::Camera> {
    let z = world.matrix3.z_axis.try_normalize()?;
    let y = world.matrix3.y_axis;
    let y = (y - z * y.dot(z)).try_normalize()?;
    let to_world = camera_to_world(y.cross(z), y, z, world.translation);
    to_world.is_finite().then_some(scene::Camera { name, projection: from.projection, aspect: from.aspect, to_world })
}

fn camera_to_world(x: DVec3, y: DVec3, z: DVec3, eye: DVec3) -> Affine3A {
    let column = |v: DVec3| Vec3A::from(v.as_vec3());
    Affine3A { matrix3: Mat3A::from_cols(column(x), column(y), column(z)), translation: column(eye) }
}

/// A view of the whole box from the front, right and a little above; its longer side fits a square picture.
pub fn framed(bounds: Option<(DVec3, DVec3)>) -> scene::Camera {
    const YFOV: f64 = 0.7;
    const MARGIN: f64 = 1.05;
    const FROM: DVec3 = DVec3::new(0.55, 0.35, 1.0);
    let (low, high) = bounds.unwrap_or((DVec3::splat(-1.0), DVec3::splat(1.0)));
    let centre = 0.5 * (low + high);
    let half = 0.5 * (high - low);
    let z = FROM.normalize();
    let x = DVec3::Y.cross(z).normalize();
    let y = z.cross(x);
    let slope = (0.5 * YFOV).tan();
    let distance = (0..8)
        .map(|corner| {
            let sign = |axis: u32| if corner >> axis & 1 == 0 { -1.0 } else { 1.0 };
            let v = half * DVec3::new(sign(0), sign(1), sign(2));
            v.dot(x).abs().max(v.dot(y).abs()) / slope + v.dot(z)
        })
        .fold(0.0, f64::max);
    let distance = if distance > 0.0 { MARGIN * distance } else { 1.0 };
    scene::Camera {
        name: "framed".into(),
        projection: Projection::Perspective { yfov: YFOV as f32 },
        aspect: None,
        to_world: camera_to_world(x, y, z, centre + distance * z),
    }
}
