//! Mrays/s of one thread and both backends: `cargo bench --bench rays`.

#[path = "../tests/rays/scenes.rs"]
mod scenes;

use std::sync::Arc;
use std::time::Instant;

use bismar::rays::cwbvh::{ObvhsOptions, ObvhsRays};
use bismar::rays::embree::{EmbreeOptions, EmbreeRays};
use bismar::rays::{HitBatch, RayBatch, RayOrder, RayQueries};

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

fn main() {
    println!("scene | backend | build ms | MB | camera | bounce | bounce occluded | shadow");
    for (name, scene) in [("room", scenes::box_room()), ("blob", scenes::blob())] {
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
        let shadow = scenes::shadow_rays(&bounce);
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
