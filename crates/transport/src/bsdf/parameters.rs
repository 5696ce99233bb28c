//! Lobe parameters, declared once for three layouts: one point, eight points, a batch.

use std::fmt::Debug;

use glam::Vec3;

use super::lobe_set::LobeSet;
use crate::lanes::{F, LANES, Rows, V3, V3Column, eight, grow, load, store};

/// The layout of a set of parameters: for how many points.
pub trait Width: Debug + Copy + Default {
    type Scalar: Debug;
    /// Type of a colour or vector.
    type Vector: Debug;
}

/// One point: what material evaluation produces.
#[derive(Debug, Clone, Copy, Default)]
pub struct One;

/// Eight points in SIMD lanes: what lobes compute with.
#[derive(Debug, Clone, Copy, Default)]
pub struct Eight;

/// The points of a batch as structure of arrays: what is stored between stages.
#[derive(Debug, Clone, Copy, Default)]
pub struct Columns;

impl Width for One {
    type Scalar = f32;
    type Vector = Vec3;
}

impl Width for Eight {
    type Scalar = F;
    type Vector = V3;
}

impl Width for Columns {
    type Scalar = Vec<f32>;
    type Vector = V3Column;
}

/// Parameters of one point, and their conversion to eight points and to a batch.
pub trait Parameters: Debug + Copy + Default {
    /// Parameters of eight points.
    type Eight: Debug + Copy;
    /// Parameters of a batch.
    type Columns: Debug + Default;

    /// Packs eight points into lanes.
    fn gather(points: [&Self; LANES]) -> Self::Eight;

    /// Makes room for `capacity` points that have no other lobes than `lobes`.
    fn grow(columns: &mut Self::Columns, capacity: usize, lobes: LobeSet);

    /// Writes eight points to the rows from `at` on.
    fn store(columns: &mut Self::Columns, at: usize, points: [&Self; LANES]);

    fn load(columns: &Self::Columns, rows: &Rows) -> Self::Eight;
}

impl Parameters for f32 {
    type Eight = F;
    type Columns = Vec<f32>;

    #[inline(always)]
    fn gather(points: [&Self; LANES]) -> F {
        F::from(eight(|lane| *points[lane]))
    }

    fn grow(columns: &mut Vec<f32>, capacity: usize, _: LobeSet) {
        grow(columns, capacity);
    }

    #[inline(always)]
    fn store(columns: &mut Vec<f32>, at: usize, points: [&Self; LANES]) {
        store(columns, at, Self::gather(points));
    }

    #[inline(always)]
    fn load(columns: &Vec<f32>, rows: &Rows) -> F {
        load(columns, rows)
    }
}

impl Parameters for Vec3 {
    type Eight = V3;
    type Columns = V3Column;

    #[inline(always)]
    fn gather(points: [&Self; LANES]) -> V3 {
        V3::gather(eight(|lane| *points[lane]))
    }

    fn grow(columns: &mut V3Column, capacity: usize, _: LobeSet) {
        columns.grow(capacity);
    }

    #[inline(always)]
    fn store(columns: &mut V3Column, at: usize, points: [&Self; LANES]) {
        columns.store(at, Self::gather(points));
    }

    #[inline(always)]
    fn load(columns: &V3Column, rows: &Rows) -> V3 {
        columns.load(rows)
    }
}

/// Declares a lobe: a struct generic in its [`Width`], whose fields are each a `Scalar` or a `Vector`.
macro_rules! lobe {
    ($(#[$doc:meta])* $name:ident { $($(#[$about:meta])* $field:ident: $kind:ident,)+ }) => {
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, Default)]
        pub struct $name<W: $crate::bsdf::parameters::Width = $crate::bsdf::parameters::One> {
            $($(#[$about])* pub $field: W::$kind,)+
        }

        const _: () = {
            use $crate::bsdf::lobe_set::LobeSet;
            use $crate::bsdf::parameters::{Columns, Eight, One, Parameters, Width};
            use $crate::lanes::{LANES, Rows, eight};

            impl Parameters for $name<One> {
                type Eight = $name<Eight>;
                type Columns = $name<Columns>;

                #[inline(always)]
                fn gather(points: [&Self; LANES]) -> Self::Eight {
                    $name { $($field: Parameters::gather(eight(|lane| &points[lane].$field)),)+ }
                }

                fn grow(columns: &mut Self::Columns, capacity: usize, lobes: LobeSet) {
                    $(<One as Width>::$kind::grow(&mut columns.$field, capacity, lobes);)+
                }

                #[inline(always)]
                fn store(columns: &mut Self::Columns, at: usize, points: [&Self; LANES]) {
                    $(Parameters::store(&mut columns.$field, at, eight(|lane| &points[lane].$field));)+
                }

                #[inline(always)]
                fn load(columns: &Self::Columns, rows: &Rows) -> Self::Eight {
                    $name { $($field: <One as Width>::$kind::load(&columns.$field, rows),)+ }
                }
            }
        };
    };
}
pub(super) use lobe;
