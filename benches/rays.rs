//! Mrays/s of one thread and both backends: `cargo bench --bench rays`.

// Tests use more of these.
#[allow(dead_code)]
#[path = "../tests/helpers/random.rs"]
mod random;
#[allow(dead_code)]
#[path = "../tests/helpers/ray_scenes.rs"]
mod scenes;

use std::f32::consts::PI;
use std::sync::Arc;
use std::time::Instant;

use bismar::rays::cwbvh::{ObvhsOptions, ObvhsRays};
use bismar::rays::embree::{EmbreeOptions, EmbreeRays};
use bismar::rays::{HitBatch, RayBatch, RayOrder, RayQueries};
use bismar::scene::{Mesh, Scene};
use glam::{Vec3, vec3};

use random::Random;
use scenes::{quad, scene};

/// Rays a batch, as in a tile of 64 x 64.
const BATCH: usize = 4096;

/// The best of some runs over the batches.
fn rate(rays: &RayBatch, mut query: impl FnMut(&RayBatch)) -> f64 {
    let batches = scenes::pieces(rays, BATCH);
    let mut seconds = || {
        let start = Instant::now();
        batches.iter().for_each(&mut query);
        start.elapsed().as_secs_f64()
    };
    let best = (0..9).map(|_| seconds()).fold(f64::INFINITY, f64::min);
    rays.len() as f64 / best / 1e6
}

/// A bumpy sphere of 490,000 triangles over a ground plane, in [-1, 1]³.
fn blob() -> Scene {
    let (columns, rows) = (700_u32, 350_u32);
    let mut vertices = Vec::new();
    for row in 0..=rows {
        for column in 0..columns {
            let theta = PI * row as f32 / rows as f32;
            let phi = 2.0 * PI * column as f32 / columns as f32;
            let radius =
                0.7 + 0.05 * (9.0 * theta).sin() * (11.0 * phi).cos() + 0.01 * (61.0 * theta + 40.0 * phi).sin();
            vertices.push((radius * vec3(theta.sin() * phi.cos(), theta.cos(), theta.sin() * phi.sin())).to_array());
        }
    }
    let mut indices = Vec::new();
    for row in 0..rows {
        for column in 0..columns {
            let next = (column + 1) % columns;
            let at = |row: u32, column: u32| row * columns + column;
            indices.push([at(row, column), at(row + 1, column), at(row + 1, next)]);
            indices.push([at(row, column), at(row + 1, next), at(row, next)]);
        }
    }
    let ground = [(-3.0, -3.0), (-3.0, 3.0), (3.0, 3.0), (3.0, -3.0)].map(|(x, z)| vec3(x, -0.8, z));
    quad(&mut vertices, &mut indices, ground);
    scene(vec![Mesh::new(vertices, indices)], &[(0, None)])
}

/// Rays from the origins of `rays` to the area light.
fn shadow_rays(rays: &RayBatch) -> RayBatch {
    let mut random = Random(3);
    let mut shadows = RayBatch::default();
    for at in 0..rays.len() {
        let origin: Vec3 = std::array::from_fn(|axis| rays.origin[axis][at]).into();
        let emitter = vec3(random.f32() * 0.5 - 0.25, 0.98, random.f32() * 0.5 - 0.25);
        let distance = (emitter - origin).length();
        shadows.push(origin, (emitter - origin) / distance, 0.0, distance * 0.999, random.bits());
    }
    shadows
}

fn main() {
    println!("scene | backend | build ms | MB | camera | bounce | bounce occluded | shadow");
    for (name, scene) in [("room", scenes::box_room()), ("blob", blob())] {
        let scene = Arc::new(scene);
        let embree = |isa| {
            EmbreeRays::build(scene.clone(), &EmbreeOptions { isa, ..EmbreeOptions::default() }, &|_| true).unwrap()
        };
        let backends: [Box<dyn RayQueries>; 3] = [
            Box::new(embree(None)),
            Box::new(embree(Some("avx2"))),
            Box::new(ObvhsRays::build(scene.clone(), &ObvhsOptions::default(), &|_| true).unwrap()),
        ];
        let camera = scenes::camera_rays(1024);
        let mut hits = HitBatch::default();
        backends[0].closest_hits(&camera, RayOrder::Coherent, &mut hits);
        let bounce = scenes::bounce(&scene, &camera, &hits);
        let shadow = shadow_rays(&bounce);
        for backend in &backends {
            let mut flags = Vec::new();
            let camera = rate(&camera, |rays| backend.closest_hits(rays, RayOrder::Coherent, &mut hits));
            let closest = rate(&bounce, |rays| backend.closest_hits(rays, RayOrder::Incoherent, &mut hits));
            let blocked = rate(&bounce, |rays| backend.occluded(rays, RayOrder::Incoherent, &mut flags));
            let shadow = rate(&shadow, |rays| backend.occluded(rays, RayOrder::Incoherent, &mut flags));
            let info = backend.info();
            println!(
                "{name} | {} {} | {:.1} | {:.2} | {camera:.1} | {closest:.1} | {blocked:.1} | {shadow:.1}",
                info.name,
                info.isa,
                info.build_seconds * 1e3,
                info.memory_bytes as f64 / 1e6,
            );
        }
    }
}
