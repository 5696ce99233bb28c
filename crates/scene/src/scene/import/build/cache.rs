//! Cache shared by imports of the same files at different times: decoded pictures, and meshes that do not change.

use std::collections::{BTreeSet, HashMap};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use glam::{DAffine3, DMat4, DVec3};

use super::animated_bounds::Played;
use super::nodes::ObjectKey;
use super::reader::Reader;
use crate::error::Result;
use crate::scene::import::options::Pose;
use crate::scene::import::report::Note;
use crate::scene::{AlphaMode, Image, Material, Mesh};

/// Results that later imports of the same files reuse.
#[derive(Debug, Default)]
pub struct ImportCache {
    /// Decoded pictures by the document's index.
    images: Mutex<HashMap<usize, Arc<Image>>>,
    objects: Mutex<Objects>,
    /// What an animation of these root nodes moves.
    played: Mutex<Option<Kept>>,
}

type Kept = ((Option<String>, Vec<usize>), Option<Arc<Played>>);

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
    /// Bits of the direction along which triangles that are lines have been left out.
    lost: Option<[u64; 3]>,
}

/// What of meshes depends on their material: the texture coordinate sets that tangents follow, those that are sampled, and the bits
/// of its alpha and cutoff.
pub type AttributeNeeds = ([Option<u8>; 2], BTreeSet<u8>, Option<[u32; 2]>);

/// An object's meshes; in world space if it is placed once.
#[derive(Debug)]
pub struct CachedObject {
    /// Needs of the material of each triangle primitive, in order.
    pub needs: Vec<AttributeNeeds>,
    /// Each mesh with the index of its primitive.
    pub meshes: Vec<(usize, Arc<Mesh>)>,
    pub notes: Vec<Note>,
}

impl CacheKey {
    /// Does the key belong to this mesh of the document?
    pub(crate) fn is_of(&self, mesh: usize) -> bool {
        self.object.mesh == mesh
    }

    /// The key of an object with these joint matrices at its time samples; `worlds` are the transforms that are baked into its
    /// meshes, and `lost` the direction along which triangles that are lines are left out.
    pub fn new<'a>(
        object: &ObjectKey,
        joints: impl Iterator<Item = &'a [DMat4]>,
        worlds: impl Iterator<Item = DAffine3>,
        (shutter_samples, lost): (usize, Option<DVec3>),
    ) -> Self {
        let bits = |numbers: &[f64]| numbers.iter().map(|x| x.to_bits()).collect::<Vec<_>>();
        let joints = joints.flatten().flat_map(|m| bits(&m.to_cols_array())).collect();
        let world = worlds.flat_map(|world| bits(&world.to_cols_array())).collect();
        let lost = lost.map(|lost| lost.to_array().map(f64::to_bits));
        Self { object: object.clone(), joints, world, shutter_samples, lost }
    }
}

/// What of meshes depends on their material; `fades` as in [`super::primitive::read`].
pub(crate) fn attribute_needs((material, fades): (&Material, bool)) -> AttributeNeeds {
    let alpha = |cutoff: f32| Some([material.base_color.w, cutoff].map(f32::to_bits));
    let alpha = match material.alpha_mode {
        _ if fades => None,
        AlphaMode::Opaque => None,
        AlphaMode::Mask(cutoff) => alpha(cutoff),
        AlphaMode::Blend => alpha(-1.0),
    };
    (material.tangent_sets(), material.textures.iter().map(|t| t.set).collect(), alpha)
}

impl ImportCache {
    /// What the animation moves; read once for all frames.
    ///
    /// # Errors
    /// Those of [`Played::read`].
    pub fn played(&self, reader: &mut Reader, pose: &Pose) -> Result<Option<Arc<Played>>> {
        let mut kept = self.played.lock().unwrap_or_else(PoisonError::into_inner);
        let key = (pose.animation.clone(), reader.document.roots.clone());
        if let Some((of, played)) = &*kept
            && *of == key
        {
            return Ok(played.clone());
        }
        let found = Played::read(reader, pose)?.map(Arc::new);
        *kept = Some((key, found.clone()));
        Ok(found)
    }

    /// Decoded pictures, by the document's index.
    pub fn images(&self) -> MutexGuard<'_, HashMap<usize, Arc<Image>>> {
        self.images.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub fn objects(&self) -> Objects {
        self.objects.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    pub(crate) fn set_objects(&self, objects: Objects) {
        *self.objects.lock().unwrap_or_else(PoisonError::into_inner) = objects;
    }
}
