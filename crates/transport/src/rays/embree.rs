//! The Embree 4 backend of [`RayQueries`], with the library that the system provides.
//!
//! An object that is placed without a transform becomes triangle geometries of the top scene. Every other object becomes one
//! sub-scene, and each of its placements an instance geometry of the top scene. Vertex and index buffers are shared with the
//! [`Scene`], not copied.
//!
//! Rays are passed in packets, 16 wide where that is native and 8 wide elsewhere. Camera rays, and bounces in small scenes, set
//! `RTC_RAY_QUERY_FLAG_COHERENT`: a packet is then traversed together, once for each octant of its ray directions. Without the
//! flag, Embree traces the rays of a packet one by one as soon as they diverge. Compared to single rays, coherent packets of one
//! octant are up to 3 times as fast for camera rays and 1.5 times for sorted bounces in a small scene; coherent packets of
//! unsorted bounces are half as fast. Shadow rays stop at their first occluder and never use the flag; except in small scenes
//! they go 8 wide. lab/notes/throughput.md has the measurements.
//!
//! In a coherent packet, the other rays influence which of several coincident surfaces is hit (2 to 10 % of the hits on two
//! equal instances in one place changed with the packets). The renderer therefore always fills its packets in the same way,
//! tile by tile.

mod committed;
mod device;
mod options;
mod packets;

use std::sync::atomic::Ordering;
use std::sync::{Arc, Mutex};
use std::time::Instant;

use embree4_sys as sys;

use super::batch::{AnyHit, HitBatch, RayBatch, RayOrder};
use super::build::{Watch, build_units};
use super::check::check;
use super::queries::{BackendInfo, RayQueries};
use crate::scene::Scene;
use crate::{Error, Result};
use committed::{CommittedScene, Placement};
use device::{CommitProgress, DeviceHandle, DeviceMonitor, SceneHandle, best_isa};
pub use options::{EmbreeOptions, Packets, Quality};
use packets::{Coherence, Sides, single, wide4, wide8, wide16};

/// Version of the Embree header that the bindings were made from.
pub const HEADER_VERSION: &str = env!("BISMAR_EMBREE_HEADER_VERSION");

/// The acceleration structure of a [`Scene`] by Embree.
pub struct EmbreeRays {
    // Drop order: the handles of the library before what they point to.
    committed: CommittedScene,
    _device: DeviceHandle,
    _monitor: Arc<DeviceMonitor>,
    _scene: Arc<Scene>,
    packets: Packets,
    /// Are 16-wide packets native? 8-wide packets are native with AVX and emulated without.
    wide16: bool,
    /// Does the scene have at most [`SMALL_SCENE_PRIMITIVES`] triangles and instances?
    small: bool,
    info: BackendInfo,
}

// SAFETY: traversal of a committed scene is thread-safe by Embree's manual, the handles are used for nothing else
// after the build, and the monitor is made of atomics and a mutex.
unsafe impl Send for EmbreeRays {}
// SAFETY: as above.
unsafe impl Sync for EmbreeRays {}

impl EmbreeRays {
    /// Builds the acceleration structure; keeps the scene for its buffers and for alpha tests.
    ///
    /// # Errors
    /// [`Error::Data`] for a malformed scene, [`Error::Host`] for a library whose
    /// version is not that of the header, an unsupported CPU or too little memory,
    /// [`Error::Interrupted`] if `watch` stops the build.
    pub fn build(scene: Arc<Scene>, options: &EmbreeOptions, watch: Watch) -> Result<Self> {
        let start = Instant::now();
        check(&scene)?;
        check_threads(options.threads)?;
        let monitor = Arc::<DeviceMonitor>::default();
        let device = DeviceHandle::new(options, &monitor)?;
        let version = device.version()?;
        let mesh_range = |object: u32| scene.objects[object as usize].meshes.clone();
        let placed = || scene.instances.iter().flat_map(|instance| mesh_range(instance.object));
        let has_alpha = placed().any(|mesh| scene.has_alpha(mesh));
        // All hits are collected by a filter, of opaque surfaces too.
        let has_bodies = scene.has_bodies();
        let filters = has_alpha || has_bodies || placed().any(|mesh| scene.is_single_sided(mesh));
        let top = device.new_scene(filters, options);
        let attach = |target: &SceneHandle, id: u32, mesh: u32| {
            let filters = has_bodies || scene.has_alpha(mesh);
            device.attach_mesh(target, id, &scene.meshes[mesh as usize], filters, options.quality);
        };
        let mut progress = CommitProgress::new(watch, build_units(&scene));
        let mut objects: Vec<Option<SceneHandle>> = scene.objects.iter().map(|_| None).collect();
        let mut placements = Vec::new();
        for (index, instance) in scene.instances.iter().enumerate() {
            let meshes = mesh_range(instance.object);
            let moving = instance.motion.as_deref();
            let Some(transform) = instance.transform else {
                for mesh in meshes {
                    attach(&top, placements.len() as u32, mesh);
                    placements.push(Placement { instance: index as u32, mesh });
                }
                continue;
            };
            let object = &mut objects[instance.object as usize];
            if object.is_none() {
                let built = device.new_scene(filters, options);
                for (id, mesh) in meshes.clone().enumerate() {
                    attach(&built, id as u32, mesh);
                }
                built.commit(&monitor, progress.next(scene.triangles(instance.object)))?;
                *object = Some(built);
            }
            if let Some(object) = object {
                device.attach_instance(&top, placements.len() as u32, object, (&transform, moving));
                placements.push(Placement { instance: index as u32, mesh: meshes.start });
            }
        }
        top.commit(&monitor, progress.rest())?;
        let info = BackendInfo {
            name: "embree",
            version,
            isa: options.isa.map_or_else(|| best_isa().to_owned(), str::to_uppercase),
            build_seconds: start.elapsed().as_secs_f64(),
            memory_bytes: monitor.bytes.load(Ordering::Relaxed).max(0) as u64,
            peak_bytes: Some(monitor.peak.load(Ordering::Relaxed).max(0) as u64),
        };
        let placed = scene.instances.iter().map(|instance| 1 + scene.triangles(instance.object));
        let small = placed.sum::<usize>() <= SMALL_SCENE_PRIMITIVES;
        let wide16 = device.property(sys::RTC_DEVICE_PROPERTY_NATIVE_RAY16_SUPPORTED) != 0;
        drop(objects); // the instance geometries hold references
        let packets = options.packets;
        let committed = CommittedScene { top, scene: Arc::clone(&scene), placements, has_alpha };
        Ok(Self { committed, _device: device, _monitor: monitor, _scene: scene, packets, wide16, small, info })
    }
}

impl EmbreeRays {
    fn closest(&self, rays: &RayBatch, how: (Coherence, Sides), hits: &mut HitBatch) {
        hits.resize(rays.len());
        match self.packets {
            Packets::Single => single::closest_hits(&self.committed, rays, how, hits),
            Packets::Four => wide4::closest_hits(&self.committed, rays, how, hits),
            Packets::Eight => wide8::closest_hits(&self.committed, rays, how, hits),
            Packets::Renderer if !self.wide16 => wide8::closest_hits(&self.committed, rays, how, hits),
            Packets::Renderer | Packets::Sixteen => wide16::closest_hits(&self.committed, rays, how, hits),
        }
    }
}

impl RayQueries for EmbreeRays {
    fn closest_hits(&self, rays: &RayBatch, order: RayOrder, hits: &mut HitBatch) {
        let coherence = match order {
            RayOrder::Incoherent if self.packets != Packets::Renderer => Coherence::Coherent,
            RayOrder::Incoherent if self.small && rays.len() >= MIN_SORTED_RAYS => Coherence::Sorted,
            RayOrder::Incoherent => Coherence::Incoherent,
            RayOrder::Coherent => Coherence::Coherent,
        };
        self.closest(rays, (coherence, Sides::Both), hits);
    }

    fn closest_front_hits(&self, rays: &RayBatch, hits: &mut HitBatch) {
        self.closest(rays, (Coherence::Incoherent, Sides::Fronts), hits);
    }

    fn occluded(&self, rays: &RayBatch, order: RayOrder, occluded: &mut Vec<bool>) {
        occluded.resize(rays.len(), false);
        let incoherent = self.packets == Packets::Renderer && order == RayOrder::Incoherent;
        let coherence = if incoherent { Coherence::Incoherent } else { Coherence::Coherent };
        match self.packets {
            Packets::Single => single::occluded(&self.committed, rays, occluded),
            Packets::Four => wide4::occluded(&self.committed, rays, coherence, occluded),
            Packets::Eight => wide8::occluded(&self.committed, rays, coherence, occluded),
            Packets::Renderer if !self.wide16 || (incoherent && !self.small) => {
                wide8::occluded(&self.committed, rays, coherence, occluded)
            }
            Packets::Renderer | Packets::Sixteen => wide16::occluded(&self.committed, rays, coherence, occluded),
        }
    }

    fn all_hits(&self, rays: &RayBatch, found: &mut Vec<AnyHit>) {
        single::all_hits(&self.committed, rays, found);
    }

    fn info(&self) -> &BackendInfo {
        &self.info
    }
}

/// Largest number of triangles and instances for which sorted packets are faster for bounces.
const SMALL_SCENE_PRIMITIVES: usize = 2000;

/// Smallest batch that is sorted by octant: enough rays to fill packets of each.
const MIN_SORTED_RAYS: usize = 256;

/// Starts as many threads as Embree will, and ends them: Embree's library ends the process where the system refuses one.
fn check_threads(threads: usize) -> Result<()> {
    let gate = Mutex::new(());
    std::thread::scope(|scope| {
        let shut = gate.lock();
        for _ in 0..threads {
            let thread = std::thread::Builder::new().spawn_scoped(scope, || drop(gate.lock()));
            thread.map_err(|e| Error::Host(format!("cannot start {threads} threads for Embree: {e}")))?;
        }
        drop(shut);
        Ok(())
    })
}
