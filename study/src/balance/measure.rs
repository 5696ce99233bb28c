//! Renders the measurements that are not on disk yet.

use std::sync::atomic::AtomicBool;

use bismar::Result;
use bismar::render::Progress;
use tracing::info;

use super::campaign::Campaign;
use super::cell::Cell;
use super::key::{Key, What, keys};
use super::{Design, StudyScene};

/// Independent renders that make up the reference.
const REFERENCE_PARTS: u32 = 16;

pub struct Measured {
    pub reference: Cell,
    pub cells: Vec<(Key, Cell)>,
}

impl Measured {
    /// A cell, if it was planned.
    pub fn get(&self, what: What, spp: u32) -> Option<&Cell> {
        self.cells.iter().find(|(k, _)| *k == Key { what, spp }).map(|(_, cell)| cell)
    }
}

/// Takes what is missing of `design` on a scene, on the current rayon pool, and returns everything.
///
/// A cell on disk is kept only if a tile of its first replica, rendered again, has the same bits: what a change of the
/// program left alone is not measured twice, and what it changed is never mixed.
pub fn measure(
    scene: &StudyScene,
    design: &Design,
    stop: &AtomicBool,
    progress: &(dyn Fn(Progress) + Sync),
) -> Result<Measured> {
    let mosaic = design.mosaic()?;
    let mut campaign = Campaign::new(scene, design, mosaic, (stop, progress))?;
    let reference_key = Key { what: What::Reference, spp: design.reference_spp.div_ceil(REFERENCE_PARTS) };
    let mut reference = vec![(reference_key, campaign.stored(reference_key)?)];
    let mut cells = Vec::new();
    for key in keys(design) {
        cells.push((key, campaign.stored(key)?));
    }
    campaign.all = missing(&reference, REFERENCE_PARTS) + missing(&cells, design.replicas);
    if campaign.all > 0.0 {
        info!("{}: {:.0} Mpaths to take", scene.name, campaign.all * campaign.pixels() as f64 / 1e6);
    }
    campaign.rounds(&mut reference, REFERENCE_PARTS as usize)?;
    let reference = reference.remove(0).1;
    for spp in &design.spp {
        let (mut these, others) = cells.into_iter().partition::<Vec<_>, _>(|(key, _)| key.spp == *spp);
        cells = others;
        campaign.rounds(&mut these, design.replicas as usize)?;
        cells.append(&mut these);
    }
    Ok(Measured { reference, cells })
}

/// Paths a pixel that cells lack.
fn missing(cells: &[(Key, Cell)], replicas: u32) -> f64 {
    let left = |c: &Cell| f64::from(replicas) - c.replicas().min(replicas as usize) as f64;
    cells.iter().map(|(key, cell)| f64::from(key.spp) * left(cell)).sum()
}
