//! A clear sky with its sun, at infinity.

use std::f32::consts::{FRAC_PI_2, PI};
use std::fmt::{self, Display};
use std::str::FromStr;

use glam::Vec3;
use hw_skymodel::rgb::{Channel, SkyParams, SkyState};

use super::environment::Environment;
use super::lights::{PunctualKind, PunctualLight};

/// A clear sky: Hošek and Wilkie 2012, *An Analytic Model for Full Spectral Sky-Dome Radiance*, over a ground of albedo
/// `GROUND_ALBEDO`, and black below the horizon. Radiance has the unit of Mitsuba's `sunsky`: luminance over 683 · 106.857 cd/m².
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClearSky {
    /// Height of the sun above the horizon in degrees, from 0 to 90.
    elevation: f32,
    /// Direction of the sun about +y in degrees: 0 in +z, 90 in +x, as azimuths of [`Orbit`](super::Orbit).
    azimuth: f32,
    /// Haze: 1 pure air, 3 a clear day, 10 the haziest.
    turbidity: f32,
}

/// Of the ground, for light that the sky has from it. As Mitsuba's default.
const GROUND_ALBEDO: f32 = 0.3;
/// Luminance of the model's RGB data over radiance: the integral of the CIE 1931 ȳ in nanometres.
const CIE_Y: f32 = 106.856_98;
/// Rows of the environment.
const HEIGHT: u32 = 512;
/// Angle that the sun subtends, in radians.
const SUN_ANGLE: f32 = 0.5358 * PI / 180.0;

impl FromStr for ClearSky {
    type Err = String;

    /// `ELEVATION,AZIMUTH[,TURBIDITY]`, angles in degrees.
    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || "not ELEVATION,AZIMUTH[,TURBIDITY], as in 40,120 or 40,120,3".to_owned();
        let numbers = text.split(',').map(|number| number.trim().parse::<f32>());
        let numbers: Vec<_> = numbers.collect::<Result<_, _>>().map_err(|_| wrong())?;
        let (elevation, azimuth, turbidity) = match numbers[..] {
            [elevation, azimuth] => (elevation, azimuth, 3.0),
            [elevation, azimuth, turbidity] => (elevation, azimuth, turbidity),
            _ => return Err(wrong()),
        };
        if !(0.0..=90.0).contains(&elevation) || !azimuth.is_finite() || !(1.0..=10.0).contains(&turbidity) {
            return Err("elevation is from 0 to 90, turbidity from 1 to 10".into());
        }
        Ok(Self { elevation, azimuth, turbidity })
    }
}

impl Display for ClearSky {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(f, "{},{},{}", self.elevation, self.azimuth, self.turbidity)
    }
}

impl ClearSky {
    /// Elevation and azimuth in radians.
    fn radians(&self) -> (f32, f32) {
        (self.elevation.to_radians().min(FRAC_PI_2), (self.azimuth % 360.0).to_radians())
    }

    /// Unit direction toward the sun.
    fn toward_sun(&self) -> Vec3 {
        let (elevation, azimuth) = self.radians();
        let ((sin, cos), (x, z)) = (elevation.sin_cos(), azimuth.sin_cos());
        Vec3::new(x * cos, sin, z * cos)
    }

    /// The sky without the sun.
    pub fn environment(&self, strength: f32) -> Environment {
        let (elevation, turbidity) = (self.radians().0, self.turbidity);
        let sun = self.toward_sun();
        // The parameters are in the model's range.
        let state = SkyState::new(&SkyParams { elevation, turbidity, albedo: [GROUND_ALBEDO; 3] }).ok();
        let sky = Environment::made("sky", HEIGHT, |d| {
            let above = state.as_ref().filter(|_| d.y > 0.0);
            let radiance =
                |state: &SkyState, channel| state.radiance(d.y.acos(), d.angle_between(sun), channel).max(0.0) / CIE_Y;
            above.map_or([0.0; 3], |state| [Channel::R, Channel::G, Channel::B].map(|channel| radiance(state, channel)))
        });
        Environment { strength, ..sky }
    }

    /// The sun, a disc.
    pub fn sun(&self, strength: f32) -> PunctualLight {
        PunctualLight {
            name: "sun".into(),
            kind: PunctualKind::Directional,
            intensity: self.sun_irradiance() * strength,
            position: Vec3::ZERO,
            direction: -self.toward_sun(),
            range: f32::INFINITY,
            size: 0.5 * SUN_ANGLE,
            motion: Vec::new(),
        }
    }

    /// Irradiance of the sun on a surface that faces it, linear RGB, by optical depths that were fitted to the sun of Mitsuba's
    /// `sunsky`: within 2.5 % from 5 degrees on. The relative air mass is that of Kasten and Young 1989.
    fn sun_irradiance(&self) -> Vec3 {
        let elevation = self.radians().0;
        let air_mass = 1.0 / (elevation.sin() + 0.50572 * (elevation.to_degrees() + 6.07995).powf(-1.6364));
        let below = (self.turbidity as usize - 1).min(HAZE.len() - 2);
        let haze = HAZE[below] + (HAZE[below + 1] - HAZE[below]) * (self.turbidity - 1.0 - below as f32);
        let log = air_mass.ln();
        let depth = |of: [[f32; 3]; 3]| Vec3::from_array(of.map(|[depth, p, q]| depth * (log * (p + q * log)).exp()));
        SUN_ABOVE_AIR * (-depth(AIR) - depth(HAZE_COLOR) * haze).exp()
    }
}

/// Irradiance of the sun above the air.
const SUN_ABOVE_AIR: Vec3 = Vec3::new(1.8703, 1.5809, 2.0201);
/// Optical depths of air at the zenith, and p and q: at an air mass m they are m^(p + q ln m) times as much.
const AIR: [[f32; 3]; 3] = [[0.1751, 0.4412, 0.0864], [0.1691, 0.9001, 0.0021], [0.6541, 0.4934, 0.1051]];
/// The same of haze, relative to red light at the zenith.
const HAZE_COLOR: [[f32; 3]; 3] = [[1.0, 0.8933, 0.0591], [1.1081, 0.8846, 0.0601], [1.0354, 0.9221, 0.0465]];
/// Optical depths of haze for red light at the zenith, by turbidities from 1 to 10.
const HAZE: [f32; 10] = [0.0, 0.0094, 0.0252, 0.0512, 0.0794, 0.1, 0.134, 0.19, 0.2826, 0.4354];
