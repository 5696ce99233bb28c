//! SIMD vectors of eight lanes, with which the shading stages compute.

use glam::Vec3;
use wide::bytemuck::cast;
pub use wide::{f32x8 as F, u32x8 as U};

/// Number of lanes of an [`F`].
pub const LANES: usize = 8;

/// The indices of the lanes.
pub const NUMBERS: [u32; LANES] = [0, 1, 2, 3, 4, 5, 6, 7];

#[derive(Debug, Clone, Copy)]
pub struct V3 {
    pub x: F,
    pub y: F,
    pub z: F,
}

/// A column of vectors as three columns of components, padded so that whole packets of lanes can be read and written.
#[derive(Debug, Default, Clone)]
pub struct V3Column {
    columns: [Vec<f32>; 3],
}

/// The elements of a column that the lanes hold.
#[derive(Debug, Clone, Copy)]
pub enum Rows {
    /// [`LANES`] consecutive elements from this index on.
    From(usize),
    /// The elements with these indices.
    Each([u32; LANES]),
}

/// One value per lane. It is always inlined, unlike `array::from_fn` and `map`, whose loops the compiler leaves as calls.
#[inline(always)]
pub fn eight<T>(mut of: impl FnMut(usize) -> T) -> [T; LANES] {
    [of(0), of(1), of(2), of(3), of(4), of(5), of(6), of(7)]
}

/// Reads elements of a column.
#[inline(always)]
pub fn load(column: &[f32], rows: &Rows) -> F {
    match rows {
        Rows::From(at) => {
            let eight: [f32; LANES] = column[*at..*at + LANES].try_into().unwrap_or_default();
            F::from(eight)
        }
        Rows::Each(rows) => F::from(eight(|lane| column[rows[lane] as usize])),
    }
}

/// Writes [`LANES`] elements of a column from `at` on.
#[inline(always)]
pub fn store(column: &mut [f32], at: usize, value: F) {
    column[at..at + LANES].copy_from_slice(value.as_array());
}

/// Reads elements of a column of integers.
#[inline(always)]
pub fn load_bits(column: &[u32], rows: &Rows) -> U {
    match rows {
        Rows::From(at) => {
            let eight: [u32; LANES] = column[*at..*at + LANES].try_into().unwrap_or_default();
            U::from(eight)
        }
        Rows::Each(rows) => U::from(eight(|lane| column[rows[lane] as usize])),
    }
}

/// Writes [`LANES`] elements of a column of integers from `at` on.
#[inline(always)]
pub(crate) fn store_bits(column: &mut [u32], at: usize, value: U) {
    column[at..at + LANES].copy_from_slice(value.as_array());
}

/// Grows a column to at least `len` elements and [`LANES`] more.
pub fn grow<T: Copy + Default>(column: &mut Vec<T>, len: usize) {
    if column.len() < len + LANES {
        column.resize(len + LANES, T::default());
    }
}

/// A permutation that moves the surviving lanes to the front.
#[derive(Debug, Clone, Copy)]
pub struct Survivors {
    order: U,
    /// Number of survivors.
    pub len: usize,
}

/// For each bitmask of eight lanes, the indices of the set lanes.
static ORDERS: [[u32; LANES]; 256] = {
    let mut orders = [[0; LANES]; 256];
    let mut mask = 0;
    while mask < 256 {
        let (mut lane, mut n) = (0, 0);
        while lane < LANES {
            if mask >> lane & 1 == 1 {
                orders[mask][n] = lane as u32;
                n += 1;
            }
            lane += 1;
        }
        mask += 1;
    }
    orders
};

impl Survivors {
    /// The lanes that are set in a mask.
    #[inline(always)]
    pub fn of(mask: F) -> Self {
        let bits = mask.to_bitmask() & 0xff;
        Self { order: U::from(ORDERS[bits as usize]), len: bits.count_ones() as usize }
    }

    /// The survivors' values in the first lanes; the other lanes have no meaning.
    #[inline(always)]
    pub fn compress(&self, value: F) -> F {
        cast(cast::<F, U>(value).shuffle(self.order))
    }

    /// [`compress`](Self::compress) of integers.
    #[inline(always)]
    pub fn compress_bits(&self, value: U) -> U {
        value.shuffle(self.order)
    }

    /// [`compress`](Self::compress) of vectors.
    #[inline(always)]
    pub fn compress_v3(&self, v: V3) -> V3 {
        V3 { x: self.compress(v.x), y: self.compress(v.y), z: self.compress(v.z) }
    }
}

/// Numbers in [0, 1), multiples of 2⁻²³, from the upper bits of integers.
#[inline(always)]
pub fn unit_interval(bits: U) -> F {
    let one_to_two: F = cast((bits >> 9) | U::splat(0x3f80_0000));
    one_to_two - F::ONE
}

/// −1 where the sign bit is set, else 1.
#[inline(always)]
pub fn sign(x: F) -> F {
    (x & F::splat(-0.0)) | F::ONE
}

/// A mask of the lanes that are equal to `value`.
#[inline(always)]
pub fn are(bits: U, value: u32) -> F {
    cast(bits.simd_eq(U::splat(value)))
}

/// A mask of the first `n` lanes.
#[inline(always)]
pub fn mask(n: usize) -> F {
    F::splat(n as f32).simd_gt(F::from([0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0]))
}

impl V3 {
    pub const ZERO: Self = Self { x: F::ZERO, y: F::ZERO, z: F::ZERO };

    /// The same vector in every lane.
    #[inline(always)]
    pub fn splat(v: Vec3) -> Self {
        Self { x: F::splat(v.x), y: F::splat(v.y), z: F::splat(v.z) }
    }

    #[inline(always)]
    pub(crate) fn from_arrays([x, y, z]: [[f32; LANES]; 3]) -> Self {
        Self { x: F::from(x), y: F::from(y), z: F::from(z) }
    }

    /// From one vector per lane.
    #[inline(always)]
    pub fn gather(v: [Vec3; LANES]) -> Self {
        Self {
            x: F::from(eight(|lane| v[lane].x)),
            y: F::from(eight(|lane| v[lane].y)),
            z: F::from(eight(|lane| v[lane].z)),
        }
    }

    /// The vector in lane `i`.
    #[inline(always)]
    pub fn lane(&self, i: usize) -> Vec3 {
        Vec3::new(self.x.as_array()[i], self.y.as_array()[i], self.z.as_array()[i])
    }

    #[inline(always)]
    pub fn dot(self, o: Self) -> F {
        self.x.mul_add(o.x, self.y.mul_add(o.y, self.z * o.z))
    }

    #[inline(always)]
    pub fn cross(self, o: Self) -> Self {
        Self {
            x: self.y.mul_sub(o.z, self.z * o.y),
            y: self.z.mul_sub(o.x, self.x * o.z),
            z: self.x.mul_sub(o.y, self.y * o.x),
        }
    }

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

    #[inline(always)]
    pub fn abs(self) -> Self {
        Self { x: self.x.abs(), y: self.y.abs(), z: self.z.abs() }
    }

    /// The largest component of each vector.
    #[inline(always)]
    pub fn max_element(self) -> F {
        self.x.fast_max(self.y).fast_max(self.z)
    }

    /// A mask of the vectors whose components are all finite.
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

macro_rules! by_component {
    ($operator:ident, $name:ident, $sign:tt) => {
        impl std::ops::$operator for V3 {
            type Output = Self;

            #[inline(always)]
            fn $name(self, o: Self) -> Self {
                Self { x: self.x $sign o.x, y: self.y $sign o.y, z: self.z $sign o.z }
            }
        }
    };
}

by_component!(Add, add, +);
by_component!(Sub, sub, -);
by_component!(Mul, mul, *);

impl std::ops::Mul<F> for V3 {
    type Output = Self;

    #[inline(always)]
    fn mul(self, s: F) -> Self {
        Self { x: self.x * s, y: self.y * s, z: self.z * s }
    }
}

impl V3Column {
    /// Grows to at least `len` vectors and [`LANES`] more.
    pub fn grow(&mut self, len: usize) {
        self.columns.iter_mut().for_each(|column| grow(column, len));
    }

    /// Copies all vectors of another column, into the memory that this one has.
    pub(crate) fn copy_from(&mut self, other: &Self) {
        self.columns.iter_mut().zip(&other.columns).for_each(|(to, from)| to.clone_from(from));
    }

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

    #[inline(always)]
    pub fn set(&mut self, i: usize, v: Vec3) {
        let [x, y, z] = &mut self.columns;
        (x[i], y[i], z[i]) = (v.x, v.y, v.z);
    }

    #[inline(always)]
    pub fn get(&self, i: usize) -> Vec3 {
        let [x, y, z] = &self.columns;
        Vec3::new(x[i], y[i], z[i])
    }
}
