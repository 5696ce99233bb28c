//! KHR_lights_punctual.

use glam::{DAffine3, DVec3, Vec3};

use super::json::Json;
use super::report::Notes;
use crate::error::Result;
use crate::scene::{PunctualKind, PunctualLight};

/// A checked light.
#[derive(Debug)]
pub(super) struct Light {
    name: Option<String>,
    kind: PunctualKind,
    intensity: Vec3,
    range: bool,
    at: String,
}

pub(super) fn parse(json: &Json) -> Result<Light> {
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
    let range = json.number("range")?;
    if let Some(range) = range.filter(|r| *r <= 0.0) {
        return Err(json.bad("range", "above 0", range));
    }
    let kind = match json.need("type", json.string("type")?)? {
        "directional" => PunctualKind::Directional,
        "point" => PunctualKind::Point,
        "spot" => {
            let spot = json.need("spot", json.get("spot")?)?;
            let inner = spot.number("innerConeAngle")?.unwrap_or(0.0) as f32;
            let outer = spot.number("outerConeAngle")?.unwrap_or(std::f64::consts::FRAC_PI_4) as f32;
            if !(0.0..outer).contains(&inner) || outer > std::f32::consts::FRAC_PI_2 {
                return Err(json.bad("spot", "0 ≤ innerConeAngle < outerConeAngle ≤ π/2", format!("{inner}, {outer}")));
            }
            PunctualKind::Spot { inner, outer }
        }
        other => return Err(json.bad("type", "\"directional\", \"point\" or \"spot\"", other)),
    };
    let name = json.string("name")?.filter(|n| !n.is_empty()).map(Into::into);
    Ok(Light { name, kind, intensity: radiant, range: range.is_some(), at: json.at.clone() })
}

impl Light {
    /// The light as its node places it. Scale does not change it.
    pub fn place(&self, node: &str, world: &DAffine3, notes: &mut Notes) -> Option<PunctualLight> {
        if self.intensity.max_element() <= 0.0 {
            notes.not_loaded(&self.at, "a light of no intensity");
            return None;
        }
        let position = world.translation.as_vec3();
        let direction = world.transform_vector3(DVec3::NEG_Z).try_normalize().map(|d| d.as_vec3());
        let aimed = self.kind != PunctualKind::Point;
        let (true, Some(direction)) = (position.is_finite(), direction.or((!aimed).then_some(Vec3::NEG_Z))) else {
            notes.ignored(&self.at, "a light whose node has no direction or place (zero or infinite scale)");
            return None;
        };
        if self.range && self.kind != PunctualKind::Directional {
            notes.ignored(&self.at, "light range: light falls off with the square of the distance, without an end");
        }
        let name = self.name.clone().unwrap_or_else(|| node.into());
        Some(PunctualLight { name, kind: self.kind, intensity: self.intensity, position, direction })
    }
}
