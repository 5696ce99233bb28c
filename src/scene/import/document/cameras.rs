//! Cameras, as the document has them.

use super::json::Json;
use crate::error::Result;
use crate::scene::Projection;

/// A checked camera.
#[derive(Debug)]
pub struct Camera {
    pub name: Option<String>,
    pub projection: Projection,
    pub aspect: Option<f32>,
}

pub fn parse(json: &Json) -> Result<Camera> {
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
