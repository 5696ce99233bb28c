//! Colour in linear Rec. 709 RGB.

use glam::{DMat3, DVec3, Mat3, Vec3, dvec3};

named_variants! {
    /// A space of linear RGB colours.
    pub enum ColorSpace {
        /// The primaries of sRGB.
        Rec709 = "rec709",
        /// ACEScg: AP1.
        Acescg = "acescg",
        /// ITU-R BT.2020.
        Rec2020 = "rec2020",
    }
}

impl ColorSpace {
    /// CIE x and y of red, green, blue and white, as in OpenEXR's attribute.
    pub fn chromaticities(self) -> [f32; 8] {
        match self {
            Self::Rec709 => REC709,
            Self::Acescg => [0.713, 0.293, 0.165, 0.830, 0.128, 0.044, 0.32168, 0.33767],
            Self::Rec2020 => [0.708, 0.292, 0.170, 0.797, 0.131, 0.046, D65[0], D65[1]],
        }
    }

    /// From Rec. 709, by Bradford's adaptation of white.
    pub fn from_rec709(self) -> Mat3 {
        let back = rec709_from_rgb(self.chromaticities()).unwrap_or(Mat3::IDENTITY);
        back.as_dmat3().inverse().as_mat3()
    }
}

/// Relative luminance of linear Rec. 709 RGB.
#[inline]
pub fn luminance(c: Vec3) -> f32 {
    0.2126 * c.x + 0.7152 * c.y + 0.0722 * c.z
}

/// White point of Rec. 709 (D65), CIE xy.
const D65: [f32; 2] = [0.3127, 0.3290];
/// Chromaticities of Rec. 709: x and y of red, green, blue and white.
const REC709: [f32; 8] = [0.64, 0.33, 0.30, 0.60, 0.15, 0.06, D65[0], D65[1]];

/// XYZ of these CIE xy with X + Y + Z = 1.
fn xyz([x, y]: [f32; 2]) -> DVec3 {
    let (x, y) = (f64::from(x), f64::from(y));
    dvec3(x, y, 1.0 - x - y)
}

/// XYZ of white with these CIE xy: Y = 1.
fn white_xyz(white: [f32; 2]) -> DVec3 {
    xyz(white) / f64::from(white[1])
}

/// From RGB with these chromaticities to XYZ. `None` if the primaries lie on a line, but for the rounding of 32-bit floats.
fn xyz_from_rgb([rx, ry, gx, gy, bx, by, wx, wy]: [f32; 8]) -> Option<DMat3> {
    let primaries = DMat3::from_cols(xyz([rx, ry]), xyz([gx, gy]), xyz([bx, by]));
    let matrix = primaries * DMat3::from_diagonal(primaries.inverse() * white_xyz([wx, wy]));
    (primaries.determinant().abs() > 1e-6).then_some(matrix)
}

/// From XYZ with this white point (CIE xy) to Rec. 709, by Bradford's adaptation of white (Lam 1985). `None` if it is not
/// finite.
pub(crate) fn rec709_from_xyz(white: [f32; 2]) -> Option<Mat3> {
    let cones = DMat3::from_cols_array(&[0.8951, -0.7502, 0.0389, 0.2664, 1.7135, -0.0685, -0.1614, 0.0367, 1.0296]);
    let scale = DMat3::from_diagonal((cones * white_xyz(D65)) / (cones * white_xyz(white)));
    let matrix = (xyz_from_rgb(REC709)?.inverse() * cones.inverse() * scale * cones).as_mat3();
    matrix.is_finite().then_some(matrix)
}

/// From RGB with these chromaticities (x and y of red, green, blue and white, as in OpenEXR's attribute) to Rec. 709. The
/// identity if they are those of Rec. 709; `None` if they are no colour space's. XYZ is one: (1, 0), (0, 1), (0, 0).
pub(crate) fn rec709_from_rgb(chromaticities: [f32; 8]) -> Option<Mat3> {
    if chromaticities.iter().zip(REC709).all(|(a, b)| (a - b).abs() < 1e-3) {
        return Some(Mat3::IDENTITY);
    }
    let [.., wx, wy] = chromaticities;
    let matrix = (rec709_from_xyz([wx, wy])?.as_dmat3() * xyz_from_rgb(chromaticities)?).as_mat3();
    matrix.is_finite().then_some(matrix)
}

#[cfg(test)]
mod tests {
    use glam::vec3;

    use super::*;

    #[test]
    fn acescg_and_rec2020_become_rec709() {
        // Published matrices: ACES (AP1 to sRGB, Bradford) and ITU-R BT.2407.
        let ap1 = rec709_from_rgb(ColorSpace::Acescg.chromaticities()).unwrap();
        let rec2020 = rec709_from_rgb(ColorSpace::Rec2020.chromaticities()).unwrap();
        let color = vec3(0.3, 0.5, 0.2);
        for (matrix, rows) in [
            (ap1, [[1.70505, -0.62179, -0.08326], [-0.13026, 1.14080, -0.01055], [-0.02400, -0.12897, 1.15297]]),
            (rec2020, [[1.6605, -0.5876, -0.0728], [-0.1246, 1.1329, -0.0083], [-0.0182, -0.1006, 1.1187]]),
        ] {
            let right = Mat3::from_cols_array_2d(&rows).transpose() * color;
            assert!((matrix * color).abs_diff_eq(right, 2e-4), "{} for {right}", matrix * color);
        }
        assert!((ColorSpace::Acescg.from_rec709() * (ap1 * color)).abs_diff_eq(color, 1e-6));
        assert_eq!(ColorSpace::Rec709.from_rec709(), Mat3::IDENTITY);
        assert_eq!(rec709_from_rgb(REC709), Some(Mat3::IDENTITY));
        // XYZ as OpenEXR's documentation states it.
        let equal = [1.0 / 3.0; 2];
        let xyz = rec709_from_rgb([1.0, 0.0, 0.0, 1.0, 0.0, 0.0, equal[0], equal[1]]).unwrap();
        assert!(xyz.abs_diff_eq(rec709_from_xyz(equal).unwrap(), 1e-6), "{xyz}");
        let line = [0.1, 0.1, 0.2, 0.2, 0.3, 0.3, 0.3127, 0.3290];
        for senseless in [[0.0; 8], [f32::NAN; 8], [0.3; 8], line] {
            assert_eq!(rec709_from_rgb(senseless), None, "{senseless:?}");
        }
    }
}
