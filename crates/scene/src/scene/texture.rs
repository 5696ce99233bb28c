//! Pictures, samplers and texture lookup.

use std::ops::{Add, Mul, Sub};
use std::sync::LazyLock;

use glam::{Vec2, Vec3, Vec4};

use super::material::Encoding;

/// Treatment of coordinates outside [0, 1].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Wrap {
    ClampToEdge,
    /// Repeat, with every second copy mirrored.
    MirroredRepeat,
    Repeat,
}

/// Magnification filter; minification is by supersampling.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Filter {
    /// The texel that contains the point.
    Nearest,
    /// Bilinear.
    Linear,
}

/// Stored texels, row-major from the top.
#[derive(Debug, Clone)]
pub enum Texels {
    Rgb8(Vec<[u8; 3]>),
    Rgba8(Vec<[u8; 4]>),
    Rgba16(Vec<[u16; 4]>),
}

impl Default for Texels {
    fn default() -> Self {
        Self::Rgb8(Vec::new())
    }
}

#[derive(Debug, Clone, Default)]
pub struct Image {
    /// Name or URI, for messages.
    pub name: String,
    /// Width in texels, ≥ 1.
    pub width: u32,
    /// Height in texels, ≥ 1.
    pub height: u32,
    /// `width * height` texels.
    pub texels: Texels,
    /// BLAKE3 of its encoded bytes, hexadecimal; empty for a picture that was not imported.
    pub hash: String,
}

/// A picture with a sampler.
#[derive(Debug, Clone, PartialEq)]
pub struct Texture {
    /// Index into [`Scene::images`](super::Scene::images).
    pub image: u32,
    /// Wrap mode along u.
    pub wrap_s: Wrap,
    /// Wrap mode along v.
    pub wrap_t: Wrap,
    pub filter: Filter,
}

/// Linear value of every 8-bit sRGB code, after IEC 61966-2-1.
static SRGB: LazyLock<[f32; 256]> = LazyLock::new(|| std::array::from_fn(|code| decode_srgb(code as f32 / 255.0)));

fn decode_srgb(x: f32) -> f32 {
    if x <= 0.04045 { x / 12.92 } else { ((x + 0.055) / 1.055).powf(2.4) }
}

impl Texels {
    /// Linear RGBA of one texel.
    fn rgba(&self, index: usize, encoding: Encoding) -> Vec4 {
        let byte = |x: u8| f32::from(x) / 255.0;
        let word = |x: u16| f32::from(x) / 65535.0;
        match (self, encoding) {
            (Texels::Rgb8(t), Encoding::Linear) => Vec3::from(t[index].map(byte)).extend(1.0),
            (Texels::Rgba8(t), Encoding::Linear) => Vec4::from(t[index].map(byte)),
            (Texels::Rgba16(t), Encoding::Linear) => Vec4::from(t[index].map(word)),
            (Texels::Rgb8(t), Encoding::Srgb) => Vec3::from(t[index].map(|x| SRGB[usize::from(x)])).extend(1.0),
            (Texels::Rgba8(t), Encoding::Srgb) => {
                let [r, g, b, a] = t[index];
                Vec3::from([r, g, b].map(|x| SRGB[usize::from(x)])).extend(byte(a))
            }
            (Texels::Rgba16(t), Encoding::Srgb) => {
                let [r, g, b, a] = t[index].map(word);
                Vec3::from([r, g, b].map(decode_srgb)).extend(a)
            }
        }
    }

    fn alpha(&self, index: usize) -> f32 {
        match self {
            Texels::Rgb8(_) => 1.0,
            Texels::Rgba8(t) => f32::from(t[index][3]) / 255.0,
            Texels::Rgba16(t) => f32::from(t[index][3]) / 65535.0,
        }
    }

    /// Is any texel's alpha below `limit`?
    pub(super) fn has_alpha_below(&self, limit: f32) -> bool {
        self.any_alpha(|alpha| alpha < limit)
    }

    /// Is there a texel with such an alpha?
    pub(super) fn any_alpha(&self, such: impl Fn(f32) -> bool) -> bool {
        match self {
            Texels::Rgb8(_) => such(1.0),
            Texels::Rgba8(t) => (0..t.len()).any(|i| such(self.alpha(i))),
            Texels::Rgba16(t) => (0..t.len()).any(|i| such(self.alpha(i))),
        }
    }
}

impl Wrap {
    /// Brings a coordinate into [0, 1].
    fn fold(self, x: f32) -> f32 {
        match self {
            Wrap::ClampToEdge => x.clamp(0.0, 1.0),
            Wrap::Repeat => x - x.floor(),
            Wrap::MirroredRepeat => {
                let period = x - 2.0 * (0.5 * x).floor();
                if period > 1.0 { 2.0 - period } else { period }
            }
        }
    }

    /// The two texels around a folded coordinate, and the weight of the second.
    fn neighbours(self, x: f32, size: u32) -> (u32, u32, f32) {
        let last = size - 1;
        let centred = x * size as f32 - 0.5;
        let floor = centred.floor();
        let low = floor as i32;
        // Within half a texel of an edge: the texel at the opposite edge if repeated, else the edge's own.
        let (before, after) = if self == Wrap::Repeat { (last, 0) } else { (0, last) };
        let first = if low < 0 { before } else { (low as u32).min(last) };
        let second = if low + 1 > last as i32 { after } else { (low + 1) as u32 };
        (first, second, centred - floor)
    }
}

/// The texel that a folded coordinate lies in.
fn nearest(x: f32, size: u32) -> u32 {
    ((x * size as f32) as u32).min(size - 1)
}

impl Texture {
    /// Linear RGBA of the texture's `image`. Non-finite coordinates read texel (0, 0).
    #[inline]
    pub(super) fn rgba(&self, image: &Image, uv: Vec2, encoding: Encoding) -> Vec4 {
        self.filter(image, uv, |texels, index| texels.rgba(index, encoding))
    }

    /// Alpha of [`Self::rgba`].
    pub(super) fn alpha(&self, image: &Image, uv: Vec2) -> f32 {
        self.filter(image, uv, Texels::alpha)
    }

    fn filter<T>(&self, image: &Image, uv: Vec2, texel: impl Fn(&Texels, usize) -> T) -> T
    where
        T: Copy + Mul<f32, Output = T> + Add<Output = T> + Sub<Output = T>,
    {
        let &Self { wrap_s, wrap_t, filter, .. } = self;
        let &Image { width, height, ref texels, .. } = image;
        if !uv.is_finite() {
            return texel(texels, 0);
        }
        let at = |x: u32, y: u32| texel(texels, y as usize * width as usize + x as usize);
        let (u, v) = (wrap_s.fold(uv.x), wrap_t.fold(uv.y));
        if filter == Filter::Nearest {
            return at(nearest(u, width), nearest(v, height));
        }
        let (x0, x1, fx) = wrap_s.neighbours(u, width);
        let (y0, y1, fy) = wrap_t.neighbours(v, height);
        // This form is exact between equal texels, so that opaque texels stay opaque.
        let mix = |a: T, b: T, f: f32| a + (b - a) * f;
        mix(mix(at(x0, y0), at(x1, y0), fx), mix(at(x0, y1), at(x1, y1), fx), fy)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use glam::Affine2;

    use super::*;
    use crate::scene::{Scene, TextureRef};

    /// A 2x2 picture: red and green above, blue and white (alpha 0) below.
    fn scene(wrap: Wrap, filter: Filter) -> Scene {
        let texels = Texels::Rgba8(vec![[255, 0, 0, 255], [0, 255, 0, 255], [0, 0, 255, 255], [255, 255, 255, 0]]);
        Scene {
            images: vec![Image { name: "test".into(), width: 2, height: 2, texels, ..Default::default() }.into()],
            textures: vec![Texture { image: 0, wrap_s: wrap, wrap_t: wrap, filter }],
            ..Default::default()
        }
    }

    fn plain() -> TextureRef {
        TextureRef { texture: 0, set: 0, transform: None, encoding: Encoding::Linear }
    }

    fn sample(wrap: Wrap, filter: Filter, u: f32, v: f32) -> [f32; 4] {
        scene(wrap, filter).sample_texture(&plain(), Vec2::new(u, v)).to_array()
    }

    const RED: [f32; 4] = [1.0, 0.0, 0.0, 1.0];
    const GREEN: [f32; 4] = [0.0, 1.0, 0.0, 1.0];
    const BLUE: [f32; 4] = [0.0, 0.0, 1.0, 1.0];
    const HOLE: [f32; 4] = [1.0, 1.0, 1.0, 0.0];

    #[test]
    fn texel_centres_read_the_texels_and_v_runs_down() {
        for filter in [Filter::Nearest, Filter::Linear] {
            for wrap in [Wrap::Repeat, Wrap::MirroredRepeat, Wrap::ClampToEdge] {
                assert_eq!(sample(wrap, filter, 0.25, 0.25), RED);
                assert_eq!(sample(wrap, filter, 0.75, 0.25), GREEN);
                assert_eq!(sample(wrap, filter, 0.25, 0.75), BLUE);
                assert_eq!(sample(wrap, filter, 0.75, 0.75), HOLE);
            }
        }
    }

    #[test]
    fn the_middle_is_the_mean_of_all_four() {
        assert_eq!(sample(Wrap::Repeat, Filter::Linear, 0.5, 0.5), [0.5, 0.5, 0.5, 0.75]);
    }

    #[test]
    fn edges_blend_with_the_other_side_only_when_repeated() {
        assert_eq!(sample(Wrap::Repeat, Filter::Linear, 0.0, 0.25), [0.5, 0.5, 0.0, 1.0]);
        assert_eq!(sample(Wrap::Repeat, Filter::Linear, 1.0, 0.25), [0.5, 0.5, 0.0, 1.0]);
        assert_eq!(sample(Wrap::ClampToEdge, Filter::Linear, 0.0, 0.25), RED);
        assert_eq!(sample(Wrap::ClampToEdge, Filter::Linear, 1.0, 0.25), GREEN);
        assert_eq!(sample(Wrap::MirroredRepeat, Filter::Linear, 0.0, 0.25), RED);
        assert_eq!(sample(Wrap::MirroredRepeat, Filter::Linear, 1.0, 0.25), GREEN);
    }

    #[test]
    fn outside_of_the_picture_the_wrap_decides() {
        assert_eq!(sample(Wrap::Repeat, Filter::Nearest, 1.25, 0.25), RED);
        assert_eq!(sample(Wrap::Repeat, Filter::Nearest, -0.25, 0.25), GREEN);
        assert_eq!(sample(Wrap::MirroredRepeat, Filter::Nearest, 1.25, 0.25), GREEN);
        assert_eq!(sample(Wrap::MirroredRepeat, Filter::Nearest, -0.25, 0.25), RED);
        assert_eq!(sample(Wrap::MirroredRepeat, Filter::Nearest, 2.25, 0.25), RED);
        assert_eq!(sample(Wrap::ClampToEdge, Filter::Nearest, 7.0, -3.0), GREEN);
        assert_eq!(sample(Wrap::ClampToEdge, Filter::Linear, -7.0, 3.0), BLUE);
    }

    #[test]
    fn any_coordinate_gives_a_value_in_range() {
        for wrap in [Wrap::Repeat, Wrap::MirroredRepeat, Wrap::ClampToEdge] {
            for filter in [Filter::Nearest, Filter::Linear] {
                for x in [f32::MAX, f32::MIN, 1e20, -1e-30, 0.99999994, f32::EPSILON, -0.0, 16777216.5] {
                    let c = sample(wrap, filter, x, -x);
                    assert!(c.iter().all(|c| (0.0..=1.0).contains(c)), "{wrap:?} {filter:?} {x}: {c:?}");
                }
            }
        }
        for x in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            assert_eq!(sample(Wrap::Repeat, Filter::Linear, x, 0.75), RED);
        }
    }

    #[test]
    fn srgb_is_decoded_before_filtering_and_alpha_is_not_decoded() {
        let mut scene = scene(Wrap::ClampToEdge, Filter::Linear);
        Arc::make_mut(&mut scene.images[0]).texels = Texels::Rgba8(vec![[0, 10, 188, 128]; 4]);
        let srgb = TextureRef { encoding: Encoding::Srgb, ..plain() };
        let c = scene.sample_texture(&srgb, Vec2::splat(0.25));
        // IEC 61966-2-1: 10/255 lies on the linear part, 188 is ((188/255 + 0.055)/1.055)^2.4.
        assert_eq!(c.x, 0.0);
        assert!((c.y - 10.0 / 255.0 / 12.92).abs() <= f32::EPSILON);
        assert!((f64::from(c.z) - ((188.0 / 255.0 + 0.055) / 1.055_f64).powf(2.4)).abs() <= 1e-6);
        assert_eq!(c.w, 128.0 / 255.0);
        // Between black and white, decoded first: exactly one half.
        Arc::make_mut(&mut scene.images[0]).texels = Texels::Rgb8(vec![[0; 3], [255; 3], [0; 3], [255; 3]]);
        assert_eq!(scene.sample_texture(&srgb, Vec2::splat(0.5)).to_array(), [0.5, 0.5, 0.5, 1.0]);
    }

    #[test]
    fn sixteen_bits_keep_their_precision() {
        let mut scene = scene(Wrap::ClampToEdge, Filter::Nearest);
        Arc::make_mut(&mut scene.images[0]).texels = Texels::Rgba16(vec![[1, 257, 65535, 32768]; 4]);
        let c = scene.sample_texture(&plain(), Vec2::splat(0.25));
        assert_eq!(c.to_array(), [1.0 / 65535.0, 257.0 / 65535.0, 1.0, 32768.0 / 65535.0]);
    }

    #[test]
    fn the_transform_moves_the_coordinates() {
        let scene = scene(Wrap::Repeat, Filter::Nearest);
        let moved = TextureRef { transform: Some(Affine2::from_translation(Vec2::new(0.5, 0.0))), ..plain() };
        assert_eq!(scene.sample_texture(&moved, Vec2::splat(0.25)).to_array(), GREEN);
        let scaled = TextureRef { transform: Some(Affine2::from_scale(Vec2::new(1.0, 3.0))), ..plain() };
        assert_eq!(scene.sample_texture(&scaled, Vec2::splat(0.25)).to_array(), BLUE);
    }

    #[test]
    fn alpha_alone_is_the_alpha_of_the_colour() {
        let scene = scene(Wrap::MirroredRepeat, Filter::Linear);
        for i in 0..50 {
            let uv = Vec2::new(0.07 * i as f32, 1.0 - 0.11 * i as f32);
            assert_eq!(scene.sample_alpha(&plain(), uv), scene.sample_texture(&plain(), uv).w);
        }
    }
}
