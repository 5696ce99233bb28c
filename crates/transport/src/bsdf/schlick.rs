//! Schlick's approximation of Fresnel's equations, and what it begins with.

use crate::lanes::F;

/// Schlick's weight (1 − cos)⁵.
#[inline(always)]
pub(super) fn schlick_weight(cos: F) -> F {
    let x = (F::ONE - cos).fast_max(F::ZERO).fast_min(F::ONE);
    let x2 = x * x;
    x2 * x2 * x
}

/// Reflectance at normal incidence of an interface with the relative index of refraction `ratio`.
#[inline(always)]
pub(super) fn normal_incidence(ratio: F) -> F {
    let root = (ratio - F::ONE) / (ratio + F::ONE);
    root * root
}
