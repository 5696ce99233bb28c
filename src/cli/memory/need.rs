//! What memory a render needs, estimated before anything is decoded.

use crate::rays::Backend;
use crate::render::RenderSettings;
use crate::render::prepass;
use crate::render::tile::{Columns, Tile};
use crate::scene::import::{EnvironmentSize, Survey};

/// What the memory of a render depends on.
#[derive(Debug, Clone, Copy)]
pub struct Need<'a> {
    /// The scene's files.
    pub scene: &'a Survey,
    /// Times at which moving parts are kept.
    pub steps: Steps,
    /// The environment's picture, if there is one.
    pub environment: Option<EnvironmentSize>,
    /// Whether the compensated density of the environment is made, too.
    pub compensates: bool,
    /// Pixels that are rendered: of the crop window, or of a part of it.
    pub pixels: u64,
    /// Pixels of the file: of the crop window, of which a part leaves most empty.
    pub window_pixels: u64,
    /// What is stored per pixel.
    pub columns: Columns,
    /// Pixels whose statistics to continue from are in the picture's file.
    pub saved_pixels: u64,
    /// Whether the picture is denoised.
    pub denoises: bool,
    /// Whether a PNG is written, too.
    pub previews: bool,
    /// What pre-passes take.
    pub prepass: prepass::Size,
    /// Whether there are pixels before the pre-passes.
    pub continues: bool,
    /// Number of tiles that threads work at, of the allocation too. Threads without work have no buffers.
    pub tiles: usize,
    /// Ray tracing library.
    pub rays: Backend,
    /// Number of render threads.
    pub threads: usize,
}

/// Times at which moving parts are kept.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Steps {
    /// The scene is at rest.
    #[default]
    Rest,
    /// The scene is shown at one time.
    Pose,
    /// So many linear segments.
    Shutter(u32),
    /// As many as the motion needs.
    Adaptive,
}

impl Steps {
    /// Number of times at which transforms and positions are kept.
    fn kept(self) -> u64 {
        match self {
            Self::Rest | Self::Pose => 0,
            Self::Shutter(steps) => u64::from(steps) + 1,
            // Few motions need more; those that do are measured again once they are read.
            Self::Adaptive => 9,
        }
    }
}

/// Bytes of the program and its libraries.
const PROGRAM_BYTES: u64 = 30 << 20;
/// Bytes of the buffers of one thread, and of those with which it records paths that teach.
const BYTES_PER_THREAD: u64 = 2 << 20;
const RECORDING_BYTES_PER_THREAD: u64 = 2 << 20;
/// Bytes per pixel of all AOVs while the blocks of the file are compressed.
const AOV_BYTES_PER_PIXEL: u64 = 80;
/// Bytes per pixel of the window of the luminances that set the exposure, in a list that grows.
const EXPOSURE_BYTES_PER_PIXEL: u64 = 6;
/// Bytes per pixel of a PNG while it is written.
const PREVIEW_BYTES_PER_PIXEL: u64 = 8;
/// Bytes per triangle of a static mesh: at the peak of the build, and of the finished acceleration structure.
const EMBREE_BYTES_PER_TRIANGLE: [u64; 2] = [125, 100];
const OBVHS_BYTES_PER_TRIANGLE: [u64; 2] = [360, 200];
/// Bytes per placement: in the document, the scene, the ray queries and shading.
const BYTES_PER_INSTANCE: u64 = 1000;
/// Bytes per node of the checked document.
const BYTES_PER_NODE: u64 = 480;
/// Bytes per mesh outside of its arrays: in the document, the scene, the ray queries.
const BYTES_PER_MESH: u64 = 4500;
/// Bytes of a moving placement at one time: in the scene, and in the ray queries.
const BYTES_PER_KEY: [u64; 2] = [72, 400];
/// Bytes of a node at one time while the motion is sampled.
const BYTES_PER_NODE_AND_TIME: u64 = 176;
/// Bytes of a deforming vertex at one time: position and normal.
const BYTES_PER_VERTEX_AND_TIME: u64 = 24;
/// Bytes of the ray queries per deforming vertex, of two triangles: once, and for each time.
const DEFORMING_BYTES_PER_VERTEX: [u64; 2] = [440, 10];
/// Bytes of an emissive triangle and its part of the light tree while both are built.
const BYTES_PER_LIGHT: u64 = 250;
/// Bytes of the denoiser's process with Open Image Denoise 2.3, and its bytes per pixel: of the pictures that are passed to it,
/// and of its network, which takes tiles of at most so many pixels.
const DENOISER_BYTES: u64 = 40 << 20;
const DENOISER_BYTES_PER_PIXEL: [u64; 2] = [130, 790];
const DENOISER_TILE_PIXELS: u64 = 2160 * 2160;

/// Bytes of the program without a scene.
pub fn at_rest(threads: usize) -> u64 {
    PROGRAM_BYTES + threads as u64 * BYTES_PER_THREAD
}

/// Bytes of placements, of so many keys of their motion in all, and of the emissive triangles in them.
pub fn placed_bytes(instances: u64, keys: u64, emissive_triangles: u64) -> u64 {
    instances * BYTES_PER_INSTANCE + keys * BYTES_PER_KEY.iter().sum::<u64>() + emissive_triangles * BYTES_PER_LIGHT
}

impl<'a> Need<'a> {
    /// Of a picture of this width and height with default settings and without an environment; with 0 of the scene alone.
    pub fn with_defaults(scene: &'a Survey, steps: Steps, [width, height]: [u32; 2]) -> Self {
        let settings = RenderSettings { width, height, ..Default::default() };
        let pixels = u64::from(width) * u64::from(height);
        let prepass = match pixels {
            0 => prepass::Size::default(),
            _ => prepass::size(&settings, scene.census.emissive_triangles),
        };
        Self {
            scene,
            steps,
            environment: None,
            compensates: false,
            pixels,
            window_pixels: pixels,
            columns: settings.columns(),
            saved_pixels: 0,
            denoises: false,
            previews: false,
            prepass,
            continues: false,
            tiles: Tile::grid_positions([0, 0, width, height]).count(),
            rays: Backend::default(),
            threads: rayon::current_num_threads(),
        }
    }

    /// Estimated peak memory in bytes, from the files' headers: an upper bound, for most scenes by less than a third.
    /// `lab/reliability_memory.py` compares it with what is taken.
    pub fn bytes(&self) -> u64 {
        let (s, c) = (self.scene, &self.scene.census);
        let times = self.steps.kept();
        let [building, built] = match self.rays {
            Backend::Embree => EMBREE_BYTES_PER_TRIANGLE,
            Backend::Obvhs => OBVHS_BYTES_PER_TRIANGLE,
        }
        .map(|bytes| bytes * c.triangles + times * c.moving * BYTES_PER_KEY[1]);
        let [once, each] = DEFORMING_BYTES_PER_VERTEX;
        let deforming = if times > 0 { c.deforming_vertices * (once + times * each) } else { 0 };
        let motion = times * (c.moving * BYTES_PER_KEY[0] + c.deforming_vertices * BYTES_PER_VERTEX_AND_TIME);
        let sampling = times * c.nodes * BYTES_PER_NODE_AND_TIME;
        let environment = self.environment.map_or([0; 2], |size| size.bytes(self.compensates));
        // The scene in memory.
        let kept =
            c.geometry_bytes + s.image_bytes + motion + c.instances * BYTES_PER_INSTANCE + c.meshes * BYTES_PER_MESH;
        // While it is read: the files, the parsed document, twice where an animation poses it, and data of the formats.
        let documents = if self.steps == Steps::Rest { 1 } else { 3 } * (c.json_bytes + c.nodes * BYTES_PER_NODE);
        let decoding = s.decoding_bytes.iter().take(self.threads).sum::<u64>();
        let reading = s.read_bytes + documents + sampling + decoding.max(c.reading_bytes).max(environment[0]);
        let lights = c.emissive_triangles * BYTES_PER_LIGHT;
        let writing = if self.columns.aovs { AOV_BYTES_PER_PIXEL } else { EXPOSURE_BYTES_PER_PIXEL };
        let pixels = Tile::memory_bytes(self.pixels, self.columns) + self.window_pixels * writing;
        // Statistics are compressed before writing, usually to less than half.
        let saving = Tile::memory_bytes(self.saved_pixels, self.columns) / 2;
        let [pictures, network] = DENOISER_BYTES_PER_PIXEL;
        let denoiser = match self.denoises {
            true => DENOISER_BYTES + self.pixels * pictures + self.pixels.min(DENOISER_TILE_PIXELS) * network,
            false => 0,
        };
        let preview = if self.previews { self.pixels * PREVIEW_BYTES_PER_PIXEL } else { 0 };
        // A part of what is freed is not given back to the system: of what the reader had, and learners.
        let (documents, learned) = (documents / 2, self.prepass.learning / 2);
        let buffers = at_rest(self.threads.min(self.tiles));
        let learners = self.threads.min(self.prepass.tiles as usize) as u64;
        let learning = self.prepass.learning + at_rest(0) + learners * (BYTES_PER_THREAD + RECORDING_BYTES_PER_THREAD);
        let allocating = learned + self.prepass.allocation + buffers;
        let before = if self.continues { pixels } else { 0 };
        let drawing = pixels + learned.max(self.prepass.allocation).max(saving).max(denoiser).max(preview) + buffers;
        let rendering = built + environment[1] + lights + drawing.max(before + learning.max(allocating));
        kept + (at_rest(self.threads) + reading.max(documents + deforming + building))
            .max(documents + deforming + rendering)
    }
}
