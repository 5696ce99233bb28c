//! One scene under every balance, each held against a long render: relMSE at equal paths.
//! `cargo run --release --example balances -- SCENE.glb`.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use bismar::film::compare::relative_to;
use bismar::integrator::PreparedScene;
use bismar::rays::Backend;
use bismar::render::{Balance, RenderSettings, render};
use bismar::scene::import;
use bismar::{Error, Result};

fn main() -> Result<()> {
    let path = std::env::args_os().nth(1).map(PathBuf::from).ok_or_else(|| Error::Usage("which scene?".into()))?;
    let mut scene = import::import(&path, &Default::default())?.scene;
    scene.light_if_dark();
    let scene = PreparedScene::build(Arc::new(scene), Backend::Embree)?;

    let picture = |balance, spp, seed| -> Result<Vec<[f32; 3]>> {
        let settings =
            RenderSettings { width: 160, height: 90, spp: Some(spp), balance, seed, ..RenderSettings::even() };
        let film = render(&scene, &settings, &AtomicBool::new(false), &|_| ())?.film();
        Ok(film.pixels.iter().map(|pixel| pixel.mean()).collect())
    };
    let reference = picture(Balance::Half, 4096, 1)?;
    for &balance in Balance::all() {
        let taken = picture(balance, 128, 0)?;
        let values = taken.iter().flatten().zip(reference.iter().flatten());
        let error = |(&x, &y): (&f32, &f32)| (f64::from(x) - f64::from(y)).powi(2) / relative_to(f64::from(y));
        let mean = values.map(error).sum::<f64>() / (3 * taken.len()) as f64;
        println!("{:16} {mean:.6}", balance.name());
    }
    Ok(())
}
