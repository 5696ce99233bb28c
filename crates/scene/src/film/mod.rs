//! The film: per-pixel statistics, picture files (OpenEXR, PNG), and the comparison of pictures.

pub mod aov;
pub mod atomic;
pub mod compare;
pub mod cryptomatte;
pub mod denoise;
mod destination;
pub mod exposure;
pub mod exr_file;
pub mod flip;
mod header;
pub mod lock;
pub mod npy;
mod open;
pub mod picture;
pub mod pixels;
pub mod preview;
pub mod radiance;
pub mod stats;
pub mod view;

pub use aov::Aov;
pub use denoise::denoised;
pub use exposure::Exposure;
pub use picture::Picture;
pub use pixels::{Background, Film, Pixels, colors};
pub use preview::Look;
pub use stats::{AovSums, ExtraSums, GroundSums, Peak, PixelStats};
pub use view::View;

/// The denoiser of a finished picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Denoise {
    /// Intel's Open Image Denoise, if it is installed.
    Oidn,
}

impl Denoise {
    /// All of them, in the order of the command line's help.
    pub const ALL: [Self; 1] = [Self::Oidn];

    /// Name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Oidn => "oidn",
        }
    }
}
