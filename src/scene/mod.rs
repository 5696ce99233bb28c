//! Plain scene data: what an importer fills and everything downstream reads. It knows nothing of rays or files
//! (only [`import`] does).

pub mod alpha;
pub mod camera;
pub mod environment;
pub mod import;
pub mod lights;
pub mod material;
pub mod mesh;
pub mod texture;

pub use camera::{Camera, Projection};
pub use environment::Environment;
pub use lights::{PunctualKind, PunctualLight};
pub use material::{AlphaMode, Encoding, Material, TextureRef};
pub use mesh::{Instance, Mesh, Object, Positions};
pub use texture::{Filter, Image, Texels, Texture, Wrap};

/// A scene, ready to be built into ray queries. Lengths in metres, glTF axes (+y up, right-handed).
#[derive(Debug, Default)]
pub struct Scene {
    /// Triangle meshes, one a glTF primitive.
    pub meshes: Vec<Mesh>,
    /// Groups of meshes that are placed together, one a glTF mesh.
    pub objects: Vec<Object>,
    /// Placements of objects. An object that is placed once has its transform baked into its meshes.
    pub instances: Vec<Instance>,
    /// Materials; every mesh names one.
    pub materials: Vec<Material>,
    /// Decoded pictures, only those that a reachable material samples.
    pub images: Vec<Image>,
    /// Pictures with their sampler.
    pub textures: Vec<Texture>,
    /// Point, spot and directional lights, in world space.
    pub lights: Vec<PunctualLight>,
    /// Cameras, in world space; at least one (a framed view when the file has none).
    pub cameras: Vec<Camera>,
    /// Light from infinity.
    pub environment: Option<Environment>,
}
