//! How much the pre-passes render, and what rays cost.

use std::time::Instant;

use crate::integrator::{Proposal, WaveCounts};
use crate::render::settings::RenderSettings;

/// Pixels of the pre-pass for learned light selection, of a picture of so many pixels.
pub fn learned_lights_pixels(picture_pixels: f64) -> f64 {
    (picture_pixels / 8.0).clamp(64.0, 8192.0)
}

/// Pixels of the pre-pass for guiding.
pub fn guiding_pixels(picture_pixels: f64) -> f64 {
    (picture_pixels / 16.0).max(6144.0)
}

/// Pixels of a picture in the second step of the allocation's pre-pass, within the minimum and maximum of a tile. They take
/// as many paths as one or two for every pixel of the picture.
pub const ALLOCATION_PIXELS: usize = 1 << 13;
/// Minimum and maximum pixels of a tile in that step.
pub const ALLOCATION_PIXELS_PER_TILE: [usize; 2] = [16, 32];
/// Sampled pixels of a tile in the allocation's first step. With `auto` there is a second step only where the first finds a gain.
pub const FIRST_ALLOCATION_PIXELS_PER_TILE: usize = 12;

/// Maximum seconds of a pre-pass over those of a time limit.
pub const MAX_TIME_SHARE: f64 = 0.1;

/// Has a pre-pass that began then taken its share of a time limit?
pub fn is_late(settings: &RenderSettings, began: Instant) -> bool {
    settings.time.is_some_and(|time| began.elapsed().as_secs_f64() > MAX_TIME_SHARE * time)
}

/// Maximum fraction of error times cost that an allocation, or camera rays for emission, may leave. The estimate is high: three
/// quarters of its pixels allocate worse than all, and what counts within tiles gain is not in it.
pub const MAX_REMAINING_ALLOCATED: f64 = 0.99;

/// Cost of a camera ray over that of a ray of a later bounce or of a shadow ray: camera rays are coherent, and those that meet
/// nothing are not shaded. Fitted to CPU times of pictures with and without an allocation.
pub const CAMERA_RAY_COST: f64 = 0.3;
/// Cost of a visibility ray between two surfaces that share paths, with the evaluation of both, over the same: these rays are
/// short, and eight lie together.
const SHARED_RAY_COST: f64 = 0.3;

/// Time of a guided ray over that of another one, beyond the camera's.
pub const GUIDED_RAY_COST: f64 = 1.25;
/// The same of rays whose light samples are chosen by learned lights: the light tree is traversed further down.
const LEARNED_LIGHTS_RAY_COST: f64 = 1.05;

/// Cost of the paths of a wave, in rays beyond the camera's. What is counted does not depend on the machine or its load; what
/// rays of a technique cost more than others was measured once.
pub fn cost(counts: &WaveCounts, proposal: &Proposal) -> f64 {
    let beyond = counts.first_bounce_rays + counts.later_bounce_rays + counts.shadow_rays - counts.shared_rays;
    let guided = if proposal.field.is_some() { GUIDED_RAY_COST } else { 1.0 };
    let learned = if proposal.lights.learned.is_some() { LEARNED_LIGHTS_RAY_COST } else { 1.0 };
    let shared = SHARED_RAY_COST * counts.shared_rays as f64;
    CAMERA_RAY_COST * counts.camera_rays as f64 + guided * learned * beyond as f64 + shared
}
