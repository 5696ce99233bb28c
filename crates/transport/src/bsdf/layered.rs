//! One lobe over another, or over others: how a model is composed.

use super::{Directions, Draw, Frames, Lobe, Parameters, Response};
use crate::lanes::{F, LANES, Rows, V3, eight};
use crate::sampling::warp::ONE_MINUS;

/// A lobe over those beneath, which get the light that it lets through (all of it, for a lobe beside others). The same
/// struct at every width: of one point, of eight, of a batch. Where the upper lobe is missing it takes no column, and
/// no more time than to see that: of eight points it then is `None`.
#[derive(Debug, Clone, Copy, Default)]
pub struct Layered<Top, Base> {
    /// The lobe.
    pub top: Top,
    /// What is beneath: a lobe that is always there, or layers again.
    pub base: Base,
}

/// Which of a model's lobes there are: a bit each, the uppermost's the lowest.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct LobeSet(u32);

impl LobeSet {
    /// The set of one lobe, or of none.
    #[inline]
    pub fn of_one(there: bool) -> Self {
        Self(u32::from(there))
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
    fn over(self, base: Self) -> Self {
        Self(self.0 | base.0 << 1)
    }

    fn top(self) -> bool {
        self.0 & 1 == 1
    }

    fn base(self) -> Self {
        Self(self.0 >> 1)
    }
}

impl<Top: Parameters, Base: Parameters> Parameters for Layered<Top, Base> {
    type Eight = Layered<Option<Top::Eight>, Base::Eight>;
    type Columns = Layered<Option<Top::Columns>, Base::Columns>;

    #[inline(always)]
    fn gather(points: [&Self; LANES]) -> Self::Eight {
        Layered {
            top: Some(Top::gather(eight(|lane| &points[lane].top))),
            base: Base::gather(eight(|lane| &points[lane].base)),
        }
    }

    fn grow(columns: &mut Self::Columns, most: usize, lobes: LobeSet) {
        if lobes.top() {
            Top::grow(columns.top.get_or_insert_default(), most, lobes);
        } else {
            columns.top = None;
        }
        Base::grow(&mut columns.base, most, lobes.base());
    }

    #[inline(always)]
    fn store(columns: &mut Self::Columns, at: usize, points: [&Self; LANES]) {
        if let Some(top) = &mut columns.top {
            Top::store(top, at, eight(|lane| &points[lane].top));
        }
        Base::store(&mut columns.base, at, eight(|lane| &points[lane].base));
    }

    #[inline(always)]
    fn load(columns: &Self::Columns, rows: &Rows) -> Self::Eight {
        let top = columns.top.as_ref().map(|top| Top::load(top, rows));
        Layered { top, base: Base::load(&columns.base, rows) }
    }
}

impl<Top: Lobe, Base: Lobe> Layered<Option<Top>, Base> {
    /// The upper lobe, if any lane has it.
    #[inline(always)]
    fn top(&self) -> Option<&Top> {
        self.top.as_ref().filter(|top| top.present().any())
    }

    /// Chance of drawing from the upper lobe: its share of the reflected light, as [`Lobe::weight`] has it.
    #[inline(always)]
    fn top_probability(&self, top: &Top, n: V3, wo: V3) -> F {
        let (weight, through) = top.weight(n, wo);
        let sum = weight + self.base.weight(n, wo).0 * through;
        let some = sum.simd_gt(F::ZERO);
        // With nothing visible at this angle, the one that there is.
        let otherwise = top.present() & F::ONE;
        some.select(weight / sum, otherwise)
    }
}

impl<Top: Lobe, Base: Lobe> Lobe for Layered<Option<Top>, Base> {
    #[inline(always)]
    fn present(&self) -> F {
        self.top.as_ref().map_or(F::ZERO, Lobe::present) | self.base.present()
    }

    fn lobes(&self) -> LobeSet {
        self.top.as_ref().map_or(LobeSet::default(), Lobe::lobes).over(self.base.lobes())
    }

    #[inline(always)]
    fn transmits(&self) -> F {
        self.top.as_ref().map_or(F::ZERO, Lobe::transmits) | self.base.transmits()
    }

    #[inline(always)]
    fn diffuseness(&self) -> F {
        self.top.as_ref().map_or(F::ZERO, Lobe::diffuseness) + self.base.diffuseness()
    }

    #[inline(always)]
    fn weight(&self, n: V3, wo: V3) -> (F, F) {
        let (base, rest) = self.base.weight(n, wo);
        let Some(top) = self.top() else { return (base, rest) };
        let (top, through) = top.weight(n, wo);
        (top + base * through, through * rest)
    }

    #[inline(always)]
    fn eval(&self, d: &Directions, light: F) -> Response {
        let Some(lobe) = self.top() else { return self.base.eval(d, light) };
        let top = lobe.eval(d, light);
        let base = self.base.eval(d, top.through);
        let p = self.top_probability(lobe, d.n, d.wo);
        let pdf = p.mul_add(top.pdf, (F::ONE - p) * base.pdf);
        Response { value: top.value + base.value, pdf, through: base.through }
    }

    #[inline(always)]
    fn draw(&self, frames: &Frames, wo: V3, [lobe, u, v]: [F; 3]) -> Draw {
        let Some(upper) = self.top() else { return self.base.draw(frames, wo, [lobe, u, v]) };
        // What is left of the number that chose the lobe chooses among those in it.
        let within = |from: F, size: F| ((lobe - from) / size).fast_max(F::ZERO).fast_min(F::splat(ONE_MINUS));
        let p = self.top_probability(upper, frames.n, wo);
        let base = self.base.draw(frames, wo, [within(p, F::ONE - p), u, v]);
        let from_top = lobe.simd_lt(p);
        if !from_top.any() {
            return base;
        }
        let top = upper.draw(frames, wo, [within(F::ZERO, p), u, v]);
        Draw { wi: V3::select(from_top, top.wi, base.wi), h: V3::select(from_top, top.h, base.h) }
    }
}
