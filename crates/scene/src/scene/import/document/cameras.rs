//! Cameras of the document.

use std::f32::consts::PI;

use gltf::json::camera::Type;
use gltf::json::validation::Checked::Valid;

use super::json::Json;
use super::typed::read;
use crate::error::Result;
use crate::scene::Projection;
use crate::scene::import::complaint::bad;

#[derive(Debug)]
pub struct Camera {
    pub name: Option<String>,
    pub projection: Projection,
    pub aspect: Option<f32>,
    /// [`crate::scene::Camera::clip`].
    pub clip: Option<[f32; 2]>,
}

/// In the place of a faulty one.
pub(crate) const STAND_IN: Camera =
    Camera { name: None, projection: Projection::Perspective { yfov: 1.0 }, aspect: None, clip: None };

pub fn parse(json: &Json) -> Result<Camera> {
    let from: gltf::json::Camera = read(json)?;
    let kind = json.need("type", json.string("type")?)?;
    let check = |holds: bool, key: &str, wanted: &str, x: f32| match holds {
        true => Ok(x),
        false => Err(bad(&json.path(&format!("{kind}.{key}")), wanted, x)),
    };
    let positive = |key: &str, x: f32| check(x > 0.0, key, "a number above 0", x);
    let (projection, aspect, clip) = match from.type_ {
        Valid(Type::Perspective) => {
            let p = json.need(kind, from.perspective)?;
            let znear = positive("znear", p.znear)?;
            let zfar = p.zfar.map(|zfar| check(zfar > znear, "zfar", "more than znear", zfar)).transpose()?;
            let yfov = check(p.yfov < PI, "yfov", "an angle below π", positive("yfov", p.yfov)?)?;
            let aspect = p.aspect_ratio.map(|x| positive("aspectRatio", x)).transpose()?;
            (Projection::Perspective { yfov }, aspect, [znear, zfar.unwrap_or(f32::INFINITY)])
        }
        Valid(Type::Orthographic) => {
            let o = json.need(kind, from.orthographic)?;
            let znear = check(o.znear >= 0.0, "znear", "at least 0", o.znear)?;
            let zfar = check(o.zfar > znear, "zfar", "more than znear", o.zfar)?;
            let (xmag, ymag) = (positive("xmag", o.xmag)?, positive("ymag", o.ymag)?);
            let aspect = Some(xmag / ymag).filter(|a| a.is_finite() && *a > 0.0);
            (Projection::Orthographic { xmag, ymag }, aspect, [znear, zfar])
        }
        _ => return Err(json.bad("type", "\"perspective\" or \"orthographic\"", kind)),
    };
    let clip = clip.map(|depth| if depth < f32::MAX { depth } else { f32::INFINITY });
    Ok(Camera { name: from.name.filter(|n| !n.is_empty()), projection, aspect, clip: Some(clip) })
}
