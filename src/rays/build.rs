//! How a build of an acceleration structure is followed and interrupted.

use crate::scene::{Instance, Scene};
use crate::{Error, Result};

/// Follows a build: is handed the share that is done, in [0, 1], from any thread and not always in order, and answers
/// whether to go on. Embree asks every some thousand triangles, obvhs before each object.
pub type Watch<'a> = &'a (dyn Fn(f64) -> bool + Sync);

/// Asks `watch` whether to go on.
pub(super) fn check_watch(watch: Watch, done: f64) -> Result<()> {
    if watch(done) { Ok(()) } else { Err(interrupted()) }
}

pub(super) fn interrupted() -> Error {
    Error::Interrupted(
        "interrupted while building the acceleration structure: nothing new is saved; run the same command again"
            .to_owned(),
    )
}

/// What a build is long for: triangles, each once for every time that it is built, and placements.
pub(super) fn build_units(scene: &Scene) -> usize {
    let mut built = vec![false; scene.objects.len()];
    let of_instance = |instance: &Instance| {
        let again = instance.transform.is_some() && std::mem::replace(&mut built[instance.object as usize], true);
        1 + if again { 0 } else { scene.triangles(instance.object) }
    };
    scene.instances.iter().map(of_instance).sum()
}
