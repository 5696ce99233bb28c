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
pub mod lut;
mod mark;
pub mod npy;
mod open;
pub mod picture;
pub mod pixels;
pub mod preview;
pub mod radiance;
pub mod stats;
pub mod view;

pub use aov::Aov;
pub use exposure::Exposure;
pub use lut::{Lut, LutInput};
pub use picture::Picture;
pub use pixels::{Background, Film, Pixels, colors};
pub use preview::Look;
pub use stats::{AovSums, ExtraSums, GroundSums, Peak, PixelStats};
pub use view::{View, ViewTransform};

named_variants! {
    /// The denoiser of a finished picture.
    pub enum Denoise {
        /// Intel Open Image Denoise, if it is installed.
        Oidn = "oidn",
    }
}
