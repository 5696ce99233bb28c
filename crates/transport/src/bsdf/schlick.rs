//! Schlick's approximation of Fresnel's equations.

use crate::lanes::F;

/// Schlick's weight (1 − cos)⁵.
#[inline(always)]
pub(super) fn schlick_weight(cos: F) -> F {
    let x = (F::ONE - cos).fast_max(F::ZERO).fast_min(F::ONE);
    let x2 = x * x;
    x2 * x2 * x
}
