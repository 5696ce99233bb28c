//! Lobes' parameters, declared once: of one point, of eight, of a batch.

use std::fmt::Debug;

use glam::Vec3;

use super::LobeSet;
use crate::lanes::{F, LANES, Rows, V3, V3Column, eight, grow, load, store};

/// Of how many points a set of parameters is.
pub trait Width: Debug + Copy + Default {
    /// Numbers.
    type Scalar: Debug;
    /// Colours and vectors.
    type Vector: Debug;
}

/// One point: what materials make.
#[derive(Debug, Clone, Copy, Default)]
pub struct One;

/// Eight points: what is evaluated.
#[derive(Debug, Clone, Copy, Default)]
pub struct Eight;

/// A batch's points, as structure of arrays: what is kept.
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

/// The parameters of one point, and how they become those of eight and of a batch.
pub trait Parameters: Debug + Copy + Default {
    /// Of eight points.
    type Eight: Debug + Copy;
    /// Of a batch.
    type Columns: Debug + Default;

    /// A point a lane.
    fn gather(points: [&Self; LANES]) -> Self::Eight;

    /// Makes room for `most` points at which there are no lobes but those in `lobes`.
    fn grow(columns: &mut Self::Columns, most: usize, lobes: LobeSet);

    /// Writes eight points from row `at` on.
    fn store(columns: &mut Self::Columns, at: usize, points: [&Self; LANES]);

    /// Reads.
    fn load(columns: &Self::Columns, rows: &Rows) -> Self::Eight;
}

impl Parameters for f32 {
    type Eight = F;
    type Columns = Vec<f32>;

    #[inline(always)]
    fn gather(points: [&Self; LANES]) -> F {
        F::from(eight(|lane| *points[lane]))
    }

    fn grow(columns: &mut Vec<f32>, most: usize, _: LobeSet) {
        grow(columns, most);
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

    fn grow(columns: &mut V3Column, most: usize, _: LobeSet) {
        columns.grow(most);
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

/// Declares a lobe by its parameters, each a `Scalar` or a `Vector`: a struct generic in its [`Width`].
macro_rules! lobe {
    ($(#[$doc:meta])* $name:ident { $($(#[$about:meta])* $field:ident: $kind:ident,)+ }) => {
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, Default)]
        pub struct $name<W: $crate::bsdf::Width = $crate::bsdf::One> {
            $($(#[$about])* pub $field: W::$kind,)+
        }

        const _: () = {
            use $crate::bsdf::{Columns, Eight, LobeSet, One, Parameters, Width};
            use $crate::lanes::{LANES, Rows, eight};

            impl Parameters for $name<One> {
                type Eight = $name<Eight>;
                type Columns = $name<Columns>;

                #[inline(always)]
                fn gather(points: [&Self; LANES]) -> Self::Eight {
                    $name { $($field: Parameters::gather(eight(|lane| &points[lane].$field)),)+ }
                }

                fn grow(columns: &mut Self::Columns, most: usize, lobes: LobeSet) {
                    $(<One as Width>::$kind::grow(&mut columns.$field, most, lobes);)+
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
