//! View transforms from linear radiance to display-encoded colour.

use std::path::PathBuf;
use std::sync::Arc;

use super::lut::Lut;

named_variants! {
    /// A view transform from linear RGB (Rec. 709 primaries) to display-encoded colour.
    pub enum View {
        /// AgX, base look: a soft shoulder; bright colours desaturate as on film.
        Agx = "agx",
        /// Khronos PBR Neutral: keeps base colours and compresses highlights.
        Neutral = "neutral",
        /// ACES as fitted by Hill, as Khronos' render fidelity suite shows it.
        Aces = "aces",
        /// The sRGB transfer function alone; values above 1 clip.
        Srgb = "srgb",
    }
}

/// A view transform of a name, or of a file.
#[derive(Debug, Clone)]
pub enum ViewTransform {
    Named(View),
    /// A LUT, its file, and a text that differs for other tables and inputs.
    Lut(Arc<Lut>, PathBuf, String),
}

impl From<View> for ViewTransform {
    fn from(view: View) -> Self {
        Self::Named(view)
    }
}

impl ViewTransform {
    /// Its name; of a LUT the file's.
    pub fn name(&self) -> String {
        match self {
            Self::Named(view) => view.name().into(),
            Self::Lut(_, path, _) => path.display().to_string(),
        }
    }

    /// A text that differs for views that show other colours.
    pub fn key(&self) -> &str {
        match self {
            Self::Named(view) => view.name(),
            Self::Lut(.., key) => key,
        }
    }

    /// [`View::apply`]. A LUT also takes negative radiance, of colours outside Rec. 709.
    pub fn apply(&self, radiance: [f32; 3], exposure_ev: f32) -> [f32; 3] {
        match self {
            Self::Named(view) => view.apply(radiance, exposure_ev),
            Self::Lut(lut, ..) => {
                let gain = exposure_ev.exp2();
                let finite = |x: f32| if x.is_nan() { 0.0 } else { x.clamp(-1e30, 1e30) };
                lut.apply(radiance.map(|x| finite(x * gain))).to_array().map(|x| x.clamp(0.0, 1.0))
            }
        }
    }
}

impl View {
    /// Display-encoded RGB in [0, 1] of linear radiance at an exposure in stops. It is never NaN: NaN and negative radiance count
    /// as black, infinite radiance as very bright.
    pub fn apply(self, radiance: [f32; 3], exposure_ev: f32) -> [f32; 3] {
        let gain = exposure_ev.exp2();
        // The bound keeps the sums below finite.
        let finite = |x: f32| if x.is_nan() { 0.0 } else { x.clamp(0.0, 1e30) };
        let color = radiance.map(|x| finite(x * gain));
        let display = match self {
            View::Agx => agx(color),
            View::Neutral => pbr_neutral(color).map(srgb_encode),
            View::Aces => aces(color).map(|x| x.max(0.0).powf(1.0 / 2.2)),
            View::Srgb => color.map(srgb_encode),
        };
        display.map(|x| x.clamp(0.0, 1.0))
    }
}

/// The sRGB transfer function (IEC 61966-2-1), linear to encoded, on [0, 1]; larger values clip.
pub fn srgb_encode(linear: f32) -> f32 {
    let x = linear.clamp(0.0, 1.0);
    if x <= 0.003_130_8 { 12.92 * x } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 }
}

/// The inverse of [`srgb_encode`], on [0, 1].
pub fn srgb_decode(x: f32) -> f32 {
    if x <= 0.040_45 { x / 12.92 } else { ((x + 0.055) / 1.055).powf(2.4) }
}

/// AgX by Troy Sobotka (github.com/sobotka/AgX): inset towards grey, log2 over 16.5 stops around 0.18, a contrast
/// curve, outset. The curve is the sixth-degree polynomial that B. Wrensch fitted to it ("Minimal AgX
/// Implementation", 2023; mean squared error 3.7e-6), and so are the matrices' digits. The result is display-encoded
/// for a 2.2 power curve; no further encoding follows.
fn agx(color: [f32; 3]) -> [f32; 3] {
    const INSET: [[f32; 3]; 3] = [
        [0.842_479_06, 0.078_433_6, 0.079_223_745],
        [0.042_328_242, 0.878_468_64, 0.079_166_13],
        [0.042_375_655, 0.078_433_6, 0.879_143],
    ];
    const OUTSET: [[f32; 3]; 3] = [
        [1.196_879, -0.098_020_88, -0.099_029_74],
        [-0.052_896_85, 1.151_903_1, -0.098_961_18],
        [-0.052_971_635, -0.098_043_45, 1.151_073_7],
    ];
    const MIN_EV: f32 = -12.473_93;
    const MAX_EV: f32 = 4.026_069;
    let log = multiply(&INSET, color).map(|x| (x.max(1e-10).log2().clamp(MIN_EV, MAX_EV) - MIN_EV) / (MAX_EV - MIN_EV));
    multiply(&OUTSET, log.map(agx_contrast))
}

fn agx_contrast(x: f32) -> f32 {
    const FIT: [f32; 7] = [15.5, -40.14, 31.96, -6.868, 0.4298, 0.1191, -0.002_32];
    FIT.iter().fold(0.0, |sum, &coefficient| sum * x + coefficient)
}

fn multiply(rows: &[[f32; 3]; 3], v: [f32; 3]) -> [f32; 3] {
    rows.map(|row| row[0] * v[0] + row[1] * v[1] + row[2] * v[2])
}

/// Khronos PBR Neutral, after its specification (github.com/KhronosGroup/ToneMapping, PBR_Neutral). Linear to linear:
/// takes the 4 % of a dielectric's Fresnel reflection off, leaves what is below 0.76 alone, compresses the peak
/// above that towards 1 and lets it lose colour.
fn pbr_neutral(color: [f32; 3]) -> [f32; 3] {
    const FRESNEL: f32 = 0.04;
    const START: f32 = 0.8 - FRESNEL;
    const DESATURATION: f32 = 0.15;
    let least = color[0].min(color[1]).min(color[2]);
    let offset = if least < 2.0 * FRESNEL { least - least * least / (4.0 * FRESNEL) } else { FRESNEL };
    let color = color.map(|x| x - offset);
    let peak = color[0].max(color[1]).max(color[2]);
    if peak < START {
        return color;
    }
    let room = 1.0 - START;
    let new_peak = 1.0 - room * room / (peak + room - START);
    let white = 1.0 - 1.0 / (DESATURATION * (peak - new_peak) + 1.0);
    color.map(|x| {
        let x = x * (new_peak / peak);
        x + (new_peak - x) * white
    })
}

/// The ACES reference rendering and output transforms (sRGB) as Stephen Hill fitted them: a matrix, a rational curve, a matrix
/// (github.com/TheRealMJP/BakingLab, ACES.hlsl), of the radiance over 0.6, as viewers of glTF apply them. Linear to linear.
fn aces(color: [f32; 3]) -> [f32; 3] {
    const INPUT: [[f32; 3]; 3] =
        [[0.597_19, 0.354_58, 0.048_23], [0.076, 0.908_34, 0.015_66], [0.028_4, 0.133_83, 0.837_77]];
    const OUTPUT: [[f32; 3]; 3] =
        [[1.604_75, -0.531_08, -0.073_67], [-0.102_08, 1.108_13, -0.006_05], [-0.003_27, -0.072_76, 1.076_02]];
    multiply(&OUTPUT, multiply(&INPUT, color.map(|x| x / 0.6)).map(aces_curve))
}

fn aces_curve(x: f32) -> f32 {
    // The limit, before squares overflow.
    let x = x.min(1e15);
    (x * (x + 0.024_578_6) - 0.000_090_537) / (x * (0.983_729 * x + 0.432_951) + 0.238_081)
}

#[cfg(test)]
mod tests {
    use super::*;

    const VIEWS: [View; 4] = View::ALL;

    fn close(a: f32, b: f32, tolerance: f32) {
        assert!((a - b).abs() <= tolerance, "{a} is not {b} within {tolerance}");
    }

    #[test]
    fn mid_grey_lands_where_the_published_formulas_put_it() {
        let grey = |view: View| {
            let [r, g, b] = view.apply([0.18; 3], 0.0);
            close(r, g, 1e-4);
            close(g, b, 1e-4);
            g
        };
        // AgX's curve has its pivot at 0.18 -> 0.5; the fit's root mean squared error is 1.9e-3, twice that is allowed.
        close(grey(View::Agx), 0.5, 3.8e-3);
        // Neutral: 0.18 - 0.04 = 0.14 linear, sRGB-encoded.
        close(grey(View::Neutral), 1.055 * 0.14_f32.powf(1.0 / 2.4) - 0.055, 1e-5);
        // The matrices' rows sum to 1: grey passes the curve alone. Of 0.3 it is 0.09728 / 0.45650.
        close(grey(View::Aces), (0.097_283_f32 / 0.456_502).powf(1.0 / 2.2), 1e-4);
        close(grey(View::Srgb), 0.461_356, 1e-5);
    }

    #[test]
    fn black_is_black_and_white_is_reached() {
        for view in VIEWS {
            for channel in view.apply([0.0; 3], 0.0) {
                close(channel, 0.0, 1.0 / 512.0);
            }
            for channel in view.apply([1e6; 3], 0.0) {
                close(channel, 1.0, 1.0 / 256.0);
            }
        }
    }

    #[test]
    fn greys_stay_in_order() {
        for view in VIEWS {
            let mut last = -1.0;
            for step in -600..=300 {
                let grey = view.apply([(step as f32 / 40.0).exp2(); 3], 0.0)[1];
                assert!(grey >= last, "{view:?} falls at 2^{}", step as f32 / 40.0);
                last = grey;
            }
        }
    }

    #[test]
    fn neutral_only_takes_the_fresnel_offset_off_below_its_shoulder() {
        let out = pbr_neutral([0.7, 0.3, 0.1]);
        for (a, b) in out.iter().zip([0.66, 0.26, 0.06]) {
            close(*a, b, 1e-6);
        }
        // Khronos' base colour promise: a dielectric lit by 1 shows base colour + 0.04 as the base colour.
        close(pbr_neutral([0.8 - 1e-4; 3])[0], 0.76 - 1e-4, 1e-6);
        // At the specification's seam of the offset (x = 0.08) both branches agree.
        close(pbr_neutral([0.08 - 1e-6; 3])[0], pbr_neutral([0.08 + 1e-6; 3])[0], 1e-5);
    }

    #[test]
    fn neutral_bright_white_follows_the_specification() {
        // x = 1: offset 0.04, peak 0.96, room 0.24, new peak 1 - 0.24^2 / (0.96 + 0.24 - 0.76).
        close(pbr_neutral([1.0; 3])[0], 1.0 - 0.0576 / 0.44, 1e-6);
    }

    #[test]
    fn exposure_counts_stops() {
        assert_eq!(View::Srgb.apply([0.1, 0.05, 0.2], 1.0), View::Srgb.apply([0.2, 0.1, 0.4], 0.0));
    }

    #[test]
    fn nan_and_infinity_give_a_colour_all_the_same() {
        for view in VIEWS {
            for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, -1.0, f32::MAX] {
                for ev in [-200.0, 0.0, 200.0] {
                    let out = view.apply([bad, 0.5, bad], ev);
                    assert!(out.iter().all(|x| (0.0..=1.0).contains(x)), "{view:?} {bad} {ev}: {out:?}");
                }
            }
        }
    }
}
