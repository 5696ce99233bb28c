//! Pilots' pictures: the same view with fewer pixels.

use super::RenderSettings;
use super::lens::lens;
use crate::integrator::{CameraRays, PreparedScene};

/// Columns and rows of about `pixels` pixels, no more than the picture has, and the camera that takes them.
pub fn small(scene: &PreparedScene, settings: &RenderSettings, pixels: f64) -> ([u32; 2], CameraRays) {
    let all = f64::from(settings.width) * f64::from(settings.height);
    let scale = (pixels / all).sqrt().min(1.0);
    let [width, height] = [settings.width, settings.height].map(|n| (f64::from(n) * scale).ceil().max(1.0) as u32);
    let camera = CameraRays::new(&scene.scene.camera(settings.camera, width, height), width, height);
    ([width, height], camera.with_lens(lens(scene, settings).unwrap_or_default()))
}
