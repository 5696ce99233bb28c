//! Measurements of one scene: renders them, keeps them on disk and takes them up again.

use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Instant;

use bismar::render::{Progress, RenderSettings, RunOptions, StopReason, StudyOptions, Technique, run};
use bismar::{Error, Result};
use tracing::info;

use super::cell::{Cell, Prepass, Replica, Times};
use super::key::{Key, What};
use super::{Design, HALF, Mosaic, StudyScene};
use crate::clock::process_seconds;
use crate::files;

/// First seed of each use; ranges do not overlap.
pub(super) mod seeds {
    pub const REPLICAS: u32 = 0;
    pub(crate) const CONTROL: u32 = 1 << 20;
    pub(crate) const REFERENCE: u32 = 4 << 20;

    pub const ALL: [(&str, u32); 3] = [("replicas", REPLICAS), ("control", CONTROL), ("reference", REFERENCE)];
}

/// Every so many rounds, `half` is rendered again for its time only, if its replicas are on disk already.
const TIMING_ROUNDS: usize = 4;
/// Seconds between two writes of unfinished cells.
const SAVE_SECONDS: f64 = 60.0;

pub(super) struct Campaign<'a> {
    scene: &'a StudyScene,
    design: &'a Design,
    mosaic: Mosaic,
    settings: RenderSettings,
    stop: &'a AtomicBool,
    progress: &'a (dyn Fn(Progress) + Sync),
    folder: PathBuf,
    start: Instant,
    /// Paths per pixel rendered so far, and in all.
    done: f64,
    pub all: f64,
    rays: AtomicU64,
}

impl<'a> Campaign<'a> {
    pub fn new(
        scene: &'a StudyScene,
        design: &'a Design,
        mosaic: Mosaic,
        (stop, progress): (&'a AtomicBool, &'a (dyn Fn(Progress) + Sync)),
    ) -> Result<Self> {
        let folder = scene.folder(design);
        files::folder(&folder)?;
        let (start, rays) = (Instant::now(), AtomicU64::new(0));
        let [width, height] = mosaic.picture;
        let settings = RenderSettings { width, height, ..scene.settings.clone() };
        Ok(Self { scene, design, mosaic, settings, stop, progress, folder, start, done: 0.0, all: 0.0, rays })
    }

    pub fn pixels(&self) -> usize {
        self.mosaic.pixels()
    }

    fn path(&self, key: Key) -> PathBuf {
        self.folder.join(key.file_name())
    }

    /// A stored cell, if this program renders a tile of it to the same bits; else an empty one.
    pub fn stored(&self, key: Key) -> Result<Cell> {
        let none = Cell::new(self.pixels());
        let Some(cell) = Cell::read(&self.path(key), self.pixels())? else { return Ok(none) };
        if cell.replicas() == 0 {
            return Ok(none);
        }
        let middle = self.mosaic.middle();
        let (own, old) = (self.replica(key, 0, Some(middle))?.values, cell.picture(0));
        let same = self.mosaic.pixels_of(middle).all(|(at, _)| own[3 * at..][..3] == old[3 * at..][..3]);
        if !same {
            info!("{}: {} is measured anew: this program samples otherwise", self.scene.name, key.file_name());
        }
        Ok(if same { cell } else { none })
    }

    /// Renders replicas until each cell has `replicas`, one of each cell in turn: other load on the machine affects all
    /// alike.
    pub fn rounds(&mut self, cells: &mut [(Key, Cell)], replicas: usize) -> Result<()> {
        let half = What::Picture(HALF);
        let mut saved = Instant::now();
        let mut dirty = vec![false; cells.len()];
        let mut round = || -> Result<()> {
            for r in 0..replicas {
                let due = cells.iter().map(|(_, cell)| cell.replicas() == r).collect::<Vec<_>>();
                let mut half_cpu = None;
                for (i, (key, cell)) in cells.iter_mut().enumerate() {
                    let again = key.what == half && r % TIMING_ROUNDS == 0 && due.iter().any(|&d| d);
                    if !due[i] && !again {
                        continue;
                    }
                    let mut taken = self.replica(*key, r as u32, None)?;
                    if key.what == half {
                        half_cpu = Some(taken.times.cpu);
                    }
                    if !due[i] {
                        continue;
                    }
                    taken.times.half_cpu = half_cpu;
                    cell.push(&taken);
                    dirty[i] = true;
                    self.done += f64::from(key.spp);
                }
                if saved.elapsed().as_secs_f64() > SAVE_SECONDS {
                    self.save(cells, &mut dirty)?;
                    saved = Instant::now();
                }
            }
            Ok(())
        };
        let ended = round();
        self.save(cells, &mut dirty)?;
        ended
    }

    fn save(&self, cells: &[(Key, Cell)], dirty: &mut [bool]) -> Result<()> {
        for ((key, cell), dirty) in cells.iter().zip(dirty) {
            if std::mem::take(dirty) {
                cell.write(&self.path(*key))?;
            }
        }
        Ok(())
    }

    /// Replica `r`, or only one tile of it, by its number in the mosaic.
    fn replica(&self, key: Key, r: u32, tile: Option<usize>) -> Result<Replica> {
        let (seeds, estimator) = match key.what {
            What::Picture(estimator) => (seeds::REPLICAS, estimator),
            What::Control => (seeds::CONTROL, HALF),
            What::Reference => (seeds::REFERENCE, self.design.reference()),
        };
        let (balance, techniques) = estimator.parts();
        let settings =
            RenderSettings { spp: Some(key.spp), seed: seeds + r, balance, techniques, ..self.settings.clone() };
        let numbers = tile.map_or(0..self.mosaic.tiles.len(), |tile| tile..tile + 1);
        let study = StudyOptions { tiles: Some(self.mosaic.tiles[numbers.clone()].into()), ..Default::default() };
        let before = self.rays.load(Ordering::Relaxed);
        let cpu = process_seconds();
        let progress = |p: Progress| {
            if self.all > 0.0 && tile.is_none() {
                let fraction = ((self.done + p.fraction * f64::from(key.spp)) / self.all).clamp(0.0, 1.0);
                let seconds = self.start.elapsed().as_secs_f64();
                (self.progress)(Progress { fraction, seconds, rays: before + p.rays, ..p });
            }
        };
        let options = RunOptions { study, ..RunOptions::new(self.stop, &progress) };
        let rendered = run(&self.scene.scene, &settings, options)?;
        let times = Times {
            cpu: process_seconds() - cpu,
            half_cpu: None,
            prepass: rendered.stats.techniques[Technique::Guiding].as_ref().map(Prepass::of),
            allocation: rendered.stats.techniques[Technique::Adaptive].and_then(|adaptive| adaptive.remaining),
        };
        self.rays.fetch_add(rendered.stats.rays(), Ordering::Relaxed);
        if rendered.stop == StopReason::Interrupted {
            return Err(Error::Interrupted(format!(
                "interrupted: what was measured is saved in {}; run the same command again to go on",
                self.design.folder.display()
            )));
        }
        let values =
            self.mosaic.gather(numbers.clone(), &rendered.tiles, |tile, i| tile.stats[i].mean()).into_flattened();
        let shares = self.mosaic.gather(numbers.clone(), &rendered.tiles, |tile, i| tile.shares[i].light_share);
        let paths = self.mosaic.gather(numbers, &rendered.tiles, |tile, i| tile.stats[i].samples as f32);
        Ok(Replica { times, values, shares, paths })
    }
}
