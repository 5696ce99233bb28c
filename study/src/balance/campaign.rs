//! Measurements of one scene: renders them, keeps them on disk and takes them up again.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Instant;

use bismar::render::{Progress, RenderSettings, RunOptions, StopReason, StudyOptions, Technique, run};
use bismar::{Error, Result};
use tracing::info;

use super::cell::{Cell, Prepass, Replica, Times};
use super::key::{Key, What, last_pass};
use super::{Design, Estimator, HALF, Mosaic, StudyScene, oracle};
use crate::clock::process_seconds;
use crate::files;

/// First seed of each use; ranges do not overlap.
pub(super) mod seeds {
    pub const REPLICAS: u32 = 0;
    pub const CONTROL: u32 = 1 << 20;
    pub const FOUND: u32 = 2 << 20;
    pub const ORACLE: u32 = 3 << 20;
    pub const REFERENCE: u32 = 4 << 20;

    pub const ALL: [(&str, u32); 5] =
        [("replicas", REPLICAS), ("control", CONTROL), ("found", FOUND), ("oracle", ORACLE), ("reference", REFERENCE)];
}

/// Every so many rounds, `half` is rendered again for its time only, if its replicas are on disk already.
const TIMING_ROUNDS: usize = 4;
/// Seconds between two writes of unfinished cells.
const SAVE_SECONDS: f64 = 60.0;

/// Parameters of a render in addition to the scene's settings.
struct Take {
    spp: u32,
    seed: u32,
    estimator: Estimator,
    shares: Option<Arc<[f32]>>,
    passes: Option<u32>,
    /// Number of the only one of the mosaic.
    tile: Option<usize>,
}

impl Default for Take {
    fn default() -> Self {
        Self { spp: 1, seed: 0, estimator: HALF, shares: None, passes: None, tile: None }
    }
}

/// Measurement of one scene.
pub(super) struct Campaign<'a> {
    scene: &'a StudyScene,
    design: &'a Design,
    mosaic: Mosaic,
    settings: RenderSettings,
    stop: &'a AtomicBool,
    progress: &'a (dyn Fn(Progress) + Sync),
    folder: PathBuf,
    /// Prefix of its file names.
    prefix: &'static str,
    start: Instant,
    /// Paths per pixel rendered so far, and in all.
    done: f64,
    pub all: f64,
    rays: AtomicU64,
    /// The oracle's, of the measured pixels; while cells are looked for, those of its cell.
    pub shares: Option<Arc<[f32]>>,
}

impl<'a> Campaign<'a> {
    pub fn new(
        scene: &'a StudyScene,
        design: &'a Design,
        mosaic: Mosaic,
        prefix: &'static str,
        (stop, progress): (&'a AtomicBool, &'a (dyn Fn(Progress) + Sync)),
    ) -> Result<Self> {
        let folder = scene.folder(design);
        files::folder(&folder)?;
        let (start, rays) = (Instant::now(), AtomicU64::new(0));
        let [width, height] = mosaic.picture;
        let settings = RenderSettings { width, height, ..scene.settings.clone() };
        Ok(Self {
            scene,
            design,
            mosaic,
            settings,
            stop,
            progress,
            folder,
            prefix,
            start,
            done: 0.0,
            all: 0.0,
            rays,
            shares: None,
        })
    }

    pub fn pixels(&self) -> usize {
        self.mosaic.pixels()
    }

    fn path(&self, key: Key) -> PathBuf {
        self.folder.join(format!("{}{}", self.prefix, key.file_name()))
    }

    /// A stored cell, if this program renders a tile of it to the same bits; else an empty one.
    pub fn stored(&mut self, key: Key) -> Result<Cell> {
        let none = Cell::new(self.pixels());
        let Some(cell) = Cell::read(&self.path(key), self.pixels())? else { return Ok(none) };
        if cell.replicas() == 0 {
            return Ok(none);
        }
        let middle = self.mosaic.middle();
        if key.what == What::Picture(Estimator::Oracle) {
            self.shares = Some(cell.shares_of(0).into());
        }
        let (own, old) = (self.replica(key, 0, Some(middle))?.values, cell.picture(0));
        let same = self.mosaic.pixels_of(middle).all(|(at, _)| own[3 * at..][..3] == old[3 * at..][..3]);
        if !same {
            info!("{}: {} is measured anew: this program samples otherwise", self.scene.name, key.file_name());
        }
        Ok(if same { cell } else { none })
    }

    /// The oracle's, if they were found before.
    pub fn stored_shares(&self) -> Result<Option<Arc<[f32]>>> {
        let cell = Cell::read(&self.folder.join(oracle::FILE), self.pixels())?;
        Ok(cell.filter(|c| c.replicas() == 1).map(|c| c.shares_of(0).into()))
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
                    self.done += key.work();
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

    /// Finds the oracle's shares and keeps them.
    pub fn train(&mut self, reference: &Cell) -> Result<()> {
        let spp = oracle::spp(self.design);
        let mean = reference.mean();
        let mut learner = oracle::Learner::new(&mean);
        for r in 0..self.design.replicas {
            for (i, &share) in oracle::SHARES.iter().enumerate() {
                let shares = Some(vec![share; self.pixels()].into());
                let taken = self.take(Take { spp, seed: seeds::ORACLE + r, shares, ..Take::default() })?;
                learner.add(i, taken.values.into_iter());
                self.done += f64::from(spp);
            }
        }
        let shares = learner.shares();
        let mut cell = Cell::new(self.pixels());
        let values = mean.iter().map(|&x| x as f32).collect();
        cell.push(&Replica { values, shares: shares.clone(), ..Replica::default() });
        cell.write(&self.folder.join(oracle::FILE))?;
        self.shares = Some(shares.into());
        Ok(())
    }

    fn replica(&self, key: Key, r: u32, tile: Option<usize>) -> Result<Replica> {
        let take = |seed, estimator| Take { spp: key.spp, seed: seed + r, estimator, tile, ..Take::default() };
        let take = match key.what {
            What::Picture(Estimator::Oracle) => Take { shares: self.shares.clone(), ..take(seeds::REPLICAS, HALF) },
            What::Picture(estimator) => take(seeds::REPLICAS, estimator),
            What::Control => take(seeds::CONTROL, HALF),
            What::Reference => take(seeds::REFERENCE, self.design.reference()),
            What::Found(balance) => {
                let (passes, _) = last_pass(balance, key.spp);
                let own = take(seeds::REPLICAS, Estimator::Method(balance));
                let shares = self.take(Take { passes: Some(passes), ..own })?.shares;
                // Other seeds: shares that follow from the samples that they weigh would be biased.
                Take { shares: Some(shares.into()), ..take(seeds::FOUND, HALF) }
            }
        };
        self.take(take)
    }

    fn take(&self, take: Take) -> Result<Replica> {
        let (balance, techniques) = take.estimator.parts();
        let settings =
            RenderSettings { spp: Some(take.spp), seed: take.seed, balance, techniques, ..self.settings.clone() };
        let study = StudyOptions {
            light_shares: take.shares.map(|shares| self.mosaic.spread(&shares)),
            max_passes: take.passes,
            tiles: Some(match take.tile {
                None => self.mosaic.tiles.clone(),
                Some(tile) => self.mosaic.tiles[tile..=tile].into(),
            }),
        };
        let before = self.rays.load(Ordering::Relaxed);
        let (wall, cpu) = (Instant::now(), process_seconds());
        let progress = |p: Progress| {
            if self.all > 0.0 && take.tile.is_none() {
                let fraction = ((self.done + p.fraction * f64::from(take.spp)) / self.all).clamp(0.0, 1.0);
                let seconds = self.start.elapsed().as_secs_f64();
                (self.progress)(Progress { fraction, seconds, rays: before + p.rays, ..p });
            }
        };
        let options = RunOptions { study, ..RunOptions::new(self.stop, &progress) };
        let rendered = run(&self.scene.scene, &settings, options)?;
        let times = Times {
            cpu: process_seconds() - cpu,
            wall: wall.elapsed().as_secs_f64(),
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
        let numbers = take.tile.map_or(0..self.mosaic.tiles.len(), |tile| tile..tile + 1);
        let values =
            self.mosaic.gather(numbers.clone(), &rendered.tiles, |tile, i| tile.stats[i].mean()).into_flattened();
        let shares = self.mosaic.gather(numbers.clone(), &rendered.tiles, |tile, i| tile.shares[i].light_share);
        let paths = self.mosaic.gather(numbers, &rendered.tiles, |tile, i| tile.stats[i].samples as f32);
        Ok(Replica { times, values, shares, paths })
    }
}
