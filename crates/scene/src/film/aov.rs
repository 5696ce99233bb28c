//! Arbitrary output variables: what a picture file may hold beside the beauty.

use super::cryptomatte::RANKS;
use super::{AovSums, Background, ExtraSums, PixelStats};

/// An output beside R, G, B and A. Channels are named `layer.channel`, in the letters that Blender, Nuke and tev
/// know: R, G, B for colours, X, Y, Z for vectors, Z for depth, V for a single value.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, clap::ValueEnum)]
pub enum Aov {
    /// Base colour at the first hit, mean over all paths (a miss counts as black).
    Albedo,
    /// World-space shading normal at the first hit, mean over all paths (a miss counts as zero).
    Normal,
    /// Distance to the first hit in metres, mean over the paths that hit; [`NOWHERE`] where none did.
    Depth,
    /// Radiance of lights seen directly and after one bounce.
    Direct,
    /// The rest of the radiance.
    Indirect,
    /// Estimated variance of the beauty (of the mean, not of one path); infinite below two paths.
    Variance,
    /// Paths, as integers.
    Samples,
    /// The share of light samples that the next pass would use, in [0, 1].
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
    /// Radiance that the surface of the first hit emits, mean over all paths.
    Emission,
    /// For denoisers: as `albedo`, of what is seen in mirrors where the first hit is one.
    GuideAlbedo,
    /// For denoisers: the normal of that surface.
    GuideNormal,
    /// The beauty by what the light came from: environment, surfaces that shine, lights without size. They add up to it.
    Lights,
    /// How what is seen moves in the picture, in pixels a frame, mean over the paths that hit; 0 where none did. For Nuke
    /// `forward` (u to the right, v up, to the next frame) and `backward` (to the frame before), for Blender `Vector` (X, Y to
    /// the frame before; Z, W from the next one), as Cycles writes it.
    Velocity,
    /// Cryptomatte of objects, by the names of their nodes.
    CryptoObject,
    /// Cryptomatte of materials.
    CryptoMaterial,
}

/// How a channel's value follows from what a pixel has collected.
#[derive(Clone, Copy)]
pub enum Value {
    /// A 32-bit float; the last argument is the component.
    Float(Component),
    /// As `Float`, and good enough in 16 bits.
    Color(Component),
    /// As `Float`, of the extra sums.
    Extra(ExtraComponent),
    /// As `Extra`, and good enough in 16 bits.
    ExtraColor(ExtraComponent),
    /// A 32-bit unsigned integer.
    Uint(fn(&PixelStats, &AovSums) -> u32),
}

/// A component of what a pixel shows.
pub type Component = fn(&PixelStats, &AovSums, usize) -> f32;

/// As [`Component`], of the extra sums.
pub type ExtraComponent = fn(&PixelStats, &ExtraSums, usize) -> f32;

/// The depth of what is not there, as Cycles has it: finite, so that compositors can reckon with it.
pub const NOWHERE: f32 = 1e10;

/// One channel of a picture file.
pub struct Channel {
    /// As the file names it.
    pub name: String,
    /// Which of its layer's letters it is, from 0.
    pub component: usize,
    /// What it shows.
    pub value: Value,
}

/// R, G, B and A: premultiplied, so that *over* puts the picture on another.
pub fn beauty(background: Background) -> Vec<Channel> {
    let alpha: Component = match background {
        Background::Environment => |p, _, _| if p.samples > 0 { 1.0 } else { 0.0 },
        Background::Black | Background::Transparent => |p, _, _| p.coverage(),
    };
    let mut channels = layer("", "RGB", Value::Color(|p, _, c| p.mean()[c]));
    channels.extend(layer("", "A", Value::Color(alpha)));
    channels
}

fn layer(prefix: &str, letters: &str, value: Value) -> Vec<Channel> {
    let channel = |(component, letter)| Channel { name: format!("{prefix}{letter}"), component, value };
    letters.chars().enumerate().map(channel).collect()
}

impl Aov {
    /// What is written unless `--aov` says otherwise: what a comparison needs, and costs nothing to keep.
    pub const DEFAULT: [Aov; 3] = [Aov::Variance, Aov::Samples, Aov::Balance];

    /// Those of a list of names with commas between; unknown names are left out.
    pub fn named(list: &str) -> Vec<Aov> {
        list.split(',').filter_map(|name| <Aov as clap::ValueEnum>::from_str(name, false).ok()).collect()
    }

    /// Does it need [`AovSums`]?
    pub fn needs_sums(self) -> bool {
        !matches!(self, Aov::Variance | Aov::Samples | Aov::Balance) && !self.needs_extras()
    }

    /// Does it need [`ExtraSums`]?
    pub fn needs_extras(self) -> bool {
        use Aov::{CryptoMaterial, CryptoObject, Emission, GuideAlbedo, GuideNormal, Lights, Position, Uv, Velocity};
        matches!(
            self,
            Position | Uv | Emission | GuideAlbedo | GuideNormal | Lights | Velocity | CryptoObject | CryptoMaterial
        )
    }

    /// Its channels with their full names. Empty if it needs sums that are not there.
    pub fn channels(self, with_sums: bool, with_extras: bool) -> Vec<Channel> {
        if (self.needs_sums() && !with_sums) || (self.needs_extras() && !with_extras) {
            return Vec::new();
        }
        let (name, letters, value) = match self {
            Aov::Albedo => ("albedo.", "RGB", Value::Color(|p, a, c| mean(p, a.albedo[c]))),
            Aov::Normal => ("normal.", "XYZ", Value::Color(|p, a, c| mean(p, a.normal[c]))),
            Aov::Depth => ("depth.", "Z", Value::Float(depth)),
            Aov::Direct => ("direct.", "RGB", Value::Color(|p, a, c| mean(p, a.direct[c]))),
            Aov::Indirect => ("indirect.", "RGB", Value::Color(|p, a, c| mean(p, a.indirect[c]))),
            Aov::Variance => ("variance.", "RGB", Value::Float(|p, _, c| p.variance_of_mean()[c])),
            Aov::Samples => ("samples.", "V", Value::Uint(|p, _| p.samples)),
            Aov::Balance => ("balance.", "V", Value::Float(|p, _, _| p.balance)),
            Aov::Object => ("object.", "V", Value::Uint(|_, a| a.object)),
            Aov::Material => ("material.", "V", Value::Uint(|_, a| a.material)),
            Aov::Position => ("position.", "XYZ", Value::Extra(|p, e, c| of_hits(p, e.position[c]))),
            Aov::Uv => ("uv.", "UV", Value::Extra(|p, e, c| of_hits(p, e.uv[c]))),
            Aov::Emission => ("emission.", "RGB", Value::ExtraColor(|p, e, c| mean(p, e.emission[c]))),
            Aov::GuideAlbedo => ("guide_albedo.", "RGB", Value::ExtraColor(|p, e, c| mean(p, e.guide_albedo[c]))),
            Aov::GuideNormal => ("guide_normal.", "XYZ", Value::ExtraColor(|p, e, c| mean(p, e.guide_normal[c]))),
            Aov::Lights => {
                let [sky, surfaces, punctual]: [ExtraComponent; 3] = [
                    |p, e, c| mean(p, e.lights[0][c]),
                    |p, e, c| mean(p, e.lights[1][c]),
                    |p, e, c| mean(p, e.lights[2][c]),
                ];
                let all = [("light_environment.", sky), ("light_surfaces.", surfaces), ("light_punctual.", punctual)];
                return all.into_iter().flat_map(|(name, of)| layer(name, "RGB", Value::ExtraColor(of))).collect();
            }
            Aov::Velocity => {
                let [to_next, to_last]: [ExtraComponent; 2] =
                    [|p, e, c| of_hits(p, e.velocity[2 + c]), |p, e, c| -of_hits(p, e.velocity[c])];
                let mut all = layer("forward.", "uv", Value::Extra(to_next));
                all.extend(layer("backward.", "uv", Value::Extra(to_last)));
                all.extend(layer("Vector.", "XYZW", Value::Extra(|p, e, c| -of_hits(p, e.velocity[c]))));
                return all;
            }
            Aov::CryptoObject => return matte(OBJECTS, |p, e, c| ranked(p, e.objects.rank(c / 2), c)),
            Aov::CryptoMaterial => return matte(MATERIALS, |p, e, c| ranked(p, e.materials.rank(c / 2), c)),
        };
        layer(name, letters, value)
    }
}

/// Cryptomatte's layer of objects.
pub const OBJECTS: &str = "CryptoObject";
/// Cryptomatte's layer of materials.
pub const MATERIALS: &str = "CryptoMaterial";

/// Layers of two ranks each: hash and coverage, hash and coverage.
fn matte(name: &str, value: ExtraComponent) -> Vec<Channel> {
    let channel = |component: usize| Channel {
        name: format!("{name}{:02}.{}", component / 4, ["R", "G", "B", "A"][component % 4]),
        component,
        value: Value::Extra(value),
    };
    (0..2 * RANKS).map(channel).collect()
}

/// A rank's hash, as the bits of a float, for even components, its coverage for odd ones.
fn ranked(pixel: &PixelStats, (id, paths): (u32, u32), component: usize) -> f32 {
    match component.is_multiple_of(2) {
        true => f32::from_bits(id),
        false => paths as f32 / pixel.samples.max(1) as f32,
    }
}

fn of_hits(pixel: &PixelStats, sum: f32) -> f32 {
    sum / pixel.covered.max(1) as f32
}

fn mean(pixel: &PixelStats, sum: f32) -> f32 {
    sum / pixel.samples.max(1) as f32
}

fn depth(pixel: &PixelStats, sums: &AovSums, _: usize) -> f32 {
    match pixel.covered {
        0 => NOWHERE,
        n => sums.depth / n as f32,
    }
}
