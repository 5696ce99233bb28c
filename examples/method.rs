//! A balance method of one's own, rendered beside all others: relMSE at equal paths against a long render.
//! `cargo run --release --example method [SCENE.glb]`.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use bismar::Result;
use bismar::balance::method::take_pass_and_update;
use bismar::balance::{LearnedPixels, Method, Moments, Sampler};
use bismar::film::compare::relative_to;
use bismar::integrator::PreparedScene;
use bismar::rays::Backend;
use bismar::render::{Balance, CustomMethod, RenderSettings, render};
use bismar::scene::import::import;

/// Half of the second-order method's step: the share moves from ½ by m₁ / (8 m₂) of all samples so far.
struct HalfStep;

impl Method for HalfStep {
    fn name(&self) -> &'static str {
        "half-step"
    }

    fn about(&self) -> &'static str {
        "Half of the second-order step, after every pass"
    }

    fn sums_moments(&self) -> bool {
        true
    }

    // The share follows from the pixel's own points: the next pass needs others.
    fn scrambles_passes(&self) -> bool {
        true
    }

    fn pass(&self, learned: &mut LearnedPixels, sampler: &mut dyn Sampler, _done: u32, paths: u32) {
        let share = |moments: &Moments| 0.5 + 0.5 * (moments.second_order() - 0.5);
        take_pass_and_update(learned, sampler, paths, share);
    }
}

fn main() -> Result<()> {
    let path = std::env::args_os().nth(1).map_or("scenes/veach.glb".into(), PathBuf::from);
    let mut scene = import(&path, &Default::default())?.scene;
    scene.light_if_dark();
    let scene = PreparedScene::build(Arc::new(scene), Backend::Embree)?;
    let picture = |balance, spp, seed| -> Result<Vec<f64>> {
        let settings =
            RenderSettings { width: 96, height: 64, spp: Some(spp), balance, seed, ..RenderSettings::even() };
        let film = render(&scene, &settings, &AtomicBool::new(false), &|_| ())?.film();
        Ok(film.pixels.iter().flat_map(|pixel| pixel.mean()).map(f64::from).collect())
    };
    let reference = picture(Balance::Half, 2048, 1)?;
    let own = Balance::Custom(CustomMethod(&HalfStep));
    for &balance in Balance::all().iter().chain([&own]) {
        let taken = picture(balance, 64, 0)?;
        let error = taken.iter().zip(&reference).map(|(x, y)| (x - y).powi(2) / relative_to(*y)).sum::<f64>();
        println!("{:20} {:.5}", balance.name(), error / taken.len() as f64);
    }
    Ok(())
}
