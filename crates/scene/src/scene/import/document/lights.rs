//! Punctual lights of the document (KHR_lights_punctual).

use std::f32::consts::{FRAC_PI_2, FRAC_PI_4, PI};
use std::sync::Arc;

use glam::Vec3;
use gltf::json::extensions::scene::khr_lights_punctual::{self, Type};
use gltf::json::validation::Checked;

use super::json::{Json, extra};
use super::typed::read;
use crate::error::Result;
use crate::scene::{MAX_RADIUS, PunctualKind};

/// Path of the array of punctual lights.
pub const LIGHTS: &str = "extensions.KHR_lights_punctual.lights";

#[derive(Debug)]
pub struct Light {
    pub name: Option<String>,
    /// `None` for an unknown type.
    pub kind: Option<PunctualKind>,
    pub intensity: Vec3,
    /// Distance in metres beyond which there is no light; infinite if unlimited.
    pub range: f32,
    /// Of its `extras`.
    pub size: Size,
    /// Likewise.
    pub group: Option<Arc<str>>,
    pub at: String,
}

pub fn parse(json: &Json) -> Result<Light> {
    let from: khr_lights_punctual::Light = read(json)?;
    if from.color.iter().any(|x| *x < 0.0) {
        return Err(json.bad("color", "numbers of at least 0", format!("{:?}", from.color)));
    }
    if from.intensity < 0.0 {
        return Err(json.bad("intensity", "at least 0", from.intensity));
    }
    let intensity = Vec3::from(from.color) * from.intensity;
    if !intensity.is_finite() {
        return Err(json.bad("intensity", "a product with color that a 32-bit float can hold", from.intensity));
    }
    let range = from.range.filter(|range| *range < f32::MAX).unwrap_or(f32::INFINITY);
    if range <= 0.0 {
        return Err(json.bad("range", "above 0", range));
    }
    let kind = match from.type_ {
        Checked::Valid(Type::Directional) => Some(PunctualKind::Directional),
        Checked::Valid(Type::Point) => Some(PunctualKind::Point),
        Checked::Valid(Type::Spot) => {
            let (inner, outer) = from.spot.map_or_else(
                || {
                    json.repaired("spot", "a spot light without `spot` has the default cone");
                    (0.0, FRAC_PI_4)
                },
                |spot| (spot.inner_cone_angle, spot.outer_cone_angle),
            );
            // Blender writes equal angles for a hard edge, and the extension's formula supports them.
            if !(0.0..=outer).contains(&inner) || !(0.0..=FRAC_PI_2).contains(&outer) || outer == 0.0 {
                let wanted = "0 ≤ innerConeAngle ≤ outerConeAngle ≤ π/2, and not both 0";
                return Err(json.bad("spot", wanted, format!("{inner}, {outer}")));
            }
            if inner == outer {
                json.repaired("spot", "equal cone angles: the spot's edge is hard");
            }
            Some(PunctualKind::Spot { inner, outer })
        }
        Checked::Invalid => None,
    };
    let (size, group) = (Size::parse(json), extra(json, "light_group"));
    Ok(Light { name: from.name.filter(|n| !n.is_empty()), kind, intensity, range, size, group, at: json.at.clone() })
}

/// The size of a light in `extras`, where Blender's exporter writes custom properties: `radius` or `shadow_soft_size`, as
/// Blender's Python calls it, in metres; `angle` in radians. What is no such size says nothing.
#[derive(Debug, Clone, Copy, Default)]
pub struct Size {
    /// Metres.
    pub radius: Option<f32>,
    /// Radians, across.
    pub angle: Option<f32>,
}

impl Size {
    /// That in the `extras` of a light or a node.
    pub fn parse(json: &Json) -> Self {
        let extras = json.value().get("extras");
        let number = |name: &str, most: f32| {
            let number = extras?.get(name)?.as_f64()? as f32;
            (0.0..=most).contains(&number).then_some(number)
        };
        let radius = number("radius", MAX_RADIUS).or_else(|| number("shadow_soft_size", MAX_RADIUS));
        Self { radius, angle: number("angle", PI) }
    }
}
