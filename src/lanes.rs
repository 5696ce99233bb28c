//! Eight numbers at a time: what the shading stages compute with.

use glam::Vec3;
pub use wide::f32x8 as F;
use wide::{CmpGt, Select};

/// Lanes of an [`F`].
pub const LANES: usize = 8;

/// Eight three-vectors.
#[derive(Debug, Clone, Copy)]
pub struct V3 {
    /// First components.
    pub x: F,
    /// Second components.
    pub y: F,
    /// Third components.
    pub z: F,
}

/// Three columns of numbers, x, y and z of vectors, padded so that whole groups of lanes can be read and written.
#[derive(Debug, Default, Clone)]
pub struct V3Column {
    columns: [Vec<f32>; 3],
}

/// Which elements of columns the lanes stand for.
#[derive(Debug, Clone, Copy)]
pub enum Rows {
    /// [`LANES`] elements from here on.
    From(usize),
    /// These elements.
    Each([u32; LANES]),
}

/// Reads a column.
#[inline(always)]
pub fn load(column: &[f32], rows: &Rows) -> F {
    match rows {
        Rows::From(at) => {
            let eight: [f32; LANES] = column[*at..*at + LANES].try_into().unwrap_or_default();
            F::from(eight)
        }
        Rows::Each(rows) => F::from(rows.map(|row| column[row as usize])),
    }
}

/// Writes [`LANES`] elements of a column from `at` on.
#[inline(always)]
pub fn store(column: &mut [f32], at: usize, value: F) {
    column[at..at + LANES].copy_from_slice(value.as_array());
}

/// Makes room for at least `len` numbers, padded so that the last group of lanes is whole.
pub fn grow(column: &mut Vec<f32>, len: usize) {
    let padded = len.div_ceil(LANES) * LANES;
    if column.len() < padded {
        column.resize(padded, 0.0);
    }
}

/// Lanes below `n`, as a mask.
#[inline(always)]
pub fn first(n: usize) -> F {
    F::splat(n as f32).simd_gt(F::from([0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0]))
}

impl V3 {
    /// The same vector in every lane.
    #[inline(always)]
    pub fn splat(v: Vec3) -> Self {
        Self { x: F::splat(v.x), y: F::splat(v.y), z: F::splat(v.z) }
    }

    /// From arrays of components.
    #[inline(always)]
    pub fn from_arrays([x, y, z]: [[f32; LANES]; 3]) -> Self {
        Self { x: F::from(x), y: F::from(y), z: F::from(z) }
    }

    /// One lane.
    #[inline(always)]
    pub fn lane(&self, i: usize) -> Vec3 {
        Vec3::new(self.x.as_array()[i], self.y.as_array()[i], self.z.as_array()[i])
    }

    /// Dot products.
    #[inline(always)]
    pub fn dot(self, o: Self) -> F {
        self.x.mul_add(o.x, self.y.mul_add(o.y, self.z * o.z))
    }

    /// Cross products.
    #[inline(always)]
    pub fn cross(self, o: Self) -> Self {
        Self {
            x: self.y.mul_sub(o.z, self.z * o.y),
            y: self.z.mul_sub(o.x, self.x * o.z),
            z: self.x.mul_sub(o.y, self.y * o.x),
        }
    }

    /// Squared lengths.
    #[inline(always)]
    pub fn length_squared(self) -> F {
        self.dot(self)
    }

    /// Unit vectors; `fallback` where the length is zero or not finite.
    #[inline(always)]
    pub fn normalize_or(self, fallback: Self) -> Self {
        let length2 = self.length_squared();
        let good = length2.simd_gt(F::ZERO) & length2.is_finite();
        Self::select(good, self * (F::ONE / length2.sqrt()), fallback)
    }

    /// `a` where the mask is set, `b` elsewhere.
    #[inline(always)]
    pub fn select(mask: F, a: Self, b: Self) -> Self {
        Self { x: mask.select(a.x, b.x), y: mask.select(a.y, b.y), z: mask.select(a.z, b.z) }
    }

    /// Largest component of each.
    #[inline(always)]
    pub fn max_element(self) -> F {
        self.x.fast_max(self.y).fast_max(self.z)
    }

    /// Are all components finite? A mask.
    #[inline(always)]
    pub fn is_finite(self) -> F {
        (self.x + self.y + self.z).is_finite()
    }

    /// Relative luminance of linear Rec. 709 RGB.
    #[inline(always)]
    pub fn luminance(self) -> F {
        self.dot(Self { x: F::splat(0.2126), y: F::splat(0.7152), z: F::splat(0.0722) })
    }
}

impl std::ops::Add for V3 {
    type Output = Self;

    #[inline(always)]
    fn add(self, o: Self) -> Self {
        Self { x: self.x + o.x, y: self.y + o.y, z: self.z + o.z }
    }
}

impl std::ops::Sub for V3 {
    type Output = Self;

    #[inline(always)]
    fn sub(self, o: Self) -> Self {
        Self { x: self.x - o.x, y: self.y - o.y, z: self.z - o.z }
    }
}

impl std::ops::Mul for V3 {
    type Output = Self;

    #[inline(always)]
    fn mul(self, o: Self) -> Self {
        Self { x: self.x * o.x, y: self.y * o.y, z: self.z * o.z }
    }
}

impl std::ops::Mul<F> for V3 {
    type Output = Self;

    #[inline(always)]
    fn mul(self, s: F) -> Self {
        Self { x: self.x * s, y: self.y * s, z: self.z * s }
    }
}

impl V3Column {
    /// Makes room for at least `len` vectors, padded.
    pub fn grow(&mut self, len: usize) {
        self.columns.iter_mut().for_each(|column| grow(column, len));
    }

    /// Reads.
    #[inline(always)]
    pub fn load(&self, rows: &Rows) -> V3 {
        let [x, y, z] = &self.columns;
        V3 { x: load(x, rows), y: load(y, rows), z: load(z, rows) }
    }

    /// Writes [`LANES`] vectors from `at` on.
    #[inline(always)]
    pub fn store(&mut self, at: usize, v: V3) {
        let [x, y, z] = &mut self.columns;
        store(x, at, v.x);
        store(y, at, v.y);
        store(z, at, v.z);
    }

    /// One vector.
    #[inline(always)]
    pub fn get(&self, i: usize) -> Vec3 {
        let [x, y, z] = &self.columns;
        Vec3::new(x[i], y[i], z[i])
    }
}
