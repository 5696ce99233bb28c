//! Punctual lights with their world transforms.

use glam::{DAffine3, Vec3};

use super::transforms::axis;
use crate::scene::import::document::lights::Light;
use crate::scene::import::report::Notes;
use crate::scene::{PunctualKind, PunctualLight};

/// The light at its node's world transform, of which scale is ignored; `None` with a note if it gives no light.
pub fn place(from: &Light, node: &str, world: &DAffine3, notes: &mut Notes) -> Option<PunctualLight> {
    let Some(kind) = from.kind else {
        notes.ignored(&from.at, "a light of a type that KHR_lights_punctual does not know");
        return None;
    };
    if from.intensity.max_element() <= 0.0 {
        notes.not_loaded(&from.at, "a light of no intensity");
        return None;
    }
    let mut intensity = from.intensity;
    if let Some(text) = dimmed(&mut intensity) {
        notes.approximated(&from.at, text);
    }
    let position = world.translation.as_vec3();
    let direction = axis(world, 2).map(|z| (-z).as_vec3());
    let aimed = kind != PunctualKind::Point;
    let (true, Some(direction)) = (position.is_finite(), direction.or((!aimed).then_some(Vec3::NEG_Z))) else {
        notes.ignored(&from.at, "a light whose node has no direction or place (zero or infinite scale)");
        return None;
    };
    let name = from.name.clone().unwrap_or_else(|| node.into());
    let mut light =
        PunctualLight { name, kind, intensity, position, direction, range: from.range, size: 0.0, motion: Vec::new() };
    light.set_size(from.size.radius, from.size.angle);
    Some(light)
}

/// Largest emitted radiance, and intensity of a light: sums of squares over a picture stay finite as 32-bit floats. A laser
/// pointer's is near 1e10, the sun's 2e9.
const MAX_EMISSION: f32 = 1e15;

/// Limits the light of an emitter; what to say if it is changed.
pub fn dimmed(light: &mut Vec3) -> Option<String> {
    let most = light.max_element();
    (most > MAX_EMISSION).then(|| {
        *light = light.min(Vec3::splat(MAX_EMISSION));
        format!("a light of {most:e} is dimmed to {MAX_EMISSION:e}, the largest that can be rendered")
    })
}
