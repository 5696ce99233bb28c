//! What stages read and write: the input of paths ([`transport`], [`task`]), queues of rays, vertices, and the state of paths.

pub mod boundaries;
pub mod camera;
pub mod context;
pub mod counts;
pub mod dimensions;
pub mod history;
pub mod light_layers;
pub mod path_states;
pub mod prepared;
pub mod proposal;
pub mod queues;
pub mod requests;
pub mod task;
pub mod transport;
pub mod vertices;
