//! Sets of lobes.

/// Which of a model's lobes there are: a bit each, the uppermost's the lowest.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct LobeSet(u32);

impl LobeSet {
    /// The set of one lobe, or of none.
    #[inline]
    pub fn single(present: bool) -> Self {
        Self(u32::from(present))
    }

    /// All that are in either.
    #[must_use]
    pub fn union(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    /// Is none there?
    pub fn is_empty(self) -> bool {
        self.0 == 0
    }

    #[inline]
    pub(super) fn over(self, base: Self) -> Self {
        Self(self.0 | base.0 << 1)
    }

    pub(super) fn top(self) -> bool {
        self.0 & 1 == 1
    }

    pub(super) fn base(self) -> Self {
        Self(self.0 >> 1)
    }
}
