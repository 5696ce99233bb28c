//! Lengths of the document's arrays.

use super::json::Json;
use crate::error::Result;

/// Lengths of the document's arrays, against which indices are checked.
#[derive(Default)]
pub struct Lengths {
    pub accessors: usize,
    pub cameras: usize,
    pub images: usize,
    pub lights: usize,
    pub materials: usize,
    pub meshes: usize,
    pub nodes: usize,
    pub samplers: usize,
    pub scenes: usize,
    pub skins: usize,
    pub textures: usize,
    pub variants: usize,
    /// Index of the chosen material variant.
    pub variant: Option<usize>,
}

/// Elements of the document's arrays, not yet checked.
pub struct Items<'a> {
    pub accessors: Vec<Json<'a>>,
    pub animations: Vec<Json<'a>>,
    pub buffers: Vec<Json<'a>>,
    pub cameras: Vec<Json<'a>>,
    pub images: Vec<Json<'a>>,
    pub lights: Vec<Json<'a>>,
    pub materials: Vec<Json<'a>>,
    pub meshes: Vec<Json<'a>>,
    pub nodes: Vec<Json<'a>>,
    pub samplers: Vec<Json<'a>>,
    pub scenes: Vec<Json<'a>>,
    pub skins: Vec<Json<'a>>,
    pub textures: Vec<Json<'a>>,
    pub variants: Vec<Json<'a>>,
    pub views: Vec<Json<'a>>,
}

impl<'a> Items<'a> {
    /// Finds the arrays in the document's root object.
    ///
    /// # Errors
    /// A member that should be an array and is not; KHR_lights_punctual without lights.
    pub fn of(root: &Json<'a>) -> Result<Self> {
        let lights = match root.extension("KHR_lights_punctual")? {
            Some(json) => {
                if json.object()?.get("lights").is_none() {
                    return Err(json.bad("lights", "an array", "nothing"));
                }
                json.items("lights")?
            }
            None => Vec::new(),
        };
        let variants = match root.extension("KHR_materials_variants")? {
            Some(json) => json.items("variants")?,
            None => Vec::new(),
        };
        Ok(Self {
            accessors: root.items("accessors")?,
            animations: root.items("animations")?,
            buffers: root.items("buffers")?,
            cameras: root.items("cameras")?,
            images: root.items("images")?,
            lights,
            materials: root.items("materials")?,
            meshes: root.items("meshes")?,
            nodes: root.items("nodes")?,
            samplers: root.items("samplers")?,
            scenes: root.items("scenes")?,
            skins: root.items("skins")?,
            textures: root.items("textures")?,
            variants,
            views: root.items("bufferViews")?,
        })
    }

    /// The arrays' lengths. `variant` is the index of the chosen material variant.
    pub fn lengths(&self, variant: Option<usize>) -> Lengths {
        Lengths {
            accessors: self.accessors.len(),
            cameras: self.cameras.len(),
            images: self.images.len(),
            lights: self.lights.len(),
            materials: self.materials.len(),
            meshes: self.meshes.len(),
            nodes: self.nodes.len(),
            samplers: self.samplers.len(),
            scenes: self.scenes.len(),
            skins: self.skins.len(),
            textures: self.textures.len(),
            variants: self.variants.len(),
            variant,
        }
    }
}
