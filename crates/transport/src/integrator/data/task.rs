//! The input of a wave: what each pixel samples.

use crate::balance::Counts;

/// The samples that one pixel takes in a wave.
#[derive(Debug, Clone, Copy)]
pub struct PixelTask {
    /// Column in the whole picture, from the left.
    pub x: u32,
    /// Row in the whole picture, from the top.
    pub y: u32,
    /// Number of paths that the pixel has taken before.
    pub first_path: u32,
    /// Number of light samples at first surfaces that it has taken before.
    pub first_light: u32,
    /// Number of these light samples that were allocated to the environment, rather than drawn among all lights.
    pub first_environment: u32,
    /// Number of BSDF samples at first surfaces that it has taken before.
    pub first_bsdf: u32,
    /// Numbers of paths and of light and BSDF samples at first surfaces in this wave.
    pub counts: Counts,
    /// Numbers of samples for the MIS weights: those of all paths that are weighed together with this wave's.
    pub weighed: Counts,
    /// Index of the pixel in its tile, for observers.
    pub number: u32,
    /// Pixels of different classes share no paths ([`reuse`](crate::integrator::reuse)): those of one class may decide for those of
    /// another. Below 2²⁹.
    pub class: u32,
}

impl PixelTask {
    /// The first paths of a pixel, with MIS weights by their own counts.
    pub fn first([x, y]: [u32; 2], counts: Counts, number: u32) -> Self {
        Self {
            x,
            y,
            first_path: 0,
            first_light: 0,
            first_environment: 0,
            first_bsdf: 0,
            counts,
            weighed: counts,
            number,
            class: 0,
        }
    }
}
