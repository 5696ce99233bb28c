//! Statistics of a pixel: sums over its paths.

use glam::{Vec2, Vec3};
use serde::{Deserialize, Serialize};

use super::cryptomatte::Matte;

/// Statistics of one pixel. Every sample belongs to exactly one pixel.
#[derive(Debug, Clone, Copy, Default, Serialize, Deserialize)]
pub struct PixelStats {
    /// Number of paths.
    pub samples: u32,
    /// Sum over paths of radiance, linear RGB.
    pub sum: [f64; 3],
    /// Sum over paths of squared radiance, per channel.
    pub sum_squared: [f64; 3],
    /// Number of paths whose camera ray hit a surface.
    pub covered: u32,
}

/// The brightest path of a pixel.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Peak {
    pub luminance: f32,
    /// Its index in the pixel.
    pub path: u32,
}

impl Peak {
    /// Considers another path; among equals the first stays.
    #[inline]
    pub fn add(&mut self, luminance: f32, path: u32) {
        if luminance > self.luminance {
            *self = Self { luminance, path };
        }
    }
}

/// Optional sums over paths, kept only if an AOV needs them.
#[derive(Debug, Clone, Copy, Default, Serialize, Deserialize)]
pub struct AovSums {
    /// Base colour at the first hit.
    pub albedo: [f32; 3],
    /// Unit world-space shading normal at the first hit.
    pub normal: [f32; 3],
    /// Distance to the first hit in metres, summed over `covered` paths.
    pub depth: f32,
    /// Radiance of lights that are seen directly or after one bounce.
    pub direct: [f32; 3],
    /// The rest of the radiance.
    pub indirect: [f32; 3],
    /// Instance index + 1 of the last path that hit one, 0 for none.
    pub object: u32,
    /// Material index + 1 of the last path that hit one, 0 for none.
    pub material: u32,
    /// What the ground's shadow adds to alpha, in [0, 1]: no sum, and set for pictures with such a ground alone.
    #[serde(skip)]
    pub shadow: f32,
}

/// Sums over the paths of a pixel that end on the ground that catches shadows.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct GroundSums {
    pub paths: u32,
    /// Luminance of the light samples without the scene.
    pub light: f64,
    /// Luminance of those that the scene takes.
    pub taken: f64,
}

impl GroundSums {
    /// Adds independent paths of the same pixel.
    pub fn join(&mut self, other: &Self) {
        self.paths += other.paths;
        self.light += other.light;
        self.taken += other.taken;
    }

    /// What the ground's shadow adds to the alpha of a pixel with so many paths, in [0, 1].
    pub fn alpha(&self, paths: u32) -> f32 {
        if self.light > 0.0 {
            (self.taken / self.light * f64::from(self.paths) / f64::from(paths.max(1))) as f32
        } else {
            0.0
        }
    }
}

/// More optional sums over paths, kept only if an AOV needs one of them.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct ExtraSums {
    /// World-space position of the first hit in metres, summed over `covered` paths.
    pub position: [f32; 3],
    /// TEXCOORD_0 of the first hit, summed over `covered` paths.
    pub uv: [f32; 2],
    /// Radiance that the surface of the first hit emits.
    pub emission: [f32; 3],
    /// Base colour of the first hit or, if that is a mirror, of the surface that is seen in it.
    pub guide_albedo: [f32; 3],
    /// Unit normal of the same surface.
    pub guide_normal: [f32; 3],
    /// Cryptomatte of the objects at first hits.
    pub objects: Matte,
    /// Cryptomatte of the materials at first hits.
    pub materials: Matte,
    /// Motion of the first hit in pixels (right, up): from the previous frame, and to the next frame; summed over `covered`
    /// paths.
    pub velocity: [f32; 4],
}

/// Adds the components of a value to those of a sum.
#[inline]
pub fn accumulate<const N: usize>(sum: &mut [f32; N], more: [f32; N]) {
    sum.iter_mut().zip(more).for_each(|(sum, more)| *sum += more);
}

impl ExtraSums {
    /// Adds the radiance that the surface of a first hit emits.
    #[inline]
    pub fn add_emission(&mut self, radiance: Vec3) {
        accumulate(&mut self.emission, radiance.to_array());
    }

    /// Adds a first hit: position, texture coordinates, Cryptomatte hashes of object and material.
    #[inline]
    pub fn add_surface(&mut self, position: Vec3, uv: Vec2, [object, material]: [u32; 2]) {
        accumulate(&mut self.position, position.to_array());
        accumulate(&mut self.uv, uv.to_array());
        self.objects.add(object, 1);
        self.materials.add(material, 1);
    }

    /// Adds the motion of a first hit in pixels, from the previous frame and to the next one.
    #[inline]
    pub fn add_velocity(&mut self, [before, after]: [Vec2; 2]) {
        accumulate(&mut self.velocity, [before.x, before.y, after.x, after.y]);
    }

    /// Adds base colour and normal for the denoiser.
    #[inline]
    pub fn add_guide(&mut self, albedo: Vec3, normal: Vec3) {
        accumulate(&mut self.guide_albedo, albedo.to_array());
        accumulate(&mut self.guide_normal, normal.to_array());
    }

    /// Adds independent paths of the same pixel.
    pub fn join(&mut self, other: &Self) {
        accumulate(&mut self.position, other.position);
        accumulate(&mut self.emission, other.emission);
        accumulate(&mut self.guide_albedo, other.guide_albedo);
        accumulate(&mut self.guide_normal, other.guide_normal);
        accumulate(&mut self.uv, other.uv);
        accumulate(&mut self.velocity, other.velocity);
        self.objects.join(&other.objects);
        self.materials.join(&other.materials);
    }
}

impl PixelStats {
    /// A pixel without paths.
    pub const EMPTY: Self = Self { samples: 0, sum: [0.0; 3], sum_squared: [0.0; 3], covered: 0 };

    /// Adds a path's radiance; `covered` if its camera ray hit a surface.
    #[inline]
    pub fn add(&mut self, radiance: Vec3, covered: bool) {
        self.samples += 1;
        self.covered += u32::from(covered);
        for c in 0..3 {
            let x = f64::from(radiance[c]);
            self.sum[c] += x;
            self.sum_squared[c] += x * x;
        }
    }

    /// Adds independent paths of the same pixel.
    pub fn join(&mut self, other: &Self) {
        self.samples += other.samples;
        self.covered += other.covered;
        for c in 0..3 {
            self.sum[c] += other.sum[c];
            self.sum_squared[c] += other.sum_squared[c];
        }
    }

    /// Mean radiance; black without samples.
    pub fn mean(&self) -> [f32; 3] {
        let n = f64::from(self.samples.max(1));
        self.sum.map(|s| (s / n) as f32)
    }

    /// Fraction of paths that hit a surface, in [0, 1].
    pub fn coverage(&self) -> f32 {
        self.covered as f32 / self.samples.max(1) as f32
    }

    /// Estimated variance of [`mean`](Self::mean), per channel: the sample variance of the paths over their number. Paths of a
    /// low-discrepancy sequence have less variance, so it overestimates. Infinite below two samples.
    pub fn variance_of_mean(&self) -> [f32; 3] {
        if self.samples < 2 {
            return [f32::INFINITY; 3];
        }
        let n = f64::from(self.samples);
        std::array::from_fn(|c| {
            let mean = self.sum[c] / n;
            ((self.sum_squared[c] / n - mean * mean).max(0.0) / (n - 1.0)) as f32
        })
    }
}

impl AovSums {
    /// Adds a first hit: base colour, unit normal, distance in metres.
    #[inline]
    pub fn add_surface(&mut self, albedo: Vec3, normal: Vec3, depth: f32) {
        accumulate(&mut self.albedo, albedo.to_array());
        accumulate(&mut self.normal, normal.to_array());
        self.depth += depth;
    }

    /// Adds the radiance of a path.
    #[inline]
    pub fn add_light(&mut self, direct: Vec3, indirect: Vec3) {
        accumulate(&mut self.direct, direct.to_array());
        accumulate(&mut self.indirect, indirect.to_array());
    }

    /// Adds independent paths of the same pixel.
    pub fn join(&mut self, other: &Self) {
        accumulate(&mut self.albedo, other.albedo);
        accumulate(&mut self.normal, other.normal);
        accumulate(&mut self.direct, other.direct);
        accumulate(&mut self.indirect, other.indirect);
        self.depth += other.depth;
        self.object = if self.object == 0 { other.object } else { self.object };
        self.material = if self.material == 0 { other.material } else { self.material };
    }
}
