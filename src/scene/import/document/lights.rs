//! KHR_lights_punctual.

use std::f32::consts::FRAC_PI_2;

use glam::Vec3;

use super::json::Json;
use crate::error::Result;
use crate::scene::PunctualKind;
use crate::scene::import::report::Notes;

/// A checked light.
#[derive(Debug)]
pub struct Light {
    pub name: Option<String>,
    /// `None` for a type that the extension does not know.
    pub kind: Option<PunctualKind>,
    pub intensity: Vec3,
    /// Metres from which on there is no light; infinite without an end.
    pub range: f32,
    pub at: String,
}

pub fn parse(json: &Json, notes: &mut Notes) -> Result<Light> {
    let color = json.vector::<3>("color")?.unwrap_or([1.0; 3]).map(|x| x as f32);
    if color.iter().any(|x| *x < 0.0) {
        return Err(json.bad("color", "numbers of at least 0", format!("{color:?}")));
    }
    let intensity = json.number("intensity")?.unwrap_or(1.0) as f32;
    if intensity < 0.0 {
        return Err(json.bad("intensity", "at least 0", intensity));
    }
    let radiant = Vec3::from(color) * intensity;
    if !radiant.is_finite() {
        return Err(json.bad("intensity", "a product with color that a 32-bit float can hold", intensity));
    }
    let range = json.number("range")?.map_or(f32::INFINITY, |range| range as f32);
    if range <= 0.0 {
        return Err(json.bad("range", "above 0", range));
    }
    let kind = match json.need("type", json.string("type")?)? {
        "directional" => Some(PunctualKind::Directional),
        "point" => Some(PunctualKind::Point),
        "spot" => {
            let spot = json.need("spot", json.get("spot")?)?;
            let inner = spot.number("innerConeAngle")?.unwrap_or(0.0) as f32;
            let outer = spot.number("outerConeAngle")?.unwrap_or(std::f64::consts::FRAC_PI_4) as f32;
            // Equal angles are what Blender writes for a hard edge, and the extension's formula gives one for them.
            if !(0.0..=outer).contains(&inner) || !(0.0..=FRAC_PI_2).contains(&outer) || outer == 0.0 {
                let wanted = "0 ≤ innerConeAngle ≤ outerConeAngle ≤ π/2, and not both 0";
                return Err(json.bad("spot", wanted, format!("{inner}, {outer}")));
            }
            if inner == outer {
                notes.repaired(&json.path("spot"), "equal cone angles: the spot's edge is hard");
            }
            Some(PunctualKind::Spot { inner, outer })
        }
        _ => None,
    };
    let name = json.string("name")?.filter(|n| !n.is_empty()).map(Into::into);
    Ok(Light { name, kind, intensity: radiant, range, at: json.at.clone() })
}
