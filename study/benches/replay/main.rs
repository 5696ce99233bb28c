//! How near a render is to its limit: `make bench`, or, once the programs are built, `cargo bench -p bismar-study --bench replay -- --quick`.
//!
//! The ray batches of a real render are recorded, then the render, the same batches through the renderer's own
//! backend, and the same rays in a bare loop over Embree's calls take turns. Also: what lies between the queries,
//! threads, allocations in the steady state, set-up and memory against what they must be at least.

use std::alloc::{GlobalAlloc, Layout, System};
use std::error::Error;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Instant;

use bismar::console::host::pool;
use bismar::film::PixelStats;
use bismar::integrator::PreparedScene;
use bismar::rays::{Backend, RayQueries};
use bismar::render::{PixelFilter, RenderSettings, Rendered, render};
use bismar::scene::Scene;
use bismar::scene::import::{ImportOptions, import};
use bismar_study::clock::{process_seconds, thread_seconds};
use bismar_study::rays::replay::{Sink, answer};
use bismar_study::rays::stream::{Kind, Query, Recorder};
use rayon::ThreadPool;

mod bare;
mod blob;
#[allow(dead_code)]
#[path = "../../../scenes/generate/glb.rs"]
mod glb;
#[allow(dead_code)]
#[path = "../../../scenes/generate/mesh.rs"]
mod mesh;
#[allow(dead_code)]
#[path = "../../../scenes/generate/random.rs"]
mod random;
mod tape;

use bare::Bare;
use tape::Stopwatch;

type Outcome<T> = Result<T, Box<dyn Error + Send + Sync>>;

/// Counts allocations of all threads.
struct Counting;

static ALLOCATIONS: AtomicU64 = AtomicU64::new(0);

// SAFETY: all is passed on to the system's allocator.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATIONS.fetch_add(1, Ordering::Relaxed);
        // SAFETY: as the caller promises.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: as the caller promises.
        unsafe { System.dealloc(pointer, layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        ALLOCATIONS.fetch_add(1, Ordering::Relaxed);
        // SAFETY: as the caller promises.
        unsafe { System.realloc(pointer, layout, size) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

fn main() -> Outcome<()> {
    let quick = std::env::args().any(|a| a == "--quick");
    let (rounds, spp) = if quick { (2, 4) } else { (7, 16) };
    let file = written("blob.glb", 350)?;
    let scene = Arc::new(read(&file)?);
    let rays = bismar::rays::build(Backend::Embree, Arc::clone(&scene))?;
    println!(
        "blob, 256 x 256 pixels, {spp} spp, depth 8, box filter; processor seconds, medians of {rounds} rounds in turn\n"
    );
    replay(&scene, rays.as_ref(), rounds, spp)?;
    let prepared = PreparedScene::new(scene, rays);
    threads(&prepared, rounds, 4 * spp)?;
    allocations(&prepared)?;
    drop(prepared);
    set_up(&file, rounds)?;
    memory(quick)
}

fn written(name: &str, rings: u32) -> Outcome<PathBuf> {
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    std::fs::write(&path, blob::file(rings))?;
    Ok(path)
}

fn read(file: &Path) -> Outcome<Scene> {
    let mut scene = import(file, &ImportOptions::default())?.scene;
    scene.environment = Some(blob::sky());
    Ok(scene)
}

fn settings(spp: u32) -> RenderSettings {
    RenderSettings { width: 256, height: 256, spp: Some(spp), filter: PixelFilter::Box, ..RenderSettings::even() }
}

fn rendered(pool: &ThreadPool, scene: &PreparedScene, settings: &RenderSettings) -> Rendered {
    pool.install(|| render(scene, settings, &AtomicBool::new(false), &|_| {}).expect("valid settings"))
}

/// Middle, least and most.
fn spread(mut values: Vec<f64>) -> [f64; 3] {
    values.sort_by(f64::total_cmp);
    [values[values.len() / 2], values[0], values[values.len() - 1]]
}

/// The render against its own ray stream.
fn replay(scene: &Arc<Scene>, rays: &dyn RayQueries, rounds: usize, spp: u32) -> Outcome<()> {
    let (one, settings) = (pool(1)?, settings(spp));
    let recorder = Recorder::new(rays);
    rendered(&one, &PreparedScene::new(Arc::clone(scene), Box::new(&recorder)), &settings);
    let tape = recorder.into_tape();
    let count = |kind: Kind| tape.iter().filter(|q| q.kind == kind).map(|q| q.rays.len()).sum::<usize>();
    println!("{} batches: {} rays, {} shadow rays", tape.len(), count(Kind::Closest), count(Kind::Occluded));

    let bare = Bare::build(scene);
    let (mut whole, mut ours, mut theirs) = (Vec::new(), Vec::new(), Vec::new());
    let mut shares = Vec::new();
    for _ in 0..rounds {
        let watch = Stopwatch::new(rays);
        let prepared = PreparedScene::new(Arc::clone(scene), Box::new(&watch));
        let seconds = one.install(|| {
            let start = thread_seconds();
            render(&prepared, &settings, &AtomicBool::new(false), &|_| {}).expect("valid settings");
            thread_seconds() - start
        });
        whole.push(seconds);
        drop(prepared);
        shares.push((seconds, watch.shares()));
        let (seconds, hits) = again(rays, &tape);
        ours.push(seconds);
        // Inside Embree's calls alone.
        let queries = tape.iter().map(|q| bare::query(&bare, q.kind, q.order, &q.rays));
        let (seconds, bare_hits) = queries.fold((0.0, 0), |a, b| (a.0 + b.0, a.1 + b.1));
        theirs.push(seconds);
        // Packets decide otherwise on edges, now and then.
        if hits.abs_diff(bare_hits) > hits / 1000 {
            return Err(format!("{bare_hits} rays hit, {hits} in the renderer's backend").into());
        }
    }
    let line = |name: &str, list: &[f64]| {
        let [middle, least, most] = spread(list.to_vec());
        let ratio = spread(whole.iter().zip(list).map(|(w, l)| w / l).collect());
        println!(
            "{name:24} {middle:7.3} s ({least:.3} to {most:.3}); render is {:.2} times that ({:.2} to {:.2})",
            ratio[0], ratio[1], ratio[2]
        );
    };
    line("render, one thread", &whole);
    line("its queries again", &ours);
    line("bare Embree, 16 wide", &theirs);
    let part = |name: &str, get: fn(&tape::Shares) -> f64| {
        let [middle, ..] = spread(shares.iter().map(|(whole, s)| 100.0 * get(s) / whole).collect());
        println!("  {middle:5.1} %  {name}");
    };
    println!("where the render's time goes:");
    part("queries: camera rays", |s| s.camera_queries);
    part("queries: bounces", |s| s.bounce_queries);
    part("queries: shadow rays", |s| s.shadow_queries);
    part("shading: surfaces, light samples, BSDF samples", |s| s.shading);
    part("adding what shadow rays let through", |s| s.adding);
    part("camera rays made, paths folded into pixels, balances, tiles", |s| s.folding);
    println!();
    Ok(())
}

/// Seconds of the tape through the renderer's backend, and how many rays hit.
fn again(rays: &dyn RayQueries, tape: &[Query]) -> (f64, usize) {
    let mut sink = Sink::default();
    let (mut seconds, mut hit) = (0.0, 0);
    for query in tape {
        // The renderer has just written the rays when it asks: they are in the cache.
        let query = query.clone();
        let start = thread_seconds();
        answer(rays, &query, &mut sink);
        seconds += thread_seconds() - start;
        hit += match query.kind {
            Kind::Closest => sink.0.t.iter().take(query.rays.len()).filter(|t| t.is_finite()).count(),
            Kind::Occluded => sink.1.iter().take(query.rays.len()).filter(|o| **o).count(),
        };
    }
    (seconds, hit)
}

/// All threads against one.
fn threads(scene: &PreparedScene, rounds: usize, spp: u32) -> Outcome<()> {
    let all = std::thread::available_parallelism()?.get();
    let (one, many) = (pool(1)?, pool(all)?);
    let seconds = |pool: &ThreadPool| rendered(pool, scene, &settings(spp)).stats.render_seconds;
    let ratios = (0..rounds).map(|_| seconds(&one) / seconds(&many)).collect();
    let [middle, least, most] = spread(ratios);
    println!("{all} threads: {middle:.3} times as fast as one ({least:.3} to {most:.3})\n");
    Ok(())
}

/// Between the ends of two tiles of the last pass, on all threads.
fn allocations(scene: &PreparedScene) -> Outcome<()> {
    let seen = Mutex::new(Vec::with_capacity(1 << 16));
    let note = |p: bismar::render::Progress| {
        if let Ok(mut seen) = seen.lock() {
            seen.push((p.spp, ALLOCATIONS.load(Ordering::Relaxed)));
        }
    };
    let all = std::thread::available_parallelism()?.get();
    let spp = 64;
    let rendered =
        pool(all)?.install(|| render(scene, &settings(spp), &AtomicBool::new(false), &note).expect("valid settings"));
    let seen = seen.into_inner().expect("no thread panicked");
    let last = seen.iter().map(|s| s.0).max().unwrap_or(0);
    let pass: Vec<u64> = seen.iter().filter(|s| s.0 == last).map(|s| s.1).collect();
    let [Some(first), Some(end)] = [pass.first(), pass.last()] else { return Err("no pass was seen".into()) };
    println!(
        "allocations in the last of {} passes, {} tiles, {all} threads: {}\n",
        rendered.stats.passes,
        pass.len(),
        end - first
    );
    Ok(())
}

/// Import to first ray against reading the file and Embree's own build.
fn set_up(file: &Path, rounds: usize) -> Outcome<()> {
    let all = pool(std::thread::available_parallelism()?.get())?;
    // Wall and processor seconds of all threads.
    let (mut wall, mut processor) = ([Vec::new(), Vec::new()], [Vec::new(), Vec::new()]);
    for _ in 0..rounds {
        let start = (Instant::now(), process_seconds());
        let scene = Arc::new(all.install(|| read(file))?);
        let rays = all.install(|| bismar::rays::build(Backend::Embree, Arc::clone(&scene)))?;
        let watch = Stopwatch::new(rays.as_ref());
        let prepared = all.install(|| PreparedScene::new(Arc::clone(&scene), Box::new(&watch)));
        rendered(&all, &prepared, &RenderSettings { crop: Some([0, 0, 1, 1]), ..settings(1) });
        drop(prepared);
        let first = watch.first.into_inner().expect("no thread panicked").ok_or("no ray was traced")?;
        wall[0].push((first.0 - start.0).as_secs_f64());
        processor[0].push(first.1 - start.1);
        drop(rays);
        let start = (Instant::now(), process_seconds());
        drop(std::hint::black_box(std::fs::read(file)?));
        drop(Bare::build(&scene));
        wall[1].push(start.0.elapsed().as_secs_f64());
        processor[1].push(process_seconds() - start.1);
    }
    println!("set-up, import to first ray against reading the file and Embree's own build:");
    for (name, [ours, least]) in [("wall", wall), ("processor", processor)] {
        let ratio = spread(ours.iter().zip(&least).map(|(a, b)| a / b).collect());
        println!(
            "  {:.3} s against {:.3} s {name}: {:.2} times ({:.2} to {:.2})",
            spread(ours)[0],
            spread(least)[0],
            ratio[0],
            ratio[1],
            ratio[2]
        );
    }
    Ok(())
}

/// Peak memory of the program against what it must hold.
fn memory(quick: bool) -> Outcome<()> {
    let sizes: &[(&str, u32)] = if quick {
        &[("blob.glb", 350)]
    } else {
        &[("blob.glb", 350), ("blob-large.glb", 1100), ("blob-huge.glb", 2500)]
    };
    for &(name, rings) in sizes {
        let (file, stats) = (written(name, rings)?, Path::new(env!("CARGO_TARGET_TMPDIR")).join("replay.json"));
        // `make bench` builds it.
        let bismar = Path::new(env!("CARGO_BIN_EXE_bismar-study")).with_file_name("bismar");
        let status = Command::new(bismar)
            .arg("render")
            .arg(&file)
            .args(["-q", "--size", "256x256", "--spp", "4", "-o", "/dev/null", "--stats"])
            .arg(&stats)
            .stderr(std::process::Stdio::null())
            .status()?;
        if !status.success() {
            return Err(format!("rendering {name} ended with {status}").into());
        }
        let stats: serde_json::Value = serde_json::from_slice(&std::fs::read(&stats)?)?;
        let bytes = |value: &serde_json::Value| value.as_u64().ok_or("no number in the statistics");
        let peak = bytes(&stats["peak_memory_bytes"])?;
        let structure = bytes(&stats["backend"]["memory_bytes"])?;
        let scene = import(&file, &ImportOptions::default())?.scene;
        let geometry: usize =
            scene.meshes.iter().map(|m| size_of_val(m.positions.padded()) + size_of_val(&m.indices[..])).sum();
        let film = 256 * 256 * size_of::<PixelStats>();
        let needed = structure + (geometry + film) as u64;
        drop(Bare::build(&scene));
        let mebi = |bytes: u64| bytes as f64 / f64::from(1 << 20);
        println!(
            "memory, {} triangles: peak {:.0} MiB; acceleration structure {:.0} (while it is built {:.0}), \
             geometry {:.0}, film {:.0} MiB: {:.2} times",
            scene.meshes.iter().map(|m| m.indices.len()).sum::<usize>(),
            mebi(peak),
            mebi(structure),
            mebi(bare::peak_bytes()),
            mebi(geometry as u64),
            mebi(film as u64),
            peak as f64 / needed as f64
        );
    }
    Ok(())
}
