//! Keys of measurements: a cell for each estimator and sample count.

use bismar::balance::Balance;

use super::{CONTROL, Design, Estimator, HALF};

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum What {
    /// An estimator's picture: all its passes, combined.
    Picture(Estimator),
    /// `half` with other seeds.
    Control,
    /// The shares that a learning balance found before its last pass, used for the whole of another render.
    Found(Balance),
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
            What::Found(balance) => format!("{}-{spp}-found.cell", Estimator::Method(balance).name()),
            What::Reference => format!("reference-{spp}.cell"),
        }
    }

    /// Paths a pixel of one replica, over all the renders that it takes.
    pub fn work(self) -> f64 {
        let before = match self.what {
            What::Found(balance) => last_pass(balance, self.spp).1,
            _ => 0,
        };
        f64::from(self.spp + before)
    }
}

/// Everything that a design asks of a scene, but for the reference.
pub fn keys(design: &Design) -> Vec<Key> {
    let mut keys = Vec::new();
    let most = design.spp.last().copied();
    for &spp in &design.spp {
        let others = design.estimators.iter().filter(|e| **e != HALF).map(|e| What::Picture(*e));
        let control = (!design.whole).then_some(What::Control);
        for what in [What::Picture(HALF)].into_iter().chain(control).chain(others) {
            keys.push(Key { what, spp });
        }
        // The shares found are judged where they are best known.
        for estimator in design.estimators.iter().filter(|_| Some(spp) == most && !design.whole) {
            if let Estimator::Method(balance) = *estimator
                && balance.method().learns()
            {
                keys.push(Key { what: What::Found(balance), spp });
            }
        }
    }
    keys
}

/// Number of passes before the last one, and their paths.
pub fn last_pass(balance: Balance, spp: u32) -> (u32, u32) {
    let (mut passes, mut done) = (0, 0);
    while let Some(n) = balance.method().next_pass(done, Some(spp), None).filter(|&n| n > 0) {
        if done + n >= spp {
            break;
        }
        (passes, done) = (passes + 1, done + n);
    }
    (passes, done)
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use super::*;

    #[test]
    fn the_last_pass_begins_where_the_schedule_says() {
        assert_eq!(last_pass(Balance::SecondOrder, 64), (1, 32));
        assert_eq!(last_pass(Balance::SecondOrder, 1), (0, 0));
    }

    #[test]
    fn a_plan_measures_half_its_control_and_what_was_found() {
        let design = Design {
            folder: PathBuf::new(),
            estimators: vec![Estimator::Method(Balance::SecondOrder), Estimator::Oracle],
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
        let expected = "half-4.cell half-again-4.cell second-order-4.cell oracle-4.cell half-16.cell half-again-16.cell \
                        second-order-16.cell oracle-16.cell second-order-16-found.cell";
        assert_eq!(names.join(" "), expected);
        let estimators = ["half", "half+guiding", "progressive"].into_iter().filter_map(Estimator::named).collect();
        let names = keys(&Design { estimators, whole: true, ..design }).into_iter().map(Key::file_name);
        let expected = "half-4.cell half+guiding-4.cell progressive-4.cell half-16.cell half+guiding-16.cell \
                        progressive-16.cell";
        assert_eq!(names.collect::<Vec<_>>().join(" "), expected);
    }
}
