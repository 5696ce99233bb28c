//! Progress and interruption of acceleration structure builds.

use crate::scene::{Instance, Scene};
use crate::{Error, Result};

/// Progress callback of a build: receives the completed fraction in [0, 1], from any thread and not always in ascending order,
/// and returns whether to continue. Embree calls it every few thousand triangles, obvhs before each object.
pub type Watch<'a> = &'a (dyn Fn(f64) -> bool + Sync);

/// Fails if `watch` stops the build.
pub(super) fn check_watch(watch: Watch, done: f64) -> Result<()> {
    if watch(done) { Ok(()) } else { Err(interrupted()) }
}

pub(super) fn interrupted() -> Error {
    Error::Interrupted(
        "interrupted while building the acceleration structure: nothing new is saved; run the same command again"
            .to_owned(),
    )
}

/// The work of a build, for its progress: the number of triangles in all structures that are built, plus the instances.
pub(super) fn build_units(scene: &Scene) -> usize {
    let mut built = vec![false; scene.objects.len()];
    let of_instance = |instance: &Instance| {
        let again = instance.transform.is_some() && std::mem::replace(&mut built[instance.object as usize], true);
        1 + if again { 0 } else { scene.triangles(instance.object) }
    };
    scene.instances.iter().map(of_instance).sum()
}
