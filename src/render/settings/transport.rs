//! The transport of a render: what its paths do.

use super::camera::{camera, lens};
use super::{BackFaces, GlassShadows, Integrator, RenderSettings};
use crate::integrator::{PreparedScene, Proposal, Transport};
use crate::sampling::FilterSampler;

/// The transport of a render with these settings, without what pre-passes learn and without layers of lights by name. A lens that
/// cannot be made ([`lens`]) is a pinhole here.
pub fn transport<'a>(scene: &'a PreparedScene, settings: &RenderSettings) -> Transport<'a> {
    Transport {
        scene: &scene.scene,
        rays: scene.rays.as_ref(),
        geometry: &scene.geometry,
        materials: &scene.materials,
        lights: &scene.lights,
        names: &scene.names,
        camera: camera(&scene.scene, settings).with_lens(lens(scene, settings).unwrap_or_default()),
        filter: FilterSampler::new(settings.filter),
        heuristic: settings.balance.method().heuristic(),
        max_depth: match settings.integrator {
            Integrator::Path => settings.max_depth,
            Integrator::Direct => settings.max_depth.min(2),
        },
        seed: settings.seed,
        limits: [settings.clamp_direct, settings.clamp_indirect].map(|limit| limit.map_or(f32::INFINITY, |x| x as f32)),
        hides_environment: settings.transparent || settings.catches_shadows(),
        culls_back_faces: settings.back_faces == BackFaces::Cull,
        ground: settings.catches_shadows().then(|| scene.scene.lowest()).flatten(),
        straight_glass_shadows: settings.glass_shadows == GlassShadows::Straight,
        layers: None,
        proposal: Proposal::new(&scene.lights),
    }
}
