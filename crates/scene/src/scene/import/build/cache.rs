//! What other time samples of the same files share: decoded pictures, and meshes that do not move.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use glam::{DAffine3, DMat4};

use super::nodes::ObjectKey;
use crate::scene::import::report::Note;
use crate::scene::{Image, Material, Mesh};

/// Kept from import to import of the same files.
#[derive(Debug, Default)]
pub struct Kept {
    /// By the document's index.
    images: Mutex<HashMap<usize, Arc<Image>>>,
    objects: Mutex<Objects>,
}

/// Of the last time sample that was imported.
pub type Objects = HashMap<Key, Arc<KeptObject>>;

/// What an object's meshes are made from, but for their materials: [`Needs`].
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub struct Key {
    object: ObjectKey,
    joints: Vec<u64>,
    /// Of meshes that are in world space.
    world: Vec<u64>,
    /// How many time samples are while the shutter is open; the others are for velocities.
    open: usize,
}

/// Which attributes a material asks for: the set of coordinates that tangents lie along, and all sets.
pub type Needs = (Option<u8>, [bool; 2]);

/// An object's meshes, in world space if it is placed once.
#[derive(Debug)]
pub struct KeptObject {
    /// Of each triangle primitive, in order.
    pub needs: Vec<Needs>,
    /// With the number of their primitive.
    pub meshes: Vec<(usize, Arc<Mesh>)>,
    /// What was noted when they were read.
    pub notes: Vec<Note>,
}

impl Key {
    /// Is it one of this mesh of the document?
    pub fn is_of(&self, mesh: usize) -> bool {
        self.object.mesh == mesh
    }

    /// Of an object whose joints, at its time samples, and placements, if it is in world space, are these.
    pub fn new<'a>(
        object: &ObjectKey,
        joints: impl Iterator<Item = &'a [DMat4]>,
        worlds: impl Iterator<Item = DAffine3>,
        open: usize,
    ) -> Self {
        let bits = |numbers: &[f64]| numbers.iter().map(|x| x.to_bits()).collect::<Vec<_>>();
        let joints = joints.flatten().flat_map(|m| bits(&m.to_cols_array())).collect();
        let world = worlds.flat_map(|world| bits(&world.to_cols_array())).collect();
        Self { object: object.clone(), joints, world, open }
    }
}

/// What a material asks of its meshes.
pub fn needs(material: &Material) -> Needs {
    (material.tangent_set(), [0, 1].map(|set| material.textures.iter().any(|t| t.set == set)))
}

impl Kept {
    pub fn images(&self) -> MutexGuard<'_, HashMap<usize, Arc<Image>>> {
        self.images.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Those of the last time sample.
    pub fn objects(&self) -> Objects {
        self.objects.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Instead of those of earlier time samples.
    pub fn keep(&self, objects: Objects) {
        *self.objects.lock().unwrap_or_else(PoisonError::into_inner) = objects;
    }
}
