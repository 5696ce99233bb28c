//! What happens on a path, for `--replay-pixel`.

use std::fmt::{self, Display};

use glam::Vec3;

/// Something that happened on a path; `Display` says it in a line.
#[derive(Debug, Clone, Copy)]
pub struct Event {
    /// Segments before.
    pub depth: u32,
    /// What.
    pub what: What,
}

/// What can happen. Radiance is what was added to the path's, weights are those of MIS.
#[derive(Debug, Clone, Copy)]
#[allow(missing_docs, reason = "the names say it")]
pub enum What {
    Ray { origin: Vec3, direction: Vec3, beta: Vec3 },
    Escape,
    Hit { instance: u32, mesh: u32, material: u32, t: f32 },
    Emission { radiance: Vec3, weight: f32 },
    LightSample { toward: &'static str, wi: Vec3, distance: f32, radiance: Vec3, occluded: bool },
    BsdfSample { wi: Vec3, pdf: f32 },
    Ends { why: &'static str },
}

impl Display for Event {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let Self { depth, what } = self;
        let indent = 2 * *depth as usize;
        write!(f, "{:indent$}", "")?;
        match what {
            What::Ray { origin, direction, beta } => {
                write!(f, "{depth}: ray from {origin} toward {direction}, throughput {beta}")
            }
            What::Escape => write!(f, "   escapes"),
            What::Hit { instance, mesh, material, t } => {
                write!(f, "   hits instance {instance}, mesh {mesh}, material {material}, {t} away")
            }
            What::Emission { radiance, weight } => write!(f, "   meets light: {radiance} (weight {weight})"),
            What::LightSample { toward, wi, distance, radiance, occluded } => {
                let seen = if *occluded { " (occluded)" } else { "" };
                write!(f, "   light sample, {toward}, toward {wi}, {distance} away: {radiance}{seen}")
            }
            What::BsdfSample { wi, pdf } => write!(f, "   BSDF sample toward {wi}, pdf {pdf}"),
            What::Ends { why } => write!(f, "   ends: {why}"),
        }
    }
}
