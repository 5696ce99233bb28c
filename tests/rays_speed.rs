//! temp
#[path = "rays/scenes.rs"]
mod scenes;
use scenes::*;
use std::sync::Arc;
use std::time::Instant;
use bismar::rays::embree::*;
use bismar::rays::*;

#[test]
#[ignore]
fn speed() {
    for (name, scene) in [("room", box_room()), ("blob", blob())] {
        let scene = Arc::new(scene);
        let base = EmbreeRays::build(scene.clone(), &EmbreeOptions::default()).unwrap();
        println!("{name} {:?}", base.info());
        let camera = camera_rays(1024);
        let mut hits = HitBatch::default();
        base.closest_hits(&camera, RayOrder::Incoherent, &mut hits);
        let bounced = bounce(&scene, &camera, &hits);
        let shadow = shadow_rays(&bounced);
        for isa in [None, Some("avx2")] {
        for (stream, rays) in [("camera", &camera), ("bounce", &bounced)] {
            for width in [1, 8, 16] { for coherent in [false] {
                let e = EmbreeRays::build(scene.clone(), &EmbreeOptions { threads: 0, width, coherent, isa: isa.map(String::from) }).unwrap();
                let batches = pieces(rays, 4096);
                let mut best = f64::MAX;
                for _ in 0..9 { let s = Instant::now(); for b in &batches { e.closest_hits(b, RayOrder::Coherent, &mut hits); } best = best.min(s.elapsed().as_secs_f64()); }
                println!("{isa:?} {stream} {width} coh={coherent} {:.1} Mrays/s", rays.len() as f64 / best / 1e6);
            }}
        }
        for (stream, rays) in [("shadow", &shadow), ("bounce-occl", &bounced)] {
            for width in [1, 8, 16] { for coherent in [false] {
                let e = EmbreeRays::build(scene.clone(), &EmbreeOptions { threads: 0, width, coherent, isa: isa.map(String::from) }).unwrap();
                let batches = pieces(rays, 4096);
                let mut best = f64::MAX; let mut o = Vec::new();
                for _ in 0..9 { let s = Instant::now(); for b in &batches { e.occluded(b, RayOrder::Coherent, &mut o); } best = best.min(s.elapsed().as_secs_f64()); }
                println!("{isa:?} {stream} {width} coh={coherent} {:.1} Mrays/s", rays.len() as f64 / best / 1e6);
            }}
        }
    }}}
