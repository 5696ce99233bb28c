//! What first surfaces' samples find, and who wants to know.

use glam::Vec3;

/// How a contribution was found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Technique {
    /// A light sample.
    Light,
    /// A BSDF sample that met a light.
    Bsdf,
    /// A BSDF sample that met a surface: the light that came on from there, which no light sample can find.
    Indirect,
}

/// What a first surface's sample found, weighed by counts of a_l light and a_b BSDF samples a path.
#[derive(Debug, Clone, Copy)]
pub struct Contribution {
    /// Pixel of the tile.
    pub pixel: u32,
    /// How.
    pub technique: Technique,
    /// Light from an area light, where area lights are a technique of their own; else all light is taken as the
    /// environment's.
    pub area: bool,
    /// Index of the sample in its technique's sequence.
    pub index: u32,
    /// r = (p_l − p_b)/(p_l + p_b), in [−1, 1]; p_l is times the one light technique's share of light samples.
    pub r: f32,
    /// W = Σ_c Y_c Z_c over colour channels, ≥ 0.
    pub w: f32,
    /// Z/2 = f/(a_l p_l + a_b p_b): what it adds to the sum over paths.
    pub radiance: Vec3,
}

impl Contribution {
    /// Which path of a pilot of `paths` paths took the sample: each takes one of each technique; but of light samples,
    /// where environment and area lights are techniques of their own, the first half of the paths take the
    /// environment's.
    pub fn path(&self, paths: u32) -> u32 {
        let area = self.area && self.technique == Technique::Light;
        self.index + if area { paths / 2 } else { 0 }
    }

    /// Σ_c Z_c.
    #[inline]
    pub fn z(&self) -> f32 {
        2.0 * self.radiance.element_sum()
    }

    /// What it adds when each technique takes `rates` times as many samples a path as in the pilot that it is from
    /// (light or environment, area lights, BSDF; all > 0) and all are weighed together.
    #[inline]
    pub fn at(&self, rates: [f32; 3]) -> Vec3 {
        let light = rates[usize::from(self.area)];
        self.radiance / (0.5 * (light * (1.0 + self.r) + rates[2] * (1.0 - self.r)))
    }
}

/// Who is told what first surfaces' samples find, in a fixed order.
pub trait Observer {
    /// A sample found something. Its numbers may be anything, NaN too.
    fn contribution(&mut self, found: &Contribution);

    /// A path of pixel `pixel` is done, with `radiance` in all. A pixel's paths come in their order.
    fn path(&mut self, _pixel: u32, _radiance: Vec3) {}
}

/// Keeps all of them.
impl Observer for Vec<Contribution> {
    fn contribution(&mut self, found: &Contribution) {
        self.push(*found);
    }
}
