//! Decides whether light samples of the environment are drawn by the compensated density (radiance above the mean; MIS
//! compensation, Karlík et al. 2019). A pre-pass at low resolution compares both densities over all surfaces. Its result
//! depends only on the scene, the view and settings, so that every part, crop and session decides alike.

use std::sync::atomic::AtomicBool;
use std::time::Instant;

use tracing::debug;

use super::effort;
use super::low_resolution::low_resolution;
use super::rounds::{Decided, Round, RoundPixel, Wanted, trace};
use crate::film::compare::{relative_to, sums_without_outliers};
use crate::integrator::{PreparedScene, Proposal, Transport};
use crate::light::{Density, LightProposal};
use crate::render::pass::decisions::TechniqueStats;
use crate::render::settings::RenderSettings;
use crate::render::settings::techniques::{Choice, Technique};
use crate::sampling::hash;

/// Paths per pixel of the pre-pass, for each density.
const PATHS_PER_PIXEL: u32 = 16;

/// Is the environment sampled by the compensated density?
pub struct Compensation(TechniqueStats);

impl Decided for Compensation {
    fn stats(&self) -> (Technique, TechniqueStats) {
        (Technique::Compensation, self.0)
    }

    fn apply<'a>(&'a self, proposal: Proposal<'a>) -> Proposal<'a> {
        let density = if self.0.on { Density::Compensated } else { Density::Radiance };
        Proposal { lights: LightProposal { density, ..proposal.lights }, ..proposal }
    }
}

impl Compensation {
    /// Decides by which density the paths of `transport`, a render with these settings, sample the environment. `None` where
    /// there is nothing to decide: the density is then the radiance. Ends soon after `stop` is raised.
    pub fn decide(
        scene: &PreparedScene,
        settings: &RenderSettings,
        transport: &Transport,
        stop: &AtomicBool,
    ) -> Option<Self> {
        let began = Instant::now();
        let uneven = || scene.lights.environment.as_ref().is_some_and(|environment| environment.has_compensated());
        // The table of the compensated density is as large as the plain one: it is made only where it may be used.
        if !settings.asks_for(Technique::Compensation) || !uneven() {
            return None;
        }
        if settings.techniques[Technique::Compensation] == Choice::On {
            return Some(Self(TechniqueStats { on: true, ..Default::default() }));
        }
        let ([width, height], camera) = low_resolution(scene, settings, effort::compensation_pixels(settings.pixels()));
        let [plain, compensated] = [Density::Radiance, Density::Compensated].map(|density| {
            let seed = hash(transport.seed ^ hash(0x736b_7921));
            let lights = LightProposal { density, ..transport.proposal.lights };
            let proposal = Proposal { lights, ..transport.proposal };
            let transport = Transport { camera: camera.clone(), seed, proposal, ..transport.clone() };
            trace(&transport, [width, height], (0, PATHS_PER_PIXEL), Wanted::default(), stop)
        });
        let remaining = remaining_variance(&plain?, &compensated?);
        debug!(
            "the environment's compensated density leaves {remaining:.2} of the variance, by {width} x {height} pixels"
        );
        Some(Self(TechniqueStats {
            on: remaining < effort::MAX_REMAINING_PROMISING,
            // Infinite where nothing varies.
            remaining: Some(if remaining.is_finite() { remaining } else { 1.0 }),
            seconds: began.elapsed().as_secs_f64(),
            ..Default::default()
        }))
    }
}

/// Relative variance with the compensated density over that with the plain one, over the pixels of two rounds. Infinite if the
/// plain variance is 0.
fn remaining_variance(plain: &Round, compensated: &Round) -> f64 {
    let of = |(a, b): (&RoundPixel, &RoundPixel)| {
        // With so many paths a pixel has a mean of its own; that of both, so that noise favours neither.
        let divisor = relative_to(0.5 * f64::from(a.mean + b.mean));
        [a.variance / divisor, b.variance / divisor]
    };
    let pixels = plain.pixels.iter().zip(&compensated.pixels).map(of).collect();
    let [plain, compensated] = sums_without_outliers(pixels);
    if plain > 0.0 { compensated / plain } else { f64::INFINITY }
}

#[cfg(test)]
mod tests {
    use super::{Round, RoundPixel};

    /// A pixel with this mean and variance.
    fn pixel(mean: f64, variance: f64) -> RoundPixel {
        RoundPixel { variance, divisor: 1.0, mean: mean as f32 }
    }

    fn remaining_variance(plain: &[RoundPixel], compensated: &[RoundPixel]) -> f64 {
        let round = |pixels: &[RoundPixel]| Round { pixels: pixels.into(), ..Default::default() };
        super::remaining_variance(&round(plain), &round(compensated))
    }

    #[test]
    fn what_is_left_counts_relative_errors_and_no_pixel_alone() {
        let all = |pixel| vec![pixel; 200];
        let half = remaining_variance(&all(pixel(1.0, 2.0)), &all(pixel(1.0, 1.0)));
        assert!((half - 0.5).abs() < 1e-6, "{half}");
        // Dark pixels count as bright ones: here nine tenths and the half of it.
        let both = |bright: f64, dark: f64| [all(pixel(10.0, 100.0 * bright)), all(pixel(1.0, dark))].concat();
        let three_quarters = remaining_variance(&both(1.0, 1.0), &both(1.0, 0.5));
        assert!((three_quarters - 0.75).abs() < 1e-2, "{three_quarters}");
        let mut firefly = all(pixel(1.0, 1.0));
        firefly[7] = pixel(50.0, 1e6);
        assert!((remaining_variance(&all(pixel(1.0, 2.0)), &firefly) - 0.5).abs() < 1e-6);
        firefly[8] = pixel(f64::NAN, 1.0);
        assert!((remaining_variance(&all(pixel(1.0, 2.0)), &firefly) - 0.5).abs() < 1e-2);
        assert_eq!(remaining_variance(&all(pixel(0.0, 0.0)), &all(pixel(0.0, 0.0))), f64::INFINITY);
        assert_eq!(remaining_variance(&[], &[]), f64::INFINITY);
    }
}
