//! What happens along a single path, for `--replay-pixel`.

use std::fmt::{self, Display};

use glam::Vec3;

/// An event along a path; `Display` prints it as one line.
#[derive(Debug, Clone, Copy)]
pub struct Event {
    /// Number of path segments before it.
    pub depth: u32,
    /// What happened.
    pub kind: EventKind,
}

/// The kinds of events. `radiance` is the contribution that was added to the path, `weight` the MIS weight.
#[derive(Debug, Clone, Copy)]
#[allow(missing_docs, reason = "the names say it")]
pub enum EventKind {
    Ray { origin: Vec3, direction: Vec3, beta: Vec3 },
    Escape,
    Hit { instance: u32, mesh: u32, material: u32, t: f32 },
    PassesWall { weight: Vec3, t: f32 },
    Emission { radiance: Vec3, weight: f32 },
    LightSample { toward: &'static str, wi: Vec3, distance: f32, radiance: Vec3, occluded: bool },
    BsdfSample { wi: Vec3, pdf: f32 },
    Ends { reason: &'static str },
}

impl Display for Event {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let Self { depth, kind } = self;
        let indent = 2 * *depth as usize;
        write!(f, "{:indent$}", "")?;
        match kind {
            EventKind::Ray { origin, direction, beta } => {
                write!(f, "{depth}: ray from {origin} toward {direction}, throughput {beta}")
            }
            EventKind::Escape => write!(f, "   escapes"),
            EventKind::Hit { instance, mesh, material, t } => {
                write!(f, "   hits instance {instance}, mesh {mesh}, material {material}, {t} away")
            }
            EventKind::PassesWall { weight, t } => write!(f, "   passes a thin wall {t} away, which leaves {weight}"),
            EventKind::Emission { radiance, weight } => write!(f, "   meets light: {radiance} (weight {weight})"),
            EventKind::LightSample { toward, wi, distance, radiance, occluded } => {
                let seen = if *occluded { " (occluded)" } else { "" };
                write!(f, "   light sample, {toward}, toward {wi}, {distance} away: {radiance}{seen}")
            }
            EventKind::BsdfSample { wi, pdf } => write!(f, "   BSDF sample toward {wi}, pdf {pdf}"),
            EventKind::Ends { reason } => write!(f, "   ends: {reason}"),
        }
    }
}
