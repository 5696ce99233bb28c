//! How much the pre-passes render, and from which estimates on techniques are used.

use std::time::Instant;

use crate::integrator::WaveCounts;
use crate::render::settings::RenderSettings;

/// Pixels of the pre-pass for the density of the environment, of a picture of so many pixels.
pub fn compensation_pixels(picture_pixels: f64) -> f64 {
    (picture_pixels / 32.0).clamp(64.0, 1024.0)
}

/// Pixels of the pre-pass for learned light selection.
pub fn learned_lights_pixels(picture_pixels: f64) -> f64 {
    (picture_pixels / 8.0).clamp(64.0, 8192.0)
}

/// Pixels of the pre-pass for guiding.
pub fn guiding_pixels(picture_pixels: f64) -> f64 {
    (picture_pixels / 16.0).max(8192.0)
}

/// Pixels of a picture in the second step of the allocation's pre-pass, within the minimum and maximum of a tile. They take
/// as many paths as one or two for every pixel of the picture.
pub const ALLOCATION_PIXELS: usize = 1 << 13;
/// Minimum and maximum pixels of a tile in that step.
pub const ALLOCATION_PIXELS_PER_TILE: [usize; 2] = [16, 32];
/// Sampled pixels of a tile in the allocation's first step. With `auto` there is a second step only where the first is promising
/// ([`MAX_REMAINING_ALLOCATED_BY_FEW`]).
pub const FIRST_ALLOCATION_PIXELS_PER_TILE: usize = 12;

/// Maximum seconds of a pre-pass over those of a time limit.
pub const MAX_TIME_SHARE: f64 = 0.1;

/// Has a pre-pass that began then taken its share of a time limit?
pub fn is_late(settings: &RenderSettings, began: Instant) -> bool {
    settings.time.is_some_and(|time| began.elapsed().as_secs_f64() > MAX_TIME_SHARE * time)
}

/// A first estimate is promising up to this fraction: it varies by about three per cent. The limit bounds what is spent where
/// nothing can be gained. The compensated density costs nothing more, and is used where it is promising.
pub const MAX_REMAINING_PROMISING: f64 = 0.97;
/// Of the variance with learned lights: bounds the time of the longer traversal of the light tree, which rays do not tell.
pub const MAX_REMAINING_LEARNED_LIGHTS: f64 = 0.9;
/// Of error times cost with paths of each tile's own: bounds what is lost where the sampled pixels are wrong about a tile. The
/// estimate is high: three quarters of these pixels allocate worse than all, and what counts within tiles gain is not in it.
pub const MAX_REMAINING_ALLOCATED: f64 = 0.99;
/// The same in the first step, whose few pixels are wrong more often: the second finds up to 0.08 less.
pub const MAX_REMAINING_ALLOCATED_BY_FEW: f64 = 1.0;
/// Of error times cost with camera rays for emission, whose error and cost are known well.
pub const MAX_REMAINING_BY_EMISSION_RAYS: f64 = 0.99;
/// Of error times cost with shared paths: bounds the time of groups that rays do not tell, and that a picture's points are better
/// stratified than those of a few paths.
pub const MAX_REMAINING_SHARED: f64 = 0.8;
/// Of variance times rays with guided paths, by the last estimate and by rendering both ways: bounds the time of a guided ray, up
/// to 1.6 times that of another one.
pub const MAX_REMAINING_GUIDED: f32 = 0.6;
/// The same where the pre-pass ended with fewer training samples than suffice: bounds the error of an estimate by rare light.
pub const MAX_REMAINING_GUIDED_BY_FEW: f32 = 0.45;
/// Up to this fraction guided and unguided paths are not compared by rendering both. The comparison differs from the estimate in
/// what stratified points gain without a field: a factor of three at most.
pub const MAX_REMAINING_CERTAIN: f32 = 0.2;
/// Learning for guiding goes on up to this fraction: bounds what later estimates fall by. The second number is for estimates after
/// the third round, and for those whose second moment has a relative standard error above [`UNCERTAIN_STANDARD_ERROR`].
pub const MAX_REMAINING_LEARNING: [f32; 2] = [0.62, 0.75];
/// See [`MAX_REMAINING_LEARNING`].
pub const UNCERTAIN_STANDARD_ERROR: f32 = 0.1;

/// Cost of a camera ray over that of a ray of a later bounce or of a shadow ray: camera rays are coherent, and those that meet
/// nothing are not shaded. Fitted to CPU times of pictures with and without an allocation.
pub const CAMERA_RAY_COST: f64 = 0.3;
/// Cost of a visibility ray between two surfaces that share paths, with the evaluation of both, over the same: these rays are
/// short, and eight lie together.
const SHARED_RAY_COST: f64 = 0.25;

/// Cost of the paths of a wave, in rays beyond the camera's. What is counted does not depend on the machine or its load.
pub fn cost(counts: &WaveCounts) -> f64 {
    let beyond = counts.first_bounce_rays + counts.later_bounce_rays + counts.shadow_rays;
    CAMERA_RAY_COST * counts.camera_rays as f64 + beyond as f64 - (1.0 - SHARED_RAY_COST) * counts.shared_rays as f64
}
