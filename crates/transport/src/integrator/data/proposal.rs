//! What paths are sampled by.

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
}

impl<'a> Proposal<'a> {
    /// The proposal without anything learned.
    pub fn new(lights: &Lights) -> Self {
        Self { lights: lights.proposal(), field: None, emission_rays: None }
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
