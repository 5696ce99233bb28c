//! What a camera's far clipping plane hides.

use glam::Vec3;

use crate::integrator::{CameraRays, PreparedScene};
use crate::lanes::{F, LANES, NUMBERS, U};
use crate::rays::{HitBatch, MISS, RayBatch, RayOrder};
use crate::scene::{Camera, Scene};

/// Rays across and down a view of the aspect 1.
const RAYS: u32 = 48;
/// Hidden share of what is in view from which a user is told.
pub const MIN_HIDDEN_SHARE: f32 = 0.05;

/// Does the scene reach beyond the far plane of the camera?
pub fn may_hide(scene: &Scene, camera: &Camera) -> bool {
    let far = camera.clip.map_or(f32::INFINITY, |[_, far]| far);
    let [low, high] = scene.bounds().unwrap_or_default();
    let back = Vec3::from(camera.to_world.matrix3.z_axis);
    let deepest = Vec3::select(back.cmplt(Vec3::ZERO), high, low) - Vec3::from(camera.to_world.translation);
    far.is_finite() && -back.dot(deepest) > far
}

/// The share, in [0, 1], of the surfaces in the view of a camera that lies beyond its far plane, by a grid of rays.
pub fn hidden_share(scene: &PreparedScene, camera: &Camera) -> f32 {
    if !may_hide(&scene.scene, camera) {
        return 0.0;
    }
    let aspect = camera.natural_aspect().unwrap_or(1.0).clamp(0.1, 10.0);
    let (width, height) = ((RAYS as f32 * aspect) as u32, RAYS);
    let [all, seen] =
        [None, camera.clip].map(|clip| CameraRays::new(&Camera { clip, ..camera.clone() }, width, height));
    let (mut rays, mut hits, mut ends) = (RayBatch::default(), HitBatch::default(), Vec::new());
    let count = (width * height) as usize;
    rays.open(count, scene.geometry.moves);
    for first in (0..count).step_by(LANES) {
        let number = U::splat(first as u32) + U::from(NUMBERS);
        let [x, y] = [number.to_array().map(|i| i % width), number.to_array().map(|i| i / width)];
        let [x, y] = [x, y].map(|c| F::from(c.map(|c| c as f32 + 0.5)));
        let ray = all.rays(x, y, F::splat(0.5));
        rays.put(first, ray, F::splat(f32::INFINITY), U::ZERO, F::splat(0.5));
        let (near, far) = seen.intervals(ray.1, F::splat(0.5));
        rays.tnear[first..first + LANES].copy_from_slice(near.as_array());
        ends.extend_from_slice(far.as_array());
    }
    rays.close(count);
    scene.rays.closest_hits(&rays, RayOrder::Coherent, &mut hits);
    let met = (0..count).filter(|i| hits.mesh[*i] != MISS);
    let (hidden, surfaces) = met.fold((0, 0), |(hidden, all), i| (hidden + usize::from(hits.t[i] > ends[i]), all + 1));
    hidden as f32 / surfaces.max(1) as f32
}
