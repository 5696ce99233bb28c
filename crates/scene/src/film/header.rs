//! Attributes of OpenEXR headers.

use std::borrow::Cow;

#[derive(Debug, Clone, PartialEq)]
pub enum HeaderValue {
    /// UTF-8.
    Text(String),
    /// An OpenEXR `double`.
    Number(f64),
    /// A row-major matrix for row vectors: the value of [`WORLD_TO_CAMERA`] and [`WORLD_TO_NDC`].
    Matrix([f32; 16]),
}

/// The attribute with the matrix from world space to camera space: x to the right, y up, z along the view.
pub const WORLD_TO_CAMERA: &str = "worldToCamera";
/// The attribute with the matrix from world space to the display window: after division by w, (0, 0) is its upper left corner
/// and (1, 1) its lower right one; z has no meaning.
pub const WORLD_TO_NDC: &str = "worldToNDC";

/// The attribute with the variance of the picture's mean over that of independent paths, of R, G and B, as JSON.
pub const MEAN_VARIANCE: &str = "bismar.mean_variance";
/// The attribute with the variance of the picture's mean over that of unrelated pixels.
pub const RELATED: &str = "bismar.related";

/// The attribute with the intrinsics of a calibrated camera, in pixels of the whole picture, as JSON.
pub const CALIBRATION: &str = "bismar.calibration";

/// Named header attributes. Names are ASCII with at most 31 characters.
pub type Header = Vec<(Cow<'static, str>, HeaderValue)>;
