//! The studies from end to end, and their judges.

mod balance;
mod means;
mod rays;
mod stability;

#[allow(dead_code, reason = "the program's own tests use more of it")]
#[path = "../../tests/helpers"]
mod helpers {
    pub mod glb;
    pub mod random;
    pub mod ray_scenes;
    pub mod stage;
    pub mod statistics;
}
