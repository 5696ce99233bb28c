//! Samples of first surfaces, and what second surfaces lend them.

use glam::Vec3;

/// Marks a sample or a ray that lends nothing, and the end of a list.
pub const NONE: u32 = u32::MAX;

/// A BSDF sample of a first surface.
#[derive(Debug, Clone, Copy)]
pub struct FirstSample {
    /// Row of the first surface.
    pub x: u32,
    /// Index of the path in the wave.
    pub path: u32,
    /// Index in the pixel's sequence.
    pub index: u32,
    /// Its lender, or [`NONE`].
    pub lender: u32,
    /// Is its direction no mirror image ([`MIRROR_PDF`](crate::integrator::data::history::MIRROR_PDF))?
    pub rough: bool,
}

/// Index of the direction of a second surface's light sample.
pub const LIGHT: usize = 0;
/// Index of that of its sample of the punctual lights, which BSDF samples never hit.
pub const PUNCTUAL: usize = 1;
/// Index of that of its path's next ray.
pub const NEXT: usize = 2;
/// Directions at a second surface in which it finds light.
pub const DIRECTIONS: usize = 3;

/// Light that a second surface has found at the end of one of its directions.
#[derive(Debug, Clone, Copy)]
pub struct Find {
    /// [`LIGHT`], [`PUNCTUAL`] or [`NEXT`].
    pub direction: usize,
    /// Outgoing radiance toward the own first surface, linear RGB. After [`Lender::weigh`], incident radiance times the
    /// density by which the own sample counts.
    pub radiance: Vec3,
    /// Density per solid angle of light samples in this direction, times their number; zero for light that they never find.
    pub light_pdf: f32,
    /// Index of another find of the same lender, or [`NONE`].
    pub next: u32,
}

/// A second surface whose light is lent.
#[derive(Debug, Clone, Copy)]
pub struct Lender {
    /// Row of the second surface.
    pub y: u32,
    /// [`RayBatch::key`](crate::rays::RayBatch::key) of the ray that has found it.
    pub key: u32,
    /// Throughput of its path before it scatters there, linear RGB.
    pub beta: Vec3,
    /// Probability with which its path goes on from there.
    pub goes_on: f32,
    /// Has it a sharp lobe? Then all paths go on from it.
    pub sharp: bool,
    /// Unit directions in which it has found light; zero for none.
    pub directions: [Vec3; DIRECTIONS],
    /// Density per solid angle of the lobes that are lent, by that of the BSDF's: a factor and a summand, by direction.
    pub mixture: [[f32; 2]; DIRECTIONS],
    /// Index of its first find, or [`NONE`].
    pub found: u32,
    /// Outgoing radiance of what its path finds beyond its next ray, linear RGB.
    pub beyond: Vec3,
    /// Outgoing radiance toward the own first surface that its sharp lobes scatter, which is not lent.
    pub own: Vec3,
}

impl Lender {
    /// One that has found nothing.
    pub fn new((y, key): (u32, u32), beta: Vec3, goes_on: f32, sharp: bool) -> Self {
        let (directions, mixture) = ([Vec3::ZERO; DIRECTIONS], [[0.0; 2]; DIRECTIONS]);
        Self { y, key, beta, goes_on, sharp, directions, mixture, found: NONE, beyond: Vec3::ZERO, own: Vec3::ZERO }
    }

    /// What it has found, but for what lies beyond its next ray.
    pub fn finds(self, finds: &[Find]) -> impl Iterator<Item = &Find> {
        std::iter::successors(finds.get(self.found as usize), |find| finds.get(find.next as usize))
    }

    /// Divides what it has found in a direction by f cos there, and multiplies it by the density of the lobes that are lent,
    /// `pdf` times the number of samples, and of light samples. `all` and `lent` are f cos of all lobes and of these. Forgets
    /// the direction if there is nothing to lend.
    pub fn weigh(&mut self, finds: &mut [Find], direction: usize, [all, lent]: [Vec3; 2], pdf: f32) {
        let over = |found: Vec3| Vec3::select(all.cmpgt(Vec3::ZERO), found / all, Vec3::ZERO);
        let mut found = Vec3::ZERO;
        let mut weigh = |radiance: &mut Vec3, pdf: f32| {
            let incident = over(*radiance);
            self.own += (*radiance - incident * lent).max(Vec3::ZERO);
            *radiance = incident * pdf;
            found += *radiance;
        };
        let mut next = self.found;
        while let Some(find) = finds.get_mut(next as usize) {
            if find.direction == direction {
                weigh(&mut find.radiance, find.light_pdf + pdf);
            }
            next = find.next;
        }
        if direction == NEXT {
            weigh(&mut self.beyond, pdf);
        }
        if found == Vec3::ZERO || lent == Vec3::ZERO {
            self.directions[direction] = Vec3::ZERO;
        }
    }

    /// Has it found anything?
    pub fn is_lit(&self) -> bool {
        self.found != NONE || self.beyond != Vec3::ZERO
    }
}
