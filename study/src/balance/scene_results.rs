//! The results of a scene, as the page shows them.

use super::key::What;
use super::measure::Measured;
use super::portrait::Portrait;
use super::table::{Level, Outcome};
use super::{Estimator, HALF};

pub struct SceneResults {
    pub name: String,
    pub levels: Vec<Level>,
    /// The reference, three numbers a pixel.
    pub reference: Vec<f64>,
    /// One replica by `half` and one by the balance shown, with the most samples.
    pub examples: [Vec<f32>; 2],
    /// Pictures of the whole view.
    pub portrait: Portrait,
}

impl SceneResults {
    /// Collects the results of a scene.
    pub fn new(name: &str, levels: Vec<Level>, measured: &Measured, portrait: Portrait) -> Self {
        let most = levels.last().map_or(0, |l| l.spp);
        let example = |estimator| {
            let cell = measured.get(What::Picture(estimator), most);
            cell.map_or(Vec::new(), |c| c.picture(0).to_vec())
        };
        let examples = [example(HALF), example(Estimator::Method(portrait.shown))];
        Self { name: name.to_owned(), levels, reference: measured.reference.mean(), examples, portrait }
    }

    pub(super) fn top(&self) -> Option<&Level> {
        self.levels.last()
    }

    pub(super) fn outcome(&self, estimator: Estimator) -> Option<&Outcome> {
        self.top()?.results.iter().find(|o| o.estimator == Some(estimator))
    }
}
