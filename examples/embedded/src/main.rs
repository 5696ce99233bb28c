//! Bismar in a program of one's own: a scene made in memory, rendered under two balances, and how far the pictures are from
//! each other. No file is read or written: `cargo run --release` in this folder.

use std::error::Error;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use bismar::film::compare::relative_to;
use bismar::integrator::PreparedScene;
use bismar::rays::Backend;
use bismar::render::{Balance, RenderSettings, render};
use bismar::scene::{Camera, Instance, Material, Mesh, Object, Positions, Projection, Scene};
use glam::{Affine3A, Vec3, Vec4};

fn main() -> Result<(), Box<dyn Error>> {
    let scene = PreparedScene::build(Arc::new(scene()), Backend::Embree)?;
    let picture = |balance: Balance| -> Vec<Vec3> {
        let settings = RenderSettings { width: 96, height: 64, spp: Some(128), balance, ..Default::default() };
        let film = render(&scene, &settings, &AtomicBool::new(false), &|_| ()).film();
        film.pixels.iter().map(|pixel| pixel.mean().into()).collect()
    };
    let (half, progressive) = (picture(Balance::Half), picture(Balance::Progressive));
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

/// A glossy floor and a white wall under a small area light.
fn scene() -> Scene {
    let matte = Material { base_color: Vec4::new(0.7, 0.7, 0.7, 1.0), metallic: 0.0, ..Default::default() };
    let glossy = Material { metallic: 1.0, roughness: 0.25, ..matte.clone() };
    let emitter = Material { emissive: Vec3::splat(20.0), ..matte.clone() };
    let mut scene = Scene {
        cameras: vec![Camera {
            name: "camera".into(),
            projection: Projection::Perspective { yfov: 0.8 },
            aspect: None,
            to_world: Affine3A::from_translation(Vec3::new(0.0, 1.0, 4.0)),
            motion: None,
            adjacent_frames: None,
        }],
        ..Default::default()
    };
    // A corner and two edges from it; faces look along first × second.
    add(&mut scene, [-2.0, 0.0, 2.0], [4.0, 0.0, 0.0], [0.0, 0.0, -4.0], glossy);
    add(&mut scene, [-2.0, 0.0, -2.0], [4.0, 0.0, 0.0], [0.0, 3.0, 0.0], matte);
    add(&mut scene, [-0.3, 2.2, -0.8], [0.6, 0.0, 0.0], [0.0, 0.0, 0.6], emitter);
    scene
}

/// Adds a parallelogram, with an object and an instance of its own.
fn add(scene: &mut Scene, corner: [f32; 3], first: [f32; 3], second: [f32; 3], material: Material) {
    let n = scene.meshes.len() as u32;
    let [corner, first, second] = [corner, first, second].map(Vec3::from_array);
    let points = [corner, corner + first, corner + first + second, corner + second];
    scene.materials.push(material);
    let mesh = Mesh {
        positions: Positions::new(points.map(|p| p.to_array()).to_vec()),
        indices: vec![[0, 1, 2], [0, 2, 3]],
        material: n,
        ..Default::default()
    };
    scene.meshes.push(mesh.into());
    scene.objects.push(Object { name: String::new(), meshes: n..n + 1 });
    scene.instances.push(Instance { object: n, ..Default::default() });
}
