//! Arbitrary output variables: what a picture file may hold beside the beauty.

use super::{AovSums, Film, PixelStats};

/// An output beside R, G, B and A. Channels are named `layer.channel`, in the letters that Blender, Nuke and tev
/// know: R, G, B for colours, X, Y, Z for vectors, Z for depth, V for a single value.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, clap::ValueEnum)]
pub enum Aov {
    /// Base colour at the first hit, mean over all paths (a miss counts as black).
    Albedo,
    /// World-space shading normal at the first hit, mean over all paths (a miss counts as zero).
    Normal,
    /// Distance to the first hit in metres, mean over the paths that hit; infinite where none did.
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
}

/// One channel's values, row-major over the film's window.
pub enum Channel {
    /// 32-bit floats.
    Float(Vec<f32>),
    /// 32-bit unsigned integers.
    Uint(Vec<u32>),
}

impl Aov {
    /// What is written unless `--aov` says otherwise: what a comparison needs, and costs nothing to keep.
    pub const DEFAULT: [Aov; 3] = [Aov::Variance, Aov::Samples, Aov::Balance];

    /// Those of a list of names with commas between; unknown names are left out.
    pub fn named(list: &str) -> Vec<Aov> {
        list.split(',').filter_map(|name| <Aov as clap::ValueEnum>::from_str(name, false).ok()).collect()
    }

    /// Does it need [`Film::aovs`]?
    pub fn needs_sums(self) -> bool {
        !matches!(self, Aov::Variance | Aov::Samples | Aov::Balance)
    }

    /// Its channels with their full names. Empty if it needs sums that the film has not kept.
    pub fn channels(self, film: &Film) -> Vec<(String, Channel)> {
        if self.needs_sums() && film.aovs.len() != film.pixels.len() {
            return Vec::new();
        }
        let (layer, letters) = match self {
            Aov::Albedo => ("albedo", "RGB"),
            Aov::Normal => ("normal", "XYZ"),
            Aov::Depth => ("depth", "Z"),
            Aov::Direct => ("direct", "RGB"),
            Aov::Indirect => ("indirect", "RGB"),
            Aov::Variance => ("variance", "RGB"),
            Aov::Samples => ("samples", "V"),
            Aov::Balance => ("balance", "V"),
            Aov::Object => ("object", "V"),
            Aov::Material => ("material", "V"),
        };
        let channels = letters.chars().enumerate();
        channels.map(|(c, letter)| (format!("{layer}.{letter}"), self.channel(film, c))).collect()
    }

    fn channel(self, film: &Film, c: usize) -> Channel {
        let pixel = |f: fn(&PixelStats, usize) -> f32| Channel::Float(film.pixels.iter().map(|p| f(p, c)).collect());
        let mean = |f: fn(&AovSums, usize) -> f32| {
            let both = film.aovs.iter().zip(&film.pixels);
            Channel::Float(both.map(|(a, p)| f(a, c) / p.samples.max(1) as f32).collect())
        };
        match self {
            Aov::Albedo => mean(|a, c| a.albedo[c]),
            Aov::Normal => mean(|a, c| a.normal[c]),
            Aov::Direct => mean(|a, c| a.direct[c]),
            Aov::Indirect => mean(|a, c| a.indirect[c]),
            Aov::Depth => {
                let both = film.aovs.iter().zip(&film.pixels);
                let depth = |(a, p): (&AovSums, &PixelStats)| match p.covered {
                    0 => f32::INFINITY,
                    n => a.depth / n as f32,
                };
                Channel::Float(both.map(depth).collect())
            }
            Aov::Variance => pixel(|p, c| p.variance_of_mean()[c]),
            Aov::Balance => pixel(|p, _| p.balance),
            Aov::Samples => Channel::Uint(film.pixels.iter().map(|p| p.samples).collect()),
            Aov::Object => Channel::Uint(film.aovs.iter().map(|a| a.object).collect()),
            Aov::Material => Channel::Uint(film.aovs.iter().map(|a| a.material).collect()),
        }
    }
}
