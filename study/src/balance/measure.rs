//! Takes the measurements that are not on disk yet.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Instant;

use bismar::balance::Balance;
use bismar::film::{Film, PixelStats};
use bismar::render::tile::TILE;
use bismar::render::{Progress, RenderSettings, StopReason, render};
use bismar::{Error, Result};
use tracing::info;

use super::cell::{Cell, Times};
use super::key::{Key, What, keys, last_pass};
use super::{Design, Estimator, StudyScene, oracle};
use crate::clock::process_seconds;
use crate::files;

/// Where the seeds of each use begin: no two uses share one.
pub(super) mod seeds {
    pub const REPLICAS: u32 = 0;
    pub const CONTROL: u32 = 1 << 20;
    pub const FOUND: u32 = 2 << 20;
    pub const ORACLE: u32 = 3 << 20;
    pub const REFERENCE: u32 = 4 << 20;

    /// For results.
    pub const ALL: [(&str, u32); 5] =
        [("replicas", REPLICAS), ("control", CONTROL), ("found", FOUND), ("oracle", ORACLE), ("reference", REFERENCE)];
}

/// Independent renders that make up the reference.
pub const REFERENCE_PARTS: u32 = 16;
/// Of these rounds, one renders `half` again for the time alone, where its replicas are on disk already.
const TIMING_ROUNDS: usize = 4;
/// Seconds between two writes of unfinished cells.
const SAVE_SECONDS: f64 = 60.0;

/// All measurements of a scene.
pub struct Measured {
    /// Parts of the reference.
    pub reference: Cell,
    /// Everything else.
    pub cells: Vec<(Key, Cell)>,
}

impl Measured {
    /// A cell, if it was planned.
    pub fn get(&self, what: What, spp: u32) -> Option<&Cell> {
        self.cells.iter().find(|(k, _)| *k == Key { what, spp }).map(|(_, cell)| cell)
    }
}

/// What a render is to be, besides the scene's settings.
#[derive(Clone, Default)]
struct Take {
    spp: u32,
    seed: u32,
    balance: Option<Balance>,
    shares: Option<Arc<[f32]>>,
    passes: Option<u32>,
    crop: Option<[u32; 4]>,
}

/// Takes what is missing of `design` on a scene, on the current rayon pool, and returns everything.
///
/// A cell on disk is kept only if a tile of its first replica, rendered again, has the same bits: what a change of the
/// program left alone is not measured twice, and what it changed is never mixed.
///
/// # Errors
/// [`Error::Interrupted`] when `stop` is raised, with everything saved that was finished; what reading and writing cells
/// returns.
pub fn measure(
    scene: &StudyScene,
    design: &Design,
    stop: &AtomicBool,
    progress: &(dyn Fn(Progress) + Sync),
) -> Result<Measured> {
    let mut campaign = Campaign::new(scene, design, scene.settings.clone(), "", (stop, progress))?;
    let reference_key = Key { what: What::Reference, spp: design.reference_spp.div_ceil(REFERENCE_PARTS) };
    let mut reference = vec![(reference_key, campaign.stored(reference_key)?)];
    let mut cells = Vec::new();
    for key in keys(design) {
        cells.push((key, campaign.stored(key)?));
    }
    let wants_oracle = design.estimators.contains(&Estimator::Oracle);
    campaign.all = missing(&reference, REFERENCE_PARTS) + missing(&cells, design.replicas);
    if campaign.all > 0.0 {
        info!("{}: {:.0} Mpaths to take", scene.name, campaign.all * campaign.pixels() as f64 / 1e6);
    }
    campaign.shares = if wants_oracle { campaign.stored_shares()? } else { None };
    let training = oracle::training(design);
    if wants_oracle && campaign.shares.is_none() {
        campaign.all += f64::from(training.spp * training.replicas) * oracle::SHARES.len() as f64;
    }

    campaign.rounds(&mut reference, REFERENCE_PARTS as usize)?;
    let reference = reference.remove(0).1;
    if wants_oracle && campaign.shares.is_none() {
        campaign.train(&reference, training)?;
    }
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
    cells.iter().map(|(key, cell)| key.work() * left(cell)).sum()
}

/// A scene to be looked at, not measured.
pub struct Portrait {
    /// Pixels a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// A balance that `half` is compared with by eye.
    pub shown: Balance,
    /// Paths a pixel of the two noisy pictures.
    pub spp: u32,
    /// By `shown`, with [`PORTRAIT_SPP`] paths a pixel.
    pub clean: Cell,
    /// By `half` and by `shown`.
    pub noisy: [Cell; 2],
}

/// Paths a pixel of a portrait.
pub const PORTRAIT_SPP: u32 = 64;

/// Takes the portrait of a scene, several times as large as the measured pictures, as far as it is not on disk.
///
/// # Errors
/// As [`measure`].
pub fn portrait(
    scene: &StudyScene,
    design: &Design,
    shown: Balance,
    stop: &AtomicBool,
    progress: &(dyn Fn(Progress) + Sync),
) -> Result<Portrait> {
    let times = (256 / design.width.max(design.height)).max(1);
    let (width, height) = (times * design.width, times * design.height);
    let settings = RenderSettings { width, height, ..scene.settings.clone() };
    let mut campaign = Campaign::new(scene, design, settings, "portrait-", (stop, progress))?;
    let spp = design.spp.first().map_or(16, |&s| s.min(16));
    let key = |balance, spp| Key { what: What::Picture(Estimator::Method(balance)), spp };
    let mut cells = Vec::new();
    for key in [key(shown, PORTRAIT_SPP), key(Balance::Half, spp), key(shown, spp)] {
        cells.push((key, campaign.stored(key)?));
    }
    campaign.all = missing(&cells, 1);
    campaign.rounds(&mut cells, 1)?;
    let mut cells = cells.into_iter().map(|(_, cell)| cell);
    let mut next = || cells.next().unwrap_or_default();
    Ok(Portrait { width, height, shown, spp, clean: next(), noisy: [next(), next()] })
}

struct Campaign<'a> {
    scene: &'a StudyScene,
    design: &'a Design,
    settings: RenderSettings,
    stop: &'a AtomicBool,
    progress: &'a (dyn Fn(Progress) + Sync),
    folder: PathBuf,
    /// Begins the names of its files.
    prefix: &'static str,
    start: Instant,
    /// Paths a pixel taken, and to take in all.
    done: f64,
    all: f64,
    rays: AtomicU64,
    /// The oracle's.
    shares: Option<Arc<[f32]>>,
}

impl<'a> Campaign<'a> {
    fn new(
        scene: &'a StudyScene,
        design: &'a Design,
        settings: RenderSettings,
        prefix: &'static str,
        (stop, progress): (&'a AtomicBool, &'a (dyn Fn(Progress) + Sync)),
    ) -> Result<Self> {
        let folder = scene.folder(design);
        files::folder(&folder)?;
        let (start, rays) = (Instant::now(), AtomicU64::new(0));
        Ok(Self {
            scene,
            design,
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

    fn pixels(&self) -> usize {
        (self.settings.width * self.settings.height) as usize
    }

    fn path(&self, key: Key) -> PathBuf {
        self.folder.join(format!("{}{}", self.prefix, key.file_name()))
    }

    /// What there is of a cell that this program would take alike.
    fn stored(&mut self, key: Key) -> Result<Cell> {
        let none = Cell::new(self.pixels());
        let Some(cell) = Cell::read(&self.path(key), self.pixels())? else { return Ok(none) };
        if cell.replicas() == 0 {
            return Ok(none);
        }
        // The tile in the middle.
        let (width, height) = (self.settings.width, self.settings.height);
        let (x, y) = (width / 2 / TILE * TILE, height / 2 / TILE * TILE);
        let crop = [x, y, (x + TILE).min(width), (y + TILE).min(height)];
        let shares = match key.what {
            What::Picture(Estimator::Oracle) => Some(cell.shares_of(0).into()),
            _ => self.shares.clone(),
        };
        let kept = std::mem::replace(&mut self.shares, shares);
        let (film, _) = self.replica(key, 0, Some(crop))?;
        self.shares = kept;
        let mut window = (crop[1]..crop[3]).flat_map(|y| (crop[0]..crop[2]).map(move |x| (y, x)));
        let same = film.pixels.iter().all(|pixel| {
            let at = window.next().map_or(0, |(y, x)| (y * width + x) as usize);
            pixel.mean()[..] == cell.picture(0)[3 * at..][..3]
        });
        if !same {
            info!("{}: {} is measured anew: this program samples otherwise", self.scene.name, key.file_name());
        }
        Ok(if same { cell } else { none })
    }

    fn stored_shares(&self) -> Result<Option<Arc<[f32]>>> {
        let cell = Cell::read(&self.folder.join(oracle::FILE), self.pixels())?;
        Ok(cell.filter(|c| c.replicas() == 1).map(|c| c.shares_of(0).into()))
    }

    /// Takes replicas until each cell has `replicas`, one of each cell in turn: what the machine does otherwise meets all
    /// alike.
    fn rounds(&mut self, cells: &mut [(Key, Cell)], replicas: usize) -> Result<()> {
        let half = What::Picture(Estimator::Method(Balance::Half));
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
                    let (film, mut times) = self.replica(*key, r as u32, None)?;
                    if key.what == half {
                        half_cpu = Some(times.cpu);
                    }
                    if !due[i] {
                        continue;
                    }
                    times.half_cpu = half_cpu;
                    let values = film.pixels.iter().flat_map(PixelStats::mean).collect::<Vec<_>>();
                    let shares = film.pixels.iter().map(|p| p.balance).collect::<Vec<_>>();
                    cell.push(times, &values, &shares);
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
    fn train(&mut self, reference: &Cell, training: oracle::Training) -> Result<()> {
        let mean = reference.mean();
        let mut learner = oracle::Learner::new(&mean);
        for r in 0..training.replicas {
            for (i, &share) in oracle::SHARES.iter().enumerate() {
                let shares = Some(vec![share; self.pixels()].into());
                let (spp, seed) = (training.spp, seeds::ORACLE + r);
                let film = self.film(Take { spp, seed, shares, ..Take::default() })?;
                learner.add(i, film.pixels.iter().flat_map(PixelStats::mean));
                self.done += f64::from(spp);
            }
        }
        let shares = learner.shares();
        let mut cell = Cell::new(self.pixels());
        let picture = mean.iter().map(|&x| x as f32).collect::<Vec<_>>();
        cell.push(Times { cpu: 0.0, wall: 0.0, half_cpu: None }, &picture, &shares);
        cell.write(&self.folder.join(oracle::FILE))?;
        self.shares = Some(shares.into());
        Ok(())
    }

    /// One replica, or a window of it.
    fn replica(&self, key: Key, r: u32, crop: Option<[u32; 4]>) -> Result<(Film, Times)> {
        let take = |seed, balance| Take { spp: key.spp, seed: seed + r, balance, crop, ..Take::default() };
        let take = match key.what {
            What::Picture(Estimator::Method(balance)) => take(seeds::REPLICAS, Some(balance)),
            What::Picture(Estimator::Oracle) => {
                Take { shares: self.shares.clone(), ..take(seeds::REPLICAS, Some(Balance::Half)) }
            }
            What::Control => take(seeds::CONTROL, Some(Balance::Half)),
            What::Reference => take(seeds::REFERENCE, Some(Balance::Half)),
            What::Found(balance) => {
                let (passes, _) = last_pass(balance, key.spp);
                let film = self.film(Take { passes: Some(passes), ..take(seeds::REPLICAS, Some(balance)) })?;
                let mut shares = vec![0.5; self.pixels()];
                let [x0, y0, x1, y1] = film.window;
                let window = (y0..y1).flat_map(|y| (x0..x1).map(move |x| y * self.settings.width + x));
                window.zip(&film.pixels).for_each(|(at, p)| shares[at as usize] = p.balance);
                // Other seeds: shares that follow from the samples that they weigh would be biased.
                Take { shares: Some(shares.into()), ..take(seeds::FOUND, None) }
            }
        };
        let (wall, cpu) = (Instant::now(), process_seconds());
        let film = self.film(take)?;
        let times = Times { cpu: process_seconds() - cpu, wall: wall.elapsed().as_secs_f64(), half_cpu: None };
        Ok((film, times))
    }

    fn film(&self, take: Take) -> Result<Film> {
        let settings = RenderSettings {
            spp: Some(take.spp),
            seed: take.seed,
            balance: take.balance.unwrap_or(Balance::Half),
            shares: take.shares,
            passes: take.passes,
            crop: take.crop,
            ..self.settings.clone()
        };
        let before = self.rays.load(Ordering::Relaxed);
        let rendered = render(&self.scene.scene, &settings, self.stop, &|p| {
            if self.all > 0.0 && take.crop.is_none() {
                let fraction = ((self.done + p.fraction * f64::from(take.spp)) / self.all).clamp(0.0, 1.0);
                let seconds = self.start.elapsed().as_secs_f64();
                (self.progress)(Progress { fraction, seconds, rays: before + p.rays, ..p });
            }
        });
        self.rays.fetch_add(rendered.stats.rays(), Ordering::Relaxed);
        match rendered.stop {
            StopReason::Interrupted => Err(Error::Interrupted(format!(
                "interrupted: what was measured is saved in {}; run the same command again to go on",
                self.design.folder.display()
            ))),
            _ => Ok(rendered.film()),
        }
    }
}
