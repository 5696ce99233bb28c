//! Debian's Embree 4 behind [`RayQueries`].
//!
//! An object that is placed without a transform becomes triangle geometries of the top scene; every other placed
//! object becomes one sub-scene, and each of its placements an instance geometry of the top scene. Vertex and index
//! buffers are shared with the [`Scene`], not copied.
//!
//! Rays go to Embree in packets, 16 wide where that is native and 8 wide elsewhere. Camera rays, and bounces in a scene
//! of few triangles, carry `RTC_RAY_QUERY_FLAG_COHERENT`: then a packet is traversed together, once for each octant that
//! its rays point to; otherwise Embree leaves a packet for its single rays as soon as they part. Packets of one octant are
//! up to three times as fast as single rays for camera rays, and one and a half times for sorted bounces in a scene of few
//! triangles; unsorted bounces are half as fast as single rays. Shadow rays end at the first thing in their way, each
//! somewhere else: they are never held together, and beyond few triangles go 8 wide (docs/throughput.md has the numbers).
//! Together, it is the packet's other rays that decide which of two
//! coincident surfaces is hit (measured: 2 to 10 % of the hits on two equal instances in one place changed with the
//! packets). The renderer therefore fills its packets tile by tile, always alike.

mod device;
mod packets;

use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Instant;

use embree4_sys as sys;

use super::{BackendInfo, HitBatch, RayBatch, RayOrder, RayQueries, Watch};
use crate::Result;
use crate::scene::Scene;
use device::{DeviceHandle, Monitor, SceneHandle, Share, best_isa};
use packets::{filter_alpha, single, wide4, wide8, wide16};

/// Choices of a build and of its queries. The default is what `--rays embree` renders with.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct EmbreeOptions {
    /// Threads of the build; 0 for all.
    pub threads: usize,
    /// An instruction set below the CPU's best, in Embree's words: `sse2`, `sse4.2`, `avx`, `avx2`.
    pub isa: Option<&'static str>,
    /// How long to build.
    pub quality: Quality,
    /// `RTC_SCENE_FLAG_COMPACT`: less memory before speed.
    pub compact: bool,
    /// `RTC_SCENE_FLAG_ROBUST`: box and triangle tests that lose no hit between two triangles.
    pub robust: bool,
    /// How rays are handed over.
    pub packets: Packets,
}

/// Embree's build qualities.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Quality {
    /// Two levels, a tree for each mesh, built by Morton codes.
    Low,
    /// Two levels, each mesh's tree as by `Medium`: Embree's low quality of the scene alone.
    TwoLevel,
    /// Binned surface area heuristic.
    #[default]
    Medium,
    /// The same with spatial splits.
    High,
}

/// How the rays of a batch are handed to Embree.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Packets {
    /// As wide as the CPU has them, kept together where that pays (see the module's text).
    #[default]
    Renderer,
    /// One by one.
    Single,
    /// In the batch's order, kept together through the tree.
    Four,
    /// As before.
    Eight,
    /// As before.
    Sixteen,
}

/// A [`Scene`] built into Embree's acceleration structure.
pub struct EmbreeRays {
    // Dropped in this order: the library's handles before what they point to.
    top: SceneHandle,
    _device: DeviceHandle,
    _monitor: Arc<Monitor>,
    scene: Arc<Scene>,
    placements: Vec<Placement>,
    has_alpha: bool,
    packets: Packets,
    /// Are 16-wide packets native? 8-wide ones are wherever AVX is, and narrower CPUs emulate them.
    wide16: bool,
    /// At most [`SMALL_SCENE`] triangles and instances?
    small: bool,
    info: BackendInfo,
}

// SAFETY: traversal of a committed scene is thread-safe by Embree's manual, the handles are used for nothing else
// after the build, and the monitor is made of atomics and a mutex.
unsafe impl Send for EmbreeRays {}
// SAFETY: as above.
unsafe impl Sync for EmbreeRays {}

/// What a geometry of the top scene is.
#[derive(Debug, Clone, Copy, Default)]
struct Placement {
    /// Index into [`Scene::instances`].
    instance: u32,
    /// Index into [`Scene::meshes`]; for an instance geometry that of its first mesh.
    mesh: u32,
}

impl EmbreeRays {
    /// Builds the acceleration structure; keeps the scene for its buffers and its alpha. `watch` follows it triangle by
    /// triangle.
    ///
    /// # Errors
    /// [`Error::Data`](crate::Error::Data) for a malformed scene (an index beyond the vertices, say),
    /// [`Error::Host`](crate::Error::Host) for a library of another version than the header's, a CPU that it does not
    /// run on or too little memory, [`Error::Interrupted`](crate::Error::Interrupted) when `watch` says so.
    pub fn build(scene: Arc<Scene>, options: &EmbreeOptions, watch: Watch) -> Result<Self> {
        let start = Instant::now();
        super::check::check(&scene)?;
        let monitor = Arc::<Monitor>::default();
        let device = DeviceHandle::new(options, &monitor)?;
        let version = device.version()?;
        let mesh_range = |object: u32| scene.objects[object as usize].meshes.clone();
        let has_alpha =
            scene.instances.iter().flat_map(|instance| mesh_range(instance.object)).any(|mesh| scene.has_alpha(mesh));
        let top = device.new_scene(has_alpha, options);
        let attach = |target: &SceneHandle, id: u32, mesh: u32| {
            device.attach_mesh(target, id, &scene.meshes[mesh as usize], scene.has_alpha(mesh), options.quality);
        };
        let mut share = Share::new(watch, super::units(&scene));
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
                let built = device.new_scene(has_alpha, options);
                for (id, mesh) in meshes.clone().enumerate() {
                    attach(&built, id as u32, mesh);
                }
                built.commit(&monitor, share.next(scene.triangles(instance.object)))?;
                *object = Some(built);
            }
            if let Some(object) = object {
                device.attach_instance(&top, placements.len() as u32, object, (&transform, moving));
                placements.push(Placement { instance: index as u32, mesh: meshes.start });
            }
        }
        top.commit(&monitor, share.rest())?;
        let info = BackendInfo {
            name: "embree",
            version,
            isa: options.isa.map_or_else(|| best_isa().to_owned(), str::to_uppercase),
            build_seconds: start.elapsed().as_secs_f64(),
            memory_bytes: monitor.bytes.load(Ordering::Relaxed).max(0) as u64,
            peak_bytes: Some(monitor.peak.load(Ordering::Relaxed).max(0) as u64),
        };
        let placed = scene.instances.iter().map(|instance| 1 + scene.triangles(instance.object));
        let small = placed.sum::<usize>() <= SMALL_SCENE;
        let wide16 = device.property(sys::RTC_DEVICE_PROPERTY_NATIVE_RAY16_SUPPORTED) != 0;
        drop(objects); // the instance geometries keep them
        let packets = options.packets;
        Ok(Self { top, _device: device, _monitor: monitor, scene, placements, has_alpha, packets, wide16, small, info })
    }

    /// Instance and mesh of a hit by Embree's ids.
    fn place(&self, geometry: u32, instance: u32) -> Placement {
        if instance == sys::RTC_INVALID_GEOMETRY_ID {
            self.placements[geometry as usize]
        } else {
            let placement = self.placements[instance as usize];
            Placement { mesh: placement.mesh + geometry, ..placement }
        }
    }

    fn filter(&self) -> sys::RTCFilterFunctionN {
        if self.has_alpha { Some(filter_alpha) } else { None }
    }
}

impl RayQueries for EmbreeRays {
    fn closest_hits(&self, rays: &RayBatch, order: RayOrder, hits: &mut HitBatch) {
        hits.resize(rays.len());
        let bond = match order {
            RayOrder::Incoherent if self.packets != Packets::Renderer => Bond::Held,
            RayOrder::Incoherent if self.small && rays.len() >= SORTED_BATCH => Bond::Sorted,
            RayOrder::Incoherent => Bond::Loose,
            RayOrder::Coherent => Bond::Held,
        };
        match self.packets {
            Packets::Single => single::closest_hits(self, rays, hits),
            Packets::Four => wide4::closest_hits(self, rays, bond, hits),
            Packets::Eight => wide8::closest_hits(self, rays, bond, hits),
            Packets::Renderer if !self.wide16 => wide8::closest_hits(self, rays, bond, hits),
            Packets::Renderer | Packets::Sixteen => wide16::closest_hits(self, rays, bond, hits),
        }
    }

    fn occluded(&self, rays: &RayBatch, order: RayOrder, occluded: &mut Vec<bool>) {
        occluded.resize(rays.len(), false);
        let loose = self.packets == Packets::Renderer && order == RayOrder::Incoherent;
        let bond = if loose { Bond::Loose } else { Bond::Held };
        match self.packets {
            Packets::Single => single::occluded(self, rays, occluded),
            Packets::Four => wide4::occluded(self, rays, bond, occluded),
            Packets::Eight => wide8::occluded(self, rays, bond, occluded),
            Packets::Renderer if !self.wide16 || (loose && !self.small) => wide8::occluded(self, rays, bond, occluded),
            Packets::Renderer | Packets::Sixteen => wide16::occluded(self, rays, bond, occluded),
        }
    }

    fn info(&self) -> &BackendInfo {
        &self.info
    }
}

/// What holds the rays of a packet together.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Bond {
    /// Nothing: they part where their ways do.
    Loose,
    /// They go through the tree as one, in the batch's order.
    Held,
    /// As one, after the batch has been sorted into packets of one octant.
    Sorted,
}

impl Bond {
    fn flags(self) -> sys::RTCRayQueryFlags {
        match self {
            Self::Loose => sys::RTC_RAY_QUERY_FLAG_INCOHERENT,
            Self::Held | Self::Sorted => sys::RTC_RAY_QUERY_FLAG_COHERENT,
        }
    }
}

/// Triangles and instances up to which any ray soon knows the scene by heart, so that sorted packets pay for bounces.
const SMALL_SCENE: usize = 2000;

/// Rays from which on a batch fills packets of each octant.
const SORTED_BATCH: usize = 256;
