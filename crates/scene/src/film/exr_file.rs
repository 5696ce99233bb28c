//! OpenEXR files: films are written ([`write()`]), and any RGB picture is read ([`read()`]).

mod attributes;
mod bounds;
mod channels;
mod checksum;
mod head;
mod read;
mod write;

pub use super::header::{CALIBRATION, Header, HeaderValue, MEAN_VARIANCE, RELATED, WORLD_TO_CAMERA, WORLD_TO_NDC};
pub use channels::{ChannelBits, read_bits};
pub use checksum::{CHECKSUM, Checksum, check, checksum};
pub(super) use read::cannot_use;
pub use read::{bytes_of, channels, layers, length, picture, read, read_header, read_statistics, size};
pub use write::{Layers, write, write_rgb};

#[cfg(test)]
mod hostile;
#[cfg(test)]
mod tests;
