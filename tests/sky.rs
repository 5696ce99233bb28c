//! `--sunsky`: radiance of the sky and irradiance of its sun against those of Mitsuba 3.7's `sunsky`.

use bismar::lanes::V3;
use bismar::light::{Density, EnvironmentSampler};
use bismar::scene::ClearSky;
use glam::Vec3;

#[test]
fn the_sky_and_its_sun_are_those_of_mitsuba() {
    // Toward the zenith, the sun's side, the other, between them, and near the horizon.
    let directions = [[0.0, 1.0, 0.0], [1.0, 0.2, 0.0], [-1.0, 0.5, 0.0], [0.3, 0.3, 1.0], [0.0, 0.05, -1.0]];
    #[rustfmt::skip]
    let wanted = [
        ("5,90", [0.6437, 0.2871, 0.0387], [[0.006744, 0.01224, 0.018454], [0.292648, 0.204783, 0.094203],
            [0.030691, 0.040885, 0.045849], [0.038178, 0.048446, 0.048856], [0.061709, 0.057668, 0.033101]]),
        ("40,90,3", [1.4507, 1.1795, 0.848], [[0.021172, 0.03803, 0.077088], [0.194774, 0.252554, 0.313315],
            [0.041751, 0.075616, 0.135349], [0.06782, 0.111372, 0.17915], [0.124673, 0.172624, 0.208824]]),
        ("75,-270,8", [1.2901, 1.071, 0.8503], [[0.367868, 0.381856, 0.37717], [0.155436, 0.19559, 0.246704],
            [0.074885, 0.105049, 0.161165], [0.114527, 0.150663, 0.209813], [0.166959, 0.182356, 0.195527]]),
    ];
    for (text, sun, sky) in wanted {
        let clear: ClearSky = text.parse().unwrap();
        let sampler = EnvironmentSampler::new(&clear.environment(1.0)).unwrap();
        for (direction, wanted) in directions.into_iter().zip(sky) {
            let (found, _) = sampler.radiance_pdf(V3::splat(Vec3::from(direction).normalize()), Density::Radiance);
            let error = (found.lane(0) / Vec3::from(wanted) - 1.0).abs().max_element();
            // A pixel's interpolation beside the sun, 15 degrees away at most, is off by 1 %.
            assert!(error < 0.015, "{text} {direction:?}: {} for {wanted:?}", found.lane(0));
        }
        let light = clear.sun(2.0);
        let error = (light.intensity / (2.0 * Vec3::from(sun)) - 1.0).abs().max_element();
        assert!(error < 0.025, "{text}: {} for twice {sun:?}", light.intensity);
        let elevation: f32 = text.split(',').next().unwrap().parse().unwrap();
        let (sin, cos) = elevation.to_radians().sin_cos();
        assert!((light.direction - Vec3::new(-cos, -sin, 0.0)).length() < 1e-6, "{}", light.direction);
    }
}
