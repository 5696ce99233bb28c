//! What tests share. Each file needs at most its neighbours here, so that another crate's tests can take those it wants
//! by `#[path]` into a module of its own.

pub mod farm;
pub mod glb;
pub mod gltf_parts;
pub mod pictures;
pub mod program;
pub mod random;
pub mod ray_scenes;
pub mod shared;
pub mod skipped;
pub mod stage;
pub mod statistics;
