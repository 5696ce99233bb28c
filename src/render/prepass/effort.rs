//! How much the pre-passes render, and from which estimates on techniques are used.

use std::time::Instant;

use super::super::RenderSettings;

/// Pixels of a pre-pass at low resolution.
#[derive(Debug, Clone, Copy)]
pub struct Resolution {
    /// Pixels of the picture per pixel of the pre-pass.
    divisor: f64,
    /// Minimum and maximum pixels of the pre-pass.
    range: [f64; 2],
}

impl Resolution {
    /// Pixels of the pre-pass for a picture of so many pixels.
    pub fn pixels(&self, picture_pixels: f64) -> f64 {
        (picture_pixels / self.divisor).clamp(self.range[0], self.range[1])
    }
}

/// Resolution for the density of the environment.
pub const COMPENSATION: Resolution = Resolution { divisor: 32.0, range: [64.0, 1024.0] };
/// Resolution for learned light selection.
pub const LEARNED_LIGHTS: Resolution = Resolution { divisor: 8.0, range: [64.0, 8192.0] };
/// Resolution for guiding.
pub const GUIDING: Resolution = Resolution { divisor: 16.0, range: [8192.0, f64::INFINITY] };
/// Maximum pixels of a picture in the allocation's pre-pass, and the minimum and maximum of a tile. The pre-pass takes at most a
/// thirty-second of the picture's paths.
pub const MAX_ALLOCATION_PIXELS: usize = 1 << 14;
/// See [`MAX_ALLOCATION_PIXELS`].
pub const ALLOCATION_PIXELS_PER_TILE: [usize; 2] = [32, 128];
/// Sampled pixels of a tile in the allocation's first step. With `auto` there is a second step only where the first is promising
/// ([`MAX_REMAINING_AT_FIRST_STEP`]).
pub const FIRST_ALLOCATION_PIXELS_PER_TILE: usize = 12;

/// Maximum seconds of a pre-pass over those of a time limit.
pub const MAX_TIME_SHARE: f64 = 0.1;

/// Has a pre-pass that began then taken its share of a time limit?
pub fn is_late(settings: &RenderSettings, began: Instant) -> bool {
    settings.time.is_some_and(|time| began.elapsed().as_secs_f64() > MAX_TIME_SHARE * time)
}

/// The compensated density is used where at most this fraction of the variance remains.
pub const MAX_REMAINING_COMPENSATED: f64 = 0.97;
/// Area lights are chosen by what was learned where at most this fraction of the variance remains, by the last round: the longer
/// traversal of the light tree takes time.
pub const MAX_REMAINING_LEARNED_LIGHTS: f64 = 0.9;
/// Learning about lights continues after the second round if at most this fraction remains: what one path per pixel has taught is
/// too little to estimate the gain.
pub const MAX_REMAINING_AT_FIRST_ROUND: f64 = 0.97;
/// Paths are guided if at most this fraction of variance times rays remains after the last round: a guided ray takes longer, and
/// smooth light loses the benefit of stratified points. Where 0.5 to 0.62 was estimated, guiding left 0.6 to 0.8 of error times
/// CPU seconds; where 0.66 to 0.72 was, 1.0 to 1.4.
pub const MAX_REMAINING_GUIDED: f32 = 0.6;
/// The same where the pre-pass ended with fewer training samples than suffice: rare light makes the estimate uncertain.
pub const MAX_REMAINING_GUIDED_BY_FEW: f32 = 0.45;
/// Guided and unguided paths are compared by rendering both if more than this fraction remains after the last round. In rooms
/// with less, guiding left at most 0.3.
pub const MAX_REMAINING_CERTAIN: f32 = 0.2;
/// Paths are then guided if the comparison leaves at most this fraction of variance times rays: a guided ray takes 1.2 to 1.6
/// times as long. Rooms that gain had 0.19 to 0.59; one behind open blinds, which loses, 0.64 to 0.74, cornell and webxr_camp 0.77
/// to 1.2.
pub const MAX_REMAINING_COMPARED: f32 = 0.6;
/// Learning for guiding continues after the second round if at most this fraction remains. Certain estimates of rooms
/// that gain were at most 0.57; webxr_camp and cornell, which lose, had 0.63 to 0.75, and later estimates are too low there.
pub const MAX_REMAINING_AT_FIRST_DECISION: f32 = 0.62;
/// The same where the relative standard error of the second moment exceeds [`UNCERTAIN_STANDARD_ERROR`]. In rooms with lamps in
/// shades the first estimates were 0.3 to 0.72, the last ones 0.2 to 0.4. Elsewhere 0.67 to 0.73 became 0.5 to 0.57, and guiding
/// left 1.06 to 1.1 of error times CPU seconds.
pub const MAX_REMAINING_UNCERTAIN: f32 = 0.75;
/// See [`MAX_REMAINING_UNCERTAIN`].
pub const UNCERTAIN_STANDARD_ERROR: f32 = 0.1;
/// Learning continues after the third round if at most this fraction remains. With lamps in shades it was up to 0.56, behind
/// blinds up to 0.65; where the second round was wrong it was 0.8 to 0.9.
pub const MAX_REMAINING_AT_SECOND_DECISION: f32 = 0.7;
/// All tiles get the same number of paths where more than this fraction of error times cost would remain.
pub const MAX_REMAINING_ALLOCATED: f64 = 0.95;
/// The same after the allocation's first step: few pixels tell tiles apart badly, which makes the estimate too high.
pub const MAX_REMAINING_AT_FIRST_STEP: f64 = 0.97;
/// Emission gets no camera rays of its own where more than this fraction of error times cost would remain.
pub const MAX_REMAINING_BY_EMISSION_RAYS: f64 = 0.99;

/// Cost of a camera ray over that of a ray of a later bounce or of a shadow ray: camera rays are coherent, and those that meet
/// nothing are not shaded. Fitted to CPU times of pictures with and without an allocation.
pub const CAMERA_RAY_COST: f64 = 0.3;
