//! Cameras of the document, and the framed view for files without one.

use glam::{Affine3A, DAffine3, DVec3, Mat3A, Vec3A};

use super::json::Json;
use crate::error::Result;
use crate::scene::{self, Projection};

/// A checked camera.
#[derive(Debug)]
pub(super) struct Camera {
    pub name: Option<String>,
    projection: Projection,
    aspect: Option<f32>,
}

pub(super) fn parse(json: &Json) -> Result<Camera> {
    let kind = json.need("type", json.string("type")?)?;
    let values = json.need(kind, json.get(kind)?)?;
    let positive = |key: &str| -> Result<Option<f32>> {
        match values.number(key)?.map(|x| x as f32) {
            Some(x) if x <= 0.0 => Err(values.bad(key, "a number above 0", x)),
            x => Ok(x),
        }
    };
    let zfar = positive("zfar")?;
    let znear = values.need("znear", values.number("znear")?)? as f32;
    if zfar.is_some_and(|zfar| zfar <= znear) {
        return Err(values.bad("zfar", format!("more than znear ({znear})"), zfar.unwrap_or_default()));
    }
    let (projection, aspect) = match kind {
        "perspective" => {
            values.need("znear", positive("znear")?)?;
            let yfov = values.need("yfov", positive("yfov")?)?;
            if yfov >= std::f32::consts::PI {
                return Err(values.bad("yfov", "an angle below π", yfov));
            }
            (Projection::Perspective { yfov }, positive("aspectRatio")?)
        }
        "orthographic" => {
            if znear < 0.0 {
                return Err(values.bad("znear", "at least 0", znear));
            }
            values.need("zfar", zfar)?;
            let xmag = values.need("xmag", positive("xmag")?)?;
            let ymag = values.need("ymag", positive("ymag")?)?;
            let aspect = Some(xmag / ymag).filter(|a| a.is_finite() && *a > 0.0);
            (Projection::Orthographic { xmag, ymag }, aspect)
        }
        other => return Err(json.bad("type", "\"perspective\" or \"orthographic\"", other)),
    };
    let name = json.string("name")?.filter(|n| !n.is_empty()).map(Into::into);
    Ok(Camera { name, projection, aspect })
}

impl Camera {
    /// The camera as its node places it; `None` when the node's transform leaves no direction to look along.
    pub fn place(&self, name: String, world: &DAffine3) -> Option<scene::Camera> {
        let z = world.matrix3.z_axis.try_normalize()?;
        let y = world.matrix3.y_axis;
        let y = (y - z * y.dot(z)).try_normalize()?;
        let to_world = camera_to_world(y.cross(z), y, z, world.translation);
        to_world.is_finite().then_some(scene::Camera {
            name,
            projection: self.projection,
            aspect: self.aspect,
            to_world,
        })
    }
}

fn camera_to_world(x: DVec3, y: DVec3, z: DVec3, eye: DVec3) -> Affine3A {
    let column = |v: DVec3| Vec3A::from(v.as_vec3());
    Affine3A { matrix3: Mat3A::from_cols(column(x), column(y), column(z)), translation: column(eye) }
}

/// A view of the whole box from the front, right and a little above; its longer side fits a square picture.
pub(super) fn framed(bounds: Option<(DVec3, DVec3)>) -> scene::Camera {
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
