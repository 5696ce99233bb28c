//! One mean in every picture: random scenes, rendered in all ways that must agree.
//!
//! Each scene is rendered by the plain command, by each technique alone, by all of them, and in a way that chance chooses, and
//! compared with `--balance half` of four times the paths: the whole picture, and blocks of pixels. What differs is rendered again
//! with other seeds, and then with ever fewer [`features`], until only those are left that the fault needs.

pub mod features;
pub mod judge;
pub mod materials;
pub mod page;
pub mod ways;

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};

use bismar::render::RenderSettings;
use bismar::sampling::random::mix;
use bismar::{Error, Result};
use serde::{Deserialize, Serialize};

use crate::balance::scene::Files;
use features::{Canvas, Feature, joined};
use judge::{AGAIN, FIRST, Test, Together};
use ways::{LOST_OF, Picture, REGIONS, SIZE, Stage, Way};

/// Light that the first control takes from all pixels, as a fraction.
pub const REMOVED: f64 = 0.01;
/// The least part of the ways in which each control must be caught: ways of few scenes, and with rare light, see less. (In 300
/// scenes half of the ways notice lost paths.)
pub const LEAST_CAUGHT: f64 = 0.25;
/// What is tested over all scenes: the pictures, and those of the controls.
const TESTED: [fn(&Picture, usize) -> f64; 3] = [
    |picture, region| picture.regions[region],
    |picture, region| picture.regions[region] * (1.0 - REMOVED),
    |picture, region| picture.robbed[region],
];
type AllScenes = [[Together; REGIONS]; TESTED.len()];
/// The fewest scenes of which controls are asked.
pub const CONTROLLED: usize = 20;
/// How many times as many pictures are rendered of what differs.
const MORE: u32 = 4;
/// A scene is made smaller as long as a test keeps this much of its distance from zero, and is this far from it.
const KEPT: (f64, f64) = (0.5, 4.5);

/// A scene to be tested.
#[derive(Debug, Clone)]
pub struct Subject {
    pub seed: u32,
    pub file: Option<PathBuf>,
    pub features: Vec<Feature>,
}

#[derive(Debug, Clone)]
pub struct Design {
    pub subjects: Vec<Subject>,
    /// Pictures of each way.
    pub replicas: u32,
    /// Paths per pixel.
    pub spp: u32,
}

/// The result of a way in a scene.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Row {
    pub seed: u32,
    pub file: Option<PathBuf>,
    pub features: String,
    pub way: String,
    /// Of the whole picture, over its mean.
    pub difference: f64,
    pub difference_se: f64,
    /// Of the region that differs most: its number, 0 for the whole picture and then blocks row by row.
    pub region: usize,
    pub region_difference: f64,
    pub t: f64,
    /// Was it rendered again? Then the same region's, of more pictures.
    pub again_difference: Option<f64>,
    pub again_t: Option<f64>,
    pub wrong: bool,
    /// The command with the fewest features, of a scene's most wrong way.
    pub command: Option<String>,
}

/// A control of a run, and the number of ways in which it is caught, of those that most scenes have.
#[derive(Debug, Clone, Serialize)]
pub struct Control {
    pub name: String,
    pub caught: usize,
    pub of: usize,
    /// The fewest that must be caught; `None` in runs that are too short.
    pub least: Option<usize>,
}

impl Control {
    pub fn is_caught(&self) -> bool {
        self.least.is_none_or(|least| self.caught >= least)
    }
}

/// A way's mean over all scenes in which it is not wrong.
#[derive(Debug, Clone, Serialize)]
pub struct OfWay {
    pub way: String,
    pub scenes: usize,
    pub rendered_again: usize,
    pub wrong_scenes: usize,
    pub difference: Option<f64>,
    pub difference_se: Option<f64>,
    pub wrong: bool,
}

#[derive(Debug, Clone, Serialize)]
pub struct Results {
    pub replicas: u32,
    pub spp: u32,
    pub scenes: usize,
    /// Chance that a run without a fault finds one, at most.
    pub false_alarm: f64,
    pub ways: Vec<OfWay>,
    pub controls: Vec<Control>,
    pub rows: Vec<Row>,
}

impl Results {
    pub fn wrong(&self) -> impl Iterator<Item = &Row> {
        self.rows.iter().filter(|row| row.wrong)
    }
}

impl Subject {
    fn stage(&self, features: &[Feature], spp: u32) -> Result<Stage> {
        let file = self.file.as_ref().map(|path| Files::open(path)?.import()).transpose()?;
        let [width, height] = SIZE;
        let settings = RenderSettings { width, height, spp: Some(spp), ..RenderSettings::default() };
        Stage::new(Canvas::of(file, features, self.seed, settings))
    }

    /// The command that tests the scene with these features.
    fn command(&self, features: &[Feature]) -> String {
        let file = self.file.as_ref().map(|path| format!(" {}", path.display())).unwrap_or_default();
        format!("bismar study means{file} --seed {} --only {}", self.seed, joined(features))
    }

    /// The seeds of one use.
    fn seeds(&self, usage: u32, n: u32) -> std::ops::Range<u32> {
        let first = (mix(u64::from(self.seed)) as u32 >> 2).wrapping_add(usage << 20);
        first..first + n
    }
}

/// The test of a region.
fn test(stage: &Stage, own: &[Picture], reference: &[Picture], region: usize, level: f64) -> Test {
    let pixels = f64::from(SIZE[0] * SIZE[1]) / if region == 0 { 1.0 } else { (REGIONS - 1) as f64 };
    let of = |picture: &Picture| picture.regions[region];
    Test::new(region, (own, &of), reference, (stage.brightest(), pixels, level))
}

/// The test of the region that differs most.
fn worst(stage: &Stage, own: &[Picture], reference: &[Picture], level: f64) -> Test {
    let tests = (1..REGIONS).map(|region| test(stage, own, reference, region, level));
    tests.fold(test(stage, own, reference, 0, level), |a, b| if b.t().abs() > a.t().abs() { b } else { a })
}

/// Tests all scenes. Calls `done` with the rows of each; `done` may stop the measurement with an error, and must once `stop` is
/// raised.
pub fn measure(design: &Design, stop: &AtomicBool, done: &mut dyn FnMut(&[Row]) -> Result<()>) -> Result<Results> {
    let mut rows = Vec::new();
    let mut together = BTreeMap::<String, AllScenes>::new();
    for subject in &design.subjects {
        let stage = subject.stage(&subject.features, design.spp)?;
        let reference = stage.pictures(&Way::reference(&stage.settings), subject.seeds(0, design.replicas), stop)?;
        let ways = Way::all(&stage, subject.seed);
        let level = FIRST / (ways.len() * REGIONS) as f64;
        let mut tested = Vec::new();
        for way in &ways {
            let own = stage.pictures(way, subject.seeds(1, design.replicas), stop)?;
            let whole = test(&stage, &own, &reference, 0, level);
            tested.push((worst(&stage, &own, &reference, level), whole, own));
        }
        stopped(stop)?;
        let differing: Vec<_> = (0..ways.len()).filter(|i| tested[*i].0.chance() <= level).collect();
        let again = again(subject, &stage, design, &ways, &tested, &differing, stop)?;
        let mut own_rows = Vec::new();
        for (i, (way, (worst, whole, own))) in ways.iter().zip(&tested).enumerate() {
            let again = differing.iter().position(|own| *own == i).map(|at| again[at]);
            let wrong = again.is_some_and(|(_, wrong)| wrong);
            let again = again.map(|(test, _)| test);
            if !wrong {
                let together = together.entry(way.name.clone()).or_default();
                for (together, of) in together.iter_mut().zip(TESTED) {
                    for (region, together) in together.iter_mut().enumerate() {
                        together.add(region, (own, &|picture| of(picture, region)), &reference);
                    }
                }
            }
            own_rows.push(Row {
                seed: subject.seed,
                file: subject.file.clone(),
                features: joined(&subject.features),
                way: way.name.clone(),
                difference: whole.relative(whole.difference),
                difference_se: whole.relative(whole.error),
                region: worst.region,
                region_difference: worst.relative(worst.difference),
                t: worst.t(),
                again_difference: again.map(|test| test.relative(test.difference)),
                again_t: again.map(|test| test.t()),
                wrong,
                command: None,
            });
        }
        let most = own_rows.iter_mut().filter(|row| row.wrong).max_by(|a, b| a.t.abs().total_cmp(&b.t.abs()));
        if let Some(row) = most {
            row.command = Some(subject.command(&smallest(subject, design, row, stop)?));
        }
        done(&own_rows)?;
        rows.append(&mut own_rows);
    }
    Ok(results(design, rows, &together))
}

fn stopped(stop: &AtomicBool) -> Result<()> {
    if stop.load(Ordering::Relaxed) { Err(Error::Interrupted("nothing was written".into())) } else { Ok(()) }
}

/// Renders ways that differ again, with other seeds: the test of the region that differed most, and whether it does so again.
fn again(
    subject: &Subject,
    stage: &Stage,
    design: &Design,
    ways: &[Way],
    tested: &[(Test, Test, Vec<Picture>)],
    differing: &[usize],
    stop: &AtomicBool,
) -> Result<Vec<(Test, bool)>> {
    if differing.is_empty() {
        return Ok(Vec::new());
    }
    let n = MORE * design.replicas;
    let reference = stage.pictures(&Way::reference(&stage.settings), subject.seeds(2, n), stop)?;
    let level = AGAIN / differing.len() as f64;
    let one = |i: &usize| {
        let (own, first) = (stage.pictures(&ways[*i], subject.seeds(3, n), stop)?, &tested[*i].0);
        let again = test(stage, &own, &reference, first.region, level);
        Ok((again, again.t() * first.t() > 0.0 && 0.5 * again.chance() <= level))
    };
    let found = differing.iter().map(one).collect();
    stopped(stop)?;
    found
}

/// The fewest features with which a way differs as it does with all.
fn smallest(subject: &Subject, design: &Design, row: &Row, stop: &AtomicBool) -> Result<Vec<Feature>> {
    let (kept, least) = KEPT;
    let mut usage = 4;
    fewest(&subject.features, |features| {
        stopped(stop)?;
        usage += 2;
        let stage = subject.stage(features, design.spp)?;
        let Some(way) = Way::all(&stage, subject.seed).into_iter().find(|way| way.name == row.way) else {
            return Ok(false);
        };
        let own = stage.pictures(&way, subject.seeds(usage, design.replicas), stop)?;
        let reference = Way::reference(&stage.settings);
        let reference = stage.pictures(&reference, subject.seeds(usage + 1, design.replicas), stop)?;
        let t = worst(&stage, &own, &reference, FIRST / REGIONS as f64).t();
        Ok(t * row.t > 0.0 && t.abs() >= (kept * row.t.abs()).max(least))
    })
}

/// Leaves features out, one after the other, as long as `still` holds without them.
pub fn fewest(features: &[Feature], mut still: impl FnMut(&[Feature]) -> Result<bool>) -> Result<Vec<Feature>> {
    let mut left = features.to_vec();
    loop {
        let before = left.len();
        for i in (0..before).rev() {
            let mut without = left.clone();
            without.remove(i);
            if !without.is_empty() && still(&without)? {
                left = without;
            }
        }
        if left.len() == before {
            return Ok(left);
        }
    }
}

fn results(design: &Design, rows: Vec<Row>, together: &BTreeMap<String, AllScenes>) -> Results {
    let mut names: Vec<&String> = Vec::new();
    for row in &rows {
        if !names.contains(&&row.way) {
            names.push(&row.way);
        }
    }
    let tests = names.len() * REGIONS;
    let is_wrong = |all: &[Together; REGIONS]| all.iter().any(|together| together.is_wrong(tests));
    let of = |way: &&String| {
        let own = || rows.iter().filter(|row| row.way == **way);
        let found = together.get(*way).map(|[pictures, ..]| pictures);
        let difference = found.and_then(|all| all[0].difference());
        OfWay {
            way: way.to_string(),
            scenes: own().count(),
            rendered_again: own().filter(|row| row.again_t.is_some()).count(),
            wrong_scenes: own().filter(|row| row.wrong).count(),
            difference: difference.map(|(mean, _)| mean),
            difference_se: difference.map(|(_, error)| error),
            wrong: found.is_some_and(is_wrong),
        }
    };
    let ways: Vec<_> = names.iter().map(of).collect();
    let scenes = design.subjects.len();
    let often = ways.iter().filter(|way| way.scenes >= CONTROLLED);
    let often: Vec<_> = often.filter_map(|way| together.get(&way.way)).collect();
    let control = |i: usize, name: String| {
        let caught = often.iter().filter(|all| is_wrong(&all[i])).count();
        Control {
            name,
            caught,
            of: often.len(),
            least: (scenes >= CONTROLLED).then_some((LEAST_CAUGHT * often.len() as f64).ceil() as usize),
        }
    };
    let controls = vec![
        control(1, "1 % of the light is removed from all pictures".into()),
        control(2, format!("the brightest of {LOST_OF} paths is lost in a tenth of the pixels")),
    ];
    let false_alarm = judge::TOGETHER + scenes as f64 * FIRST * AGAIN;
    Results { replicas: design.replicas, spp: design.spp, scenes, false_alarm, ways, controls, rows }
}

#[cfg(test)]
mod tests {
    use super::*;
    use features::features;

    #[test]
    fn only_the_features_that_a_fault_needs_are_left() {
        let all = features("room:open,floor:bumps,ball:glass,light:spot,sky:grey").unwrap();
        let needed = features("floor:bumps,light:spot").unwrap();
        let mut tried = 0;
        let left = fewest(&all, |left| {
            tried += 1;
            Ok(needed.iter().all(|feature| left.contains(feature)))
        });
        assert_eq!(left.unwrap(), needed);
        assert!(tried <= 7, "{tried}");
    }
}
