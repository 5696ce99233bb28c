//! Bismar as a library: builds a scene in memory, renders it with two balances and compares the pictures. Reads and writes no
//! file. `cargo run --release` in this folder.

use std::error::Error;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use bismar::film::compare::relative_to;
use bismar::integrator::PreparedScene;
use bismar::rays::Backend;
use bismar::render::{Balance, RenderSettings, render};
use bismar::scene::{Material, Scene, build};
use glam::{DVec3, Vec3};

fn main() -> Result<(), Box<dyn Error>> {
    let scene = PreparedScene::build(Arc::new(scene()), Backend::Embree)?;
    let picture = |balance: Balance| -> bismar::Result<Vec<Vec3>> {
        let settings = RenderSettings { width: 96, height: 64, spp: Some(128), balance, ..RenderSettings::even() };
        let film = render(&scene, &settings, &AtomicBool::new(false), &|_| ())?.film();
        Ok(film.pixels.iter().map(|pixel| pixel.mean().into()).collect())
    };
    let (half, progressive) = (picture(Balance::Half)?, picture(Balance::Progressive)?);
    for (name, picture) in [("half", &half), ("progressive", &progressive)] {
        let mean = picture.iter().sum::<Vec3>() / picture.len() as f32;
        println!("{name:12} mean radiance {mean:.4}");
    }
    let mean_error = rel_mse(&half, &progressive);
    println!("relMSE of half against progressive: {mean_error:.6}");
    // Both are right: their difference is noise.
    if mean_error > 0.0 && mean_error < 0.1 { Ok(()) } else { Err("the pictures do not agree".into()) }
}

/// Mean of (a - b)² / (b² + 0.01) over pixels and channels, as `bismar compare` prints.
fn rel_mse(a: &[Vec3], b: &[Vec3]) -> f64 {
    let pairs = a.iter().zip(b).flat_map(|(a, b)| a.to_array().into_iter().zip(b.to_array()));
    let sum: f64 = pairs.map(|(a, b)| f64::from(a - b).powi(2) / relative_to(b.into())).sum();
    sum / (3 * a.len()) as f64
}

/// A glossy floor and a white wall under a small area light; corners are counter-clockwise, in metres.
fn scene() -> Scene {
    let mut scene = Scene::default();
    let mut add = |corners: [[f64; 3]; 4], material: Material| {
        build::add_shape(&mut scene, &build::quad(corners.map(DVec3::from_array)), material);
    };
    add([[-2.0, 0.0, 2.0], [2.0, 0.0, 2.0], [2.0, 0.0, -2.0], [-2.0, 0.0, -2.0]], build::metal(0.25));
    add([[-2.0, 0.0, -2.0], [2.0, 0.0, -2.0], [2.0, 3.0, -2.0], [-2.0, 3.0, -2.0]], build::lambert(0.7));
    add([[-0.3, 2.2, -0.8], [0.3, 2.2, -0.8], [0.3, 2.2, -0.2], [-0.3, 2.2, -0.2]], build::area_light(20.0));
    build::look(&mut scene, [0.0, 1.0, 4.0], [0.0, 1.0, 0.0], 0.8);
    scene
}
