//! Keys of measurements: a cell for each estimator and sample count.

use super::{CONTROL, Design, Estimator, HALF};

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum What {
    /// An estimator's picture: all its passes, combined.
    Picture(Estimator),
    /// `half` with other seeds.
    Control,
    Reference,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Key {
    pub what: What,
    pub spp: u32,
}

impl Key {
    pub fn file_name(self) -> String {
        let spp = self.spp;
        match self.what {
            What::Picture(estimator) => format!("{}-{spp}.cell", estimator.name()),
            What::Control => format!("{CONTROL}-{spp}.cell"),
            What::Reference => format!("reference-{spp}.cell"),
        }
    }
}

/// Everything that a design asks of a scene, but for the reference.
pub fn keys(design: &Design) -> Vec<Key> {
    let mut keys = Vec::new();
    for &spp in &design.spp {
        let others = design.estimators.iter().filter(|e| **e != HALF).map(|e| What::Picture(*e));
        let control = (!design.whole).then_some(What::Control);
        for what in [What::Picture(HALF)].into_iter().chain(control).chain(others) {
            keys.push(Key { what, spp });
        }
    }
    keys
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use bismar::balance::Balance;

    use super::*;

    #[test]
    fn a_plan_measures_half_and_its_control() {
        let design = Design {
            folder: PathBuf::new(),
            estimators: vec![Estimator::Method(Balance::SecondOrder)],
            spp: vec![4, 16],
            replicas: 4,
            reference_spp: 64,
            integrator: bismar::render::Integrator::Direct,
            width: 8,
            height: 8,
            footprint: None,
            whole: false,
        };
        let names = keys(&design).into_iter().map(Key::file_name).collect::<Vec<_>>();
        let expected =
            "half-4.cell half-again-4.cell second-order-4.cell half-16.cell half-again-16.cell second-order-16.cell";
        assert_eq!(names.join(" "), expected);
        let estimators = ["half", "half+guiding", "progressive"].into_iter().filter_map(Estimator::named).collect();
        let names = keys(&Design { estimators, whole: true, ..design }).into_iter().map(Key::file_name);
        let expected = "half-4.cell half+guiding-4.cell progressive-4.cell half-16.cell half+guiding-16.cell \
                        progressive-16.cell";
        assert_eq!(names.collect::<Vec<_>>().join(" "), expected);
    }
}
