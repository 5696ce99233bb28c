//! What paths are sampled by.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use crate::guiding::Field;
use crate::light::{LightProposal, Lights};

/// The distributions of light samples and of directions. Any proposal gives the same mean; variance and cost differ.
#[derive(Debug, Clone, Copy)]
pub struct Proposal<'a> {
    /// Light samples: radiance or compensated density, light tree or learned selection.
    pub lights: LightProposal<'a>,
    /// Directions: a mixture of the BSDF and this guiding field, or the BSDF alone. The field also has the roulette
    /// probabilities of light samples and of path continuation beyond first surfaces.
    pub field: Option<&'a Field>,
    /// Camera rays per path for emission that the camera sees directly: these, or the path's own.
    pub emission_rays: Option<&'a EmissionRayCounts>,
    /// How first surfaces share what their paths find ([`reuse`](crate::integrator::reuse)), if they do.
    pub reuse: Option<Reuse>,
}

/// Sizes of path re-use.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Reuse {
    /// Number N of BSDF samples that form a pool (for users a group), from 2 to [`Reuse::MAX_POOL`].
    pub group: u32,
    /// How many of these go on from the second surface, from 1 to N.
    pub traced: u32,
}

impl Reuse {
    pub const MAX_POOL: u32 = 64;

    /// Sizes that suit most scenes with so many paths per pixel. The fewer go on, the more the errors of a tile have in common:
    /// with few paths per pixel, tiles could be seen.
    pub fn usual(paths: u32) -> &'static [Self] {
        const fn of(traced: u32) -> Reuse {
            Reuse { group: 64, traced }
        }
        match paths {
            64.. => const { &[of(16), of(32)] },
            32.. => const { &[of(32)] },
            _ => const { &[of(64)] },
        }
    }

    /// How many samples of a pool of `members` go on: the same share, at least one.
    pub(crate) fn traced_of(self, members: usize) -> usize {
        (members * self.traced as usize).div_ceil(self.group as usize).max(1)
    }
}

impl Default for Reuse {
    fn default() -> Self {
        Self { group: 64, traced: 16 }
    }
}

impl<'a> Proposal<'a> {
    /// The proposal without anything learned.
    pub fn new(lights: &Lights) -> Self {
        Self { lights: lights.proposal(), field: None, emission_rays: None, reuse: None }
    }

    /// This proposal with another guiding field, or none.
    pub fn guided(self, field: Option<&'a Field>) -> Self {
        Self { field, ..self }
    }

    /// Does a guiding field set the roulette probabilities of light samples and of path continuation beyond first surfaces?
    pub(in crate::integrator) fn has_roulette(&self) -> bool {
        self.field.is_some_and(Field::has_roulette)
    }
}

impl fmt::Display for Reuse {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self.traced == self.group {
            true => write!(f, "{}", self.group),
            false => write!(f, "{}:{}", self.group, self.traced),
        }
    }
}

impl FromStr for Reuse {
    type Err = String;

    /// Parses `N` or `N:M`.
    fn from_str(text: &str) -> Result<Self, String> {
        let (group, traced) = text.split_once(':').unwrap_or((text, text));
        match (group.parse(), traced.parse()) {
            (Ok(group @ 2..=Self::MAX_POOL), Ok(traced)) if (1..=group).contains(&traced) => Ok(Self { group, traced }),
            _ => Err(format!("N or N:M with 2 <= N <= {} and 1 <= M <= N", Self::MAX_POOL)),
        }
    }
}

/// Maximum of [`EmissionRayCounts::rays_per_path`].
pub const MAX_RAYS_PER_PATH: u32 = 64;

/// For each pixel of a picture, the number of camera rays per path for emission.
#[derive(Debug, Clone)]
pub struct EmissionRayCounts {
    width: u32,
    /// Row by row.
    rays: Vec<u8>,
}

impl EmissionRayCounts {
    /// `rays` are the numbers of a picture of `width` pixels a row, row by row, each from 1 to [`MAX_RAYS_PER_PATH`].
    pub fn new(width: u32, rays: Vec<u8>) -> Self {
        debug_assert!(rays.iter().all(|rays| (1..=MAX_RAYS_PER_PATH as u8).contains(rays)));
        Self { width, rays }
    }

    /// Camera rays per path of the pixel at column `x` and row `y`; with one, the path's own finds the emission.
    #[inline]
    pub fn rays_per_path(&self, x: u32, y: u32) -> u32 {
        self.rays[y as usize * self.width as usize + x as usize].into()
    }
}
