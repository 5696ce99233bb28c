//! Layering: one lobe on top of others.

use super::lobe::{
    DirectionSample, Directions, Frames, Lobe, MAX_LEVELS, Response, Straight, TopProbabilities, is_large,
};
use super::lobe_set::LobeSet;
use super::parameters::Parameters;
use crate::lanes::{F, LANES, Rows, V3, eight};
use crate::sampling::warp::ONE_MINUS_EPSILON;

/// A top lobe over base lobes, which receive the light that it transmits. The struct has the same form for one point, for
/// eight points and for a batch. Batches without the top lobe have no columns for it; its eight-point value is `None`.
#[derive(Debug, Clone, Copy, Default)]
pub struct Layered<Top, Base> {
    pub top: Top,
    /// The layers beneath: a lobe that is always present, or another `Layered`.
    pub base: Base,
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

    fn grow(columns: &mut Self::Columns, capacity: usize, lobes: LobeSet) {
        if lobes.top() {
            Top::grow(columns.top.get_or_insert_default(), capacity, lobes);
        } else {
            columns.top = None;
        }
        Base::grow(&mut columns.base, capacity, lobes.base());
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
    /// The top lobe, if it is present in any lane.
    #[inline(always)]
    fn top(&self) -> Option<&Top> {
        self.top.as_ref().filter(|top| top.present().any())
    }
}

impl<Top: Lobe, Base: Lobe> Lobe for Layered<Option<Top>, Base> {
    const LEVELS: usize = Base::LEVELS + 1;

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
    fn albedos(&self) -> [F; 2] {
        let ([rough, sharp], base) = (self.top.as_ref().map_or([F::ZERO; 2], Lobe::albedos), self.base.albedos());
        [rough + base[0], sharp + base[1]]
    }

    #[inline(always)]
    fn weight(&self, n: V3, wo: V3) -> (F, F) {
        self.weigh(n, wo, &mut [F::ZERO; MAX_LEVELS])
    }

    #[inline(always)]
    fn weigh(&self, n: V3, wo: V3, probabilities: &mut TopProbabilities) -> (F, F) {
        let (base, rest) = self.base.weigh(n, wo, probabilities);
        let Some(top) = self.top() else { return (base, rest) };
        let (weight, transmittance) = top.weight(n, wo);
        let sum = weight + base * transmittance;
        // If no lobe scatters toward wo, choose the one that is present.
        let otherwise = top.present() & F::ONE;
        probabilities[Base::LEVELS] = sum.simd_gt(F::ZERO).select(weight / sum, otherwise);
        (sum, transmittance * rest)
    }

    #[inline(always)]
    fn straight(&self, n: V3, wo: V3, light: F, bodies: bool) -> Straight {
        // Not to ask again after the base whether there is a top lobe: the compiler would copy the base for both answers.
        let absent = Straight { weight: V3::ZERO, transmittance: light };
        let top = self.top().map_or(absent, |top| top.straight(n, wo, light, bodies));
        let base = self.base.straight(n, wo, top.transmittance, bodies);
        Straight { weight: top.weight + base.weight, transmittance: base.transmittance }
    }

    #[inline(always)]
    fn eval(&self, d: &Directions, light: F) -> Response {
        let Some(top) = self.top() else { return eval_base(&self.base, d, light) };
        let top = top.eval(d, light);
        let base = eval_base(&self.base, d, top.transmittance);
        let p = d.top[Base::LEVELS];
        let pdf = p.mul_add(top.pdf, (F::ONE - p) * base.pdf);
        Response { value: top.value + base.value, pdf, transmittance: base.transmittance }
    }

    #[inline(always)]
    fn sample_direction(
        &self,
        frames: &Frames,
        wo: V3,
        numbers: [F; 3],
        probabilities: &TopProbabilities,
    ) -> DirectionSample {
        let Some(top) = self.top() else { return sample_base(&self.base, frames, wo, numbers, probabilities) };
        // Reuse the number: rescaled to [0, 1), it chooses among the parts of the chosen lobe.
        let ([lobe, u, v], p) = (numbers, probabilities[Base::LEVELS]);
        let within = |from: F, size: F| ((lobe - from) / size).fast_max(F::ZERO).fast_min(F::splat(ONE_MINUS_EPSILON));
        let base = sample_base(&self.base, frames, wo, [within(p, F::ONE - p), u, v], probabilities);
        let from_top = lobe.simd_lt(p);
        if !from_top.any() {
            return base;
        }
        let top = top.sample_direction(frames, wo, [within(F::ZERO, p), u, v], probabilities);
        DirectionSample { wi: V3::select(from_top, top.wi, base.wi), h: V3::select(from_top, top.h, base.h) }
    }
}

/// [`Lobe::eval`] of the layers beneath: a call if they are several, since both callers of it at each level of a stack would
/// inline them.
#[inline(always)]
fn eval_base<Base: Lobe>(base: &Base, d: &Directions, light: F) -> Response {
    #[inline(never)]
    fn call(base: &impl Lobe, d: &Directions, light: F) -> Response {
        base.eval(d, light)
    }
    if is_large::<Base>() { call(base, d, light) } else { base.eval(d, light) }
}

/// [`Lobe::sample_direction`] of the layers beneath, as [`eval_base`].
#[inline(always)]
fn sample_base<Base: Lobe>(
    base: &Base,
    frames: &Frames,
    wo: V3,
    numbers: [F; 3],
    probabilities: &TopProbabilities,
) -> DirectionSample {
    #[inline(never)]
    fn call(base: &impl Lobe, frames: &Frames, wo: V3, numbers: [F; 3], top: &TopProbabilities) -> DirectionSample {
        base.sample_direction(frames, wo, numbers, top)
    }
    match is_large::<Base>() {
        true => call(base, frames, wo, numbers, probabilities),
        false => base.sample_direction(frames, wo, numbers, probabilities),
    }
}
