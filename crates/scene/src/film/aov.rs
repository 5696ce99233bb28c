//! Arbitrary output variables (AOVs): the channels of a picture file besides the beauty.

use super::cryptomatte::RANKS;
use super::pixels::{Background, Pixels};
use super::stats::{AovSums, ExtraSums, PixelStats};

/// An output besides R, G, B and A. Channels are named `layer.channel` with the letters of Blender, Nuke and tev: R, G, B for
/// colours, X, Y, Z for vectors, Z for depth, V for a single value.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Aov {
    /// Base colour at the first hit, mean over all paths (a miss counts as black).
    Albedo,
    /// World-space shading normal at the first hit, mean over all paths (a miss counts as zero).
    Normal,
    /// Distance to the first hit in metres, mean over the paths that hit; [`MISS_DEPTH`] where none did.
    Depth,
    /// Radiance of lights that are seen directly or after one bounce.
    Direct,
    /// The rest of the radiance.
    Indirect,
    /// Estimated variance of the beauty (of the mean, not of one path); infinite below two paths.
    Variance,
    /// Number of paths, as integers.
    Samples,
    /// The light share of the next pass, in [0, 1].
    Balance,
    /// Instance index + 1, 0 for none, as integers.
    Object,
    /// Material index + 1, 0 for none, as integers.
    Material,
    /// World-space position of the first hit in metres, mean over the paths that hit; 0 where none did.
    Position,
    /// Texture coordinates (TEXCOORD_0) of the first hit, mean over the paths that hit; 0 where none did, and on meshes whose
    /// material has no texture.
    Uv,
    /// Radiance that the surface at the first hit emits, mean over all paths.
    Emission,
    /// For denoisers: base colour at the first hit or, if that is a mirror, of the surface that is seen in it.
    GuideAlbedo,
    /// For denoisers: the normal of that surface.
    GuideNormal,
    /// The beauty by light source: environment, emissive surfaces, punctual lights, or by groups. They add up to it.
    Lights,
    /// Motion in the picture in pixels per frame, mean over the paths that hit; 0 where none did. For Nuke `forward` (u to the
    /// right, v up, to the next frame) and `backward` (to the previous frame), for Blender `Vector` (X, Y to the previous frame;
    /// Z, W from the next one), as Cycles writes it.
    Velocity,
    /// Cryptomatte of objects, by the names of their nodes.
    CryptoObject,
    CryptoMaterial,
}

/// How the value of a channel follows from the statistics of a pixel.
#[derive(Clone, Copy)]
pub enum Value {
    /// A float; the last argument is the component.
    Float(Component),
    /// A float from the extra sums.
    Extra(ExtraComponent),
    /// A float: light of the group of this number.
    Light(usize),
    /// A 32-bit unsigned integer.
    Uint(fn(&PixelStats, &AovSums) -> u32),
    /// The light share, a float.
    LightShare,
}

/// A component of an AOV from the statistics of a pixel; the last argument is its index.
pub type Component = fn(&PixelStats, &AovSums, usize) -> f32;

/// A component of an AOV from the extra sums of a pixel; the last argument is its index.
pub type ExtraComponent = fn(&PixelStats, &ExtraSums, usize) -> f32;

/// The depth of pixels without a hit, the value of Cycles: finite, so that compositors can compute with it.
pub const MISS_DEPTH: f32 = 1e10;

/// One channel of a picture file.
pub struct Channel {
    /// Its full name in the file.
    pub name: String,
    /// Its index in its layer, from 0.
    pub component: usize,
    pub value: Value,
    /// Whether 16 bits are enough for it: a colour or a direction.
    pub half: bool,
}

impl Channel {
    /// Its value at pixel (x, y) of the whole picture, as a float.
    pub fn float(&self, pixels: &dyn Pixels, x: u32, y: u32) -> f32 {
        let (stats, sums) = pixels.at(x, y);
        match self.value {
            Value::Float(f) => f(&stats, &sums, self.component),
            Value::Extra(f) => f(&stats, &pixels.extras(x, y).unwrap_or_default(), self.component),
            Value::Light(group) => mean(&stats, pixels.light(x, y, group)[self.component]),
            Value::Uint(f) => f(&stats, &sums) as f32,
            Value::LightShare => pixels.light_share(x, y),
        }
    }
}

/// The channels R, G, B and A of the beauty, premultiplied for the *over* operator.
pub fn beauty(background: Background) -> Vec<Channel> {
    let alpha: Component = match background {
        Background::Environment => |p, _, _| if p.samples > 0 { 1.0 } else { 0.0 },
        Background::Black | Background::Transparent => |p, sums, _| p.coverage() + sums.shadow,
    };
    let mut channels = layer("", "RGB", true, Value::Float(|p, _, c| p.mean()[c]));
    channels.extend(layer("", "A", true, Value::Float(alpha)));
    channels
}

fn layer(prefix: &str, letters: &str, half: bool, value: Value) -> Vec<Channel> {
    let channel = |(component, letter)| Channel { name: format!("{prefix}{letter}"), component, value, half };
    letters.chars().enumerate().map(channel).collect()
}

named_variants! {
    Aov {
        Albedo = "albedo", Normal = "normal", Depth = "depth", Direct = "direct", Indirect = "indirect",
        Variance = "variance", Samples = "samples", Balance = "balance", Object = "object", Material = "material",
        Position = "position", Uv = "uv", Emission = "emission", GuideAlbedo = "guide-albedo",
        GuideNormal = "guide-normal", Lights = "lights", Velocity = "velocity", CryptoObject = "crypto-object",
        CryptoMaterial = "crypto-material",
    }
}

impl Aov {
    /// The default of `--aov`: the AOVs that a comparison needs, which need no further memory.
    pub const DEFAULT: [Aov; 3] = [Aov::Variance, Aov::Samples, Aov::Balance];

    /// The AOVs of a comma-separated list of names; unknown names are ignored.
    pub fn named(list: &str) -> Vec<Aov> {
        list.split(',').filter_map(|name| Self::ALL.into_iter().find(|aov| aov.name() == name)).collect()
    }

    /// Whether it needs [`AovSums`].
    pub fn needs_sums(self) -> bool {
        !matches!(self, Aov::Variance | Aov::Samples | Aov::Balance | Aov::Lights) && !self.needs_extras()
    }

    /// Whether it needs [`ExtraSums`].
    pub fn needs_extras(self) -> bool {
        use Aov::{CryptoMaterial, CryptoObject, Emission, GuideAlbedo, GuideNormal, Position, Uv, Velocity};
        matches!(self, Position | Uv | Emission | GuideAlbedo | GuideNormal | Velocity | CryptoObject | CryptoMaterial)
    }

    /// Its channels; empty if it needs sums that do not exist. `groups` are the names of groups or kinds of lights.
    pub fn channels(self, with_sums: bool, with_extras: bool, groups: &[String]) -> Vec<Channel> {
        if (self.needs_sums() && !with_sums) || (self.needs_extras() && !with_extras) {
            return Vec::new();
        }
        let (name, letters, half, value) = match self {
            Aov::Albedo => ("albedo.", "RGB", true, Value::Float(|p, a, c| mean(p, a.albedo[c]))),
            Aov::Normal => ("normal.", "XYZ", true, Value::Float(|p, a, c| mean(p, a.normal[c]))),
            Aov::Depth => ("depth.", "Z", false, Value::Float(depth)),
            Aov::Direct => ("direct.", "RGB", true, Value::Float(|p, a, c| mean(p, a.direct[c]))),
            Aov::Indirect => ("indirect.", "RGB", true, Value::Float(|p, a, c| mean(p, a.indirect[c]))),
            Aov::Variance => ("variance.", "RGB", false, Value::Float(|p, _, c| variance(p, c))),
            Aov::Samples => ("samples.", "V", false, Value::Uint(|p, _| p.samples)),
            Aov::Balance => ("balance.", "V", false, Value::LightShare),
            Aov::Object => ("object.", "V", false, Value::Uint(|_, a| a.object)),
            Aov::Material => ("material.", "V", false, Value::Uint(|_, a| a.material)),
            Aov::Position => ("position.", "XYZ", false, Value::Extra(|p, e, c| mean_over_hits(p, e.position[c]))),
            Aov::Uv => ("uv.", "UV", false, Value::Extra(|p, e, c| mean_over_hits(p, e.uv[c]))),
            Aov::Emission => ("emission.", "RGB", true, Value::Extra(|p, e, c| mean(p, e.emission[c]))),
            Aov::GuideAlbedo => ("guide_albedo.", "RGB", true, Value::Extra(|p, e, c| mean(p, e.guide_albedo[c]))),
            Aov::GuideNormal => ("guide_normal.", "XYZ", true, Value::Extra(|p, e, c| mean(p, e.guide_normal[c]))),
            Aov::Lights => {
                let of = |(i, name)| layer(&format!("light_{name}."), "RGB", true, Value::Light(i));
                return groups.iter().enumerate().flat_map(of).collect();
            }
            Aov::Velocity => {
                let [to_next, to_previous]: [ExtraComponent; 2] =
                    [|p, e, c| mean_over_hits(p, e.velocity[2 + c]), |p, e, c| -mean_over_hits(p, e.velocity[c])];
                let mut all = layer("forward.", "uv", false, Value::Extra(to_next));
                all.extend(layer("backward.", "uv", false, Value::Extra(to_previous)));
                all.extend(layer("Vector.", "XYZW", false, Value::Extra(to_previous)));
                return all;
            }
            Aov::CryptoObject => return matte(OBJECTS, |p, e, c| ranked(p, e.objects.rank(c / 2), c)),
            Aov::CryptoMaterial => return matte(MATERIALS, |p, e, c| ranked(p, e.materials.rank(c / 2), c)),
        };
        layer(name, letters, half, value)
    }
}

/// The Cryptomatte layer of objects.
pub const OBJECTS: &str = "CryptoObject";
/// The Cryptomatte layer of materials.
pub const MATERIALS: &str = "CryptoMaterial";

/// The channels of a Cryptomatte layer. Each numbered part holds two ranks: hash, coverage, hash, coverage.
fn matte(name: &str, value: ExtraComponent) -> Vec<Channel> {
    let channel = |component: usize| Channel {
        name: format!("{name}{:02}.{}", component / 4, ["R", "G", "B", "A"][component % 4]),
        component,
        value: Value::Extra(value),
        half: false,
    };
    (0..2 * RANKS).map(channel).collect()
}

/// The hash of a rank, as the bits of a float, for even components; its coverage for odd ones.
fn ranked(pixel: &PixelStats, (id, paths): (u32, u32), component: usize) -> f32 {
    match component.is_multiple_of(2) {
        true => f32::from_bits(id),
        false => paths as f32 / pixel.samples.max(1) as f32,
    }
}

fn mean_over_hits(pixel: &PixelStats, sum: f32) -> f32 {
    sum / pixel.covered.max(1) as f32
}

/// Estimated variance of the beauty. One path has none: its square is finite, and in expectation not too low.
fn variance(pixel: &PixelStats, channel: usize) -> f32 {
    match pixel.samples {
        0 | 1 => pixel.sum_squared[channel] as f32,
        _ => pixel.variance_of_mean()[channel],
    }
}

fn mean(pixel: &PixelStats, sum: f32) -> f32 {
    sum / pixel.samples.max(1) as f32
}

fn depth(pixel: &PixelStats, sums: &AovSums, _: usize) -> f32 {
    match pixel.covered {
        0 => MISS_DEPTH,
        n => sums.depth / n as f32,
    }
}
