//! Contributions of samples at first surfaces, and observers that receive them.

use glam::Vec3;

/// The technique that found a contribution.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Technique {
    Light,
    /// A BSDF sample that hit a light.
    Bsdf,
    /// A BSDF sample that hit a surface: the radiance that this surface reflects, which no light sample can find.
    Indirect,
}

/// The contribution of a sample at a first surface, weighted for a_l light and a_b BSDF samples per path.
#[derive(Debug, Clone, Copy)]
pub struct Contribution {
    /// Index of the pixel in its tile.
    pub pixel: u32,
    /// The technique that found it.
    pub technique: Technique,
    /// Whether the light is an area light, where area lights are a technique of their own. Otherwise `false` for all lights.
    pub area: bool,
    /// Layer of the light, of a technique that finds one alone.
    pub layer: u8,
    /// Index of the sample in its technique's sequence.
    pub index: u32,
    /// r = (p_l − p_b)/(p_l + p_b), in [−1, 1]. p_l includes the fraction of light samples that this light technique takes.
    pub r: f32,
    /// W = Σ_c Y_c Z_c over colour channels, ≥ 0.
    pub w: f32,
    /// Z/2 = f/(a_l p_l + a_b p_b), linear RGB: the term that the sample adds to the sum over paths.
    pub radiance: Vec3,
}

impl Contribution {
    /// The index of the path that took the sample, in a pilot of `paths` paths. Each path takes one sample of each technique.
    /// Where environment and area lights are techniques of their own, the first half of the paths sample the environment
    /// and the second half the area lights.
    pub fn path(&self, paths: u32) -> u32 {
        let area = self.area && self.technique == Technique::Light;
        self.index + if area { paths / 2 } else { 0 }
    }

    /// Σ_c Z_c.
    #[inline]
    pub fn z(&self) -> f32 {
        2.0 * self.radiance.element_sum()
    }

    /// The contribution (linear RGB) when each technique takes `ratios` times as many samples per path as in the pilot, and
    /// all samples are weighted by these counts. The ratios, all > 0, are those of [`Counts::relative_to`]: light or
    /// environment, area lights, BSDF.
    ///
    /// [`Counts::relative_to`]: super::Counts::relative_to
    #[inline]
    pub fn reweighted(&self, ratios: [f32; 3]) -> Vec3 {
        let light = ratios[usize::from(self.area)];
        self.radiance / (0.5 * (light * (1.0 + self.r) + ratios[2] * (1.0 - self.r)))
    }
}

/// Receives the contributions of samples at first surfaces, in a deterministic order.
pub trait Observer {
    /// Receives one contribution. Its numbers may be NaN or infinite.
    fn contribution(&mut self, contribution: &Contribution);

    /// A path of pixel `pixel` has ended with the total `radiance`. The paths of a pixel come in order.
    fn path(&mut self, _pixel: u32, _radiance: Vec3) {}
}

impl Observer for Vec<Contribution> {
    fn contribution(&mut self, contribution: &Contribution) {
        self.push(*contribution);
    }
}
