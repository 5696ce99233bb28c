//! `half`, `power` and `max`: one sample of each technique per path, nothing is learned (Veach and Guibas 1995).

use crate::balance::{Heuristic, Method};

/// One light and one BSDF sample per path.
#[derive(Debug)]
pub struct OneOfEach {
    /// The MIS heuristic.
    pub heuristic: Heuristic,
    /// [`Method::name`].
    pub name: &'static str,
    /// [`Method::about`].
    pub about: &'static str,
}

impl Method for OneOfEach {
    fn name(&self) -> &'static str {
        self.name
    }

    fn about(&self) -> &'static str {
        self.about
    }

    fn heuristic(&self) -> Heuristic {
        self.heuristic
    }

    fn learns(&self) -> bool {
        false
    }
}

#[cfg(test)]
mod tests {
    use crate::balance::Balance;
    use crate::balance::methods::passes;

    #[test]
    fn a_higher_goal_begins_with_the_same_passes() {
        let (low, high) = (passes(Balance::Half, 128, None), passes(Balance::Half, 4096, None));
        assert_eq!(low[..], high[..low.len()]);
        assert_eq!(passes(Balance::Half, 5, None), [5]);
        assert!(passes(Balance::Half, 0, None).is_empty());
    }
}
