//! Sets of lobes.

/// A subset of the lobes of a stack: one bit each, the lowest for the top lobe.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct LobeSet(u32);

impl LobeSet {
    /// The set of a single lobe if it is `present`, else the empty set.
    #[inline]
    pub fn single(present: bool) -> Self {
        Self(u32::from(present))
    }

    #[must_use]
    pub(crate) fn union(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

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
