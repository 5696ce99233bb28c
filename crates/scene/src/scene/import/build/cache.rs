//! Cache shared by imports of the same files at different times: decoded pictures, and meshes that do not change.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use glam::{DAffine3, DMat4};

use super::nodes::ObjectKey;
use crate::scene::import::report::Note;
use crate::scene::{Image, Material, Mesh};

/// Results that later imports of the same files reuse.
#[derive(Debug, Default)]
pub struct ImportCache {
    /// Decoded pictures by the document's index.
    images: Mutex<HashMap<usize, Arc<Image>>>,
    /// Objects of the last import.
    objects: Mutex<Objects>,
}

/// Objects of one import.
pub type Objects = HashMap<CacheKey, Arc<CachedObject>>;

/// Everything that determines an object's meshes, except what depends on materials ([`AttributeNeeds`]).
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub struct CacheKey {
    object: ObjectKey,
    /// Bits of the joint matrices.
    joints: Vec<u64>,
    /// Bits of the transforms to world space, for meshes that are stored in world space.
    world: Vec<u64>,
    /// Number of time samples while the shutter is open; the remaining ones are for velocities.
    shutter_samples: usize,
}

/// Attributes that a material needs: the texture coordinate set that tangents follow, and whether each set is sampled.
pub type AttributeNeeds = (Option<u8>, [bool; 2]);

/// An object's meshes; in world space if it is placed once.
#[derive(Debug)]
pub struct CachedObject {
    /// Needs of the material of each triangle primitive, in order.
    pub needs: Vec<AttributeNeeds>,
    /// Each mesh with the index of its primitive.
    pub meshes: Vec<(usize, Arc<Mesh>)>,
    /// Notes of the meshes' reading.
    pub notes: Vec<Note>,
}

impl CacheKey {
    /// Does the key belong to this mesh of the document?
    pub fn is_of(&self, mesh: usize) -> bool {
        self.object.mesh == mesh
    }

    /// The key of an object with these joint matrices at its time samples; `worlds` are the transforms that are baked into its
    /// meshes.
    pub fn new<'a>(
        object: &ObjectKey,
        joints: impl Iterator<Item = &'a [DMat4]>,
        worlds: impl Iterator<Item = DAffine3>,
        shutter_samples: usize,
    ) -> Self {
        let bits = |numbers: &[f64]| numbers.iter().map(|x| x.to_bits()).collect::<Vec<_>>();
        let joints = joints.flatten().flat_map(|m| bits(&m.to_cols_array())).collect();
        let world = worlds.flat_map(|world| bits(&world.to_cols_array())).collect();
        Self { object: object.clone(), joints, world, shutter_samples }
    }
}

/// Attributes that a material needs.
pub fn attribute_needs(material: &Material) -> AttributeNeeds {
    (material.tangent_set(), [0, 1].map(|set| material.textures.iter().any(|t| t.set == set)))
}

impl ImportCache {
    /// Decoded pictures, by the document's index.
    pub fn images(&self) -> MutexGuard<'_, HashMap<usize, Arc<Image>>> {
        self.images.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Objects of the last import.
    pub fn objects(&self) -> Objects {
        self.objects.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Replaces the objects of the last import.
    pub fn set_objects(&self, objects: Objects) {
        *self.objects.lock().unwrap_or_else(PoisonError::into_inner) = objects;
    }
}
