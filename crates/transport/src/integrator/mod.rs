//! Light transport along a batch of paths, in stages: trace, shade, trace shadows, again.

pub mod batch;
pub mod camera;
pub mod dispersion;
pub mod events;
pub mod geometry;
pub mod guides;
pub mod materials;
pub mod path_states;
pub mod prepared;
pub mod queues;
pub mod scalar;
pub mod stages;
pub mod velocity;
pub mod vertices;
pub mod wave;

pub use batch::{PixelBatch, PixelTask};
pub use camera::CameraRays;
pub use geometry::Geometry;
pub use guides::guides;
pub use materials::Materials;
pub use prepared::{Names, PreparedScene};
pub use wave::{Wave, WaveCounts};

use crate::balance::{Counts, Heuristic};
use crate::guiding::Field;
use crate::light::{Drawing, Lights};
use crate::rays::RayQueries;
use crate::sampling::FilterSampler;
use crate::scene::Scene;

/// Everything that paths need and no path changes.
#[derive(Clone)]
pub struct Transport<'a> {
    /// What is there.
    pub scene: &'a Scene,
    /// What rays hit.
    pub rays: &'a dyn RayQueries,
    /// Instances' transforms, prepared for shading.
    pub geometry: &'a Geometry,
    /// Materials, prepared for shading.
    pub materials: &'a Materials,
    /// What shines.
    pub lights: &'a Lights,
    /// Hashes of names.
    pub names: &'a Names,
    /// Where camera rays begin.
    pub camera: CameraRays,
    /// Where in the pixel.
    pub filter: FilterSampler,
    /// How the techniques are weighed.
    pub heuristic: Heuristic,
    /// Most segments of a path.
    pub max_depth: u32,
    /// Seed of every random choice.
    pub seed: u32,
    /// Most that a light's contribution may have in a channel: found from first surfaces, and from later ones. Infinite:
    /// no limit. What the camera sees directly has none.
    pub limits: [f32; 2],
    /// Is the environment left out where the camera sees it directly?
    pub hides_environment: bool,
    /// Where light comes from, if paths are guided.
    pub field: Option<&'a Field>,
    /// What light samples are drawn by.
    pub drawing: Drawing<'a>,
}

impl Transport<'_> {
    /// Does a field say how often vertices beyond the first take a light sample and paths go on?
    fn has_roulette(&self) -> bool {
        self.field.is_some_and(Field::has_roulette)
    }

    /// Samples a path of each technique beyond first surfaces: one light sample, one BSDF sample.
    fn deeper_rates(&self) -> [f32; 3] {
        Counts::half(1).rates(self.lights.environment_probability)
    }
}
