//! Materials of the scene, with only the textures that are sampled.

use std::collections::HashMap;

use super::lights::dimmed;
use super::textures::TextureTable;
use super::unshown::note_extensions;
use crate::error::Result;
use crate::scene::import::document::Document;
use crate::scene::import::document::materials::Material;
use crate::scene::import::report::Notes;
use crate::scene::{self, TextureSlot};

/// Converts a material and registers the textures that it samples.
fn resolve(
    from: &Material,
    document: &Document,
    textures: &mut TextureTable,
    notes: &mut Notes,
) -> Result<scene::Material> {
    for path in &from.clamped {
        notes.repaired(path, "a factor outside of 0 to 1 is clamped");
    }
    note_extensions(&from.at, &from.extensions, notes);
    let mut material = from.plain.clone();
    let lit = !material.unlit;
    for slot in TextureSlot::ALL {
        let Some(info) = &from.textures[slot as usize] else { continue };
        let needed = match slot {
            TextureSlot::BaseColor => true,
            TextureSlot::MetallicRoughness => lit && (material.metallic > 0.0 || material.roughness > 0.0),
            TextureSlot::Normal => lit && material.normal_scale != 0.0,
            TextureSlot::Emissive => lit && material.emissive.max_element() > 0.0,
            TextureSlot::Specular => material.has_dielectric() && material.specular > 0.0,
            TextureSlot::SpecularColor => {
                material.has_dielectric() && material.specular > 0.0 && material.specular_color.max_element() > 0.0
            }
            TextureSlot::Transmission => material.has_dielectric() && material.transmission > 0.0,
            TextureSlot::DiffuseTransmission | TextureSlot::DiffuseTransmissionColor => {
                material.has_dielectric() && material.diffuse_transmission > 0.0
            }
            TextureSlot::SheenColor | TextureSlot::SheenRoughness => lit && material.sheen_color.max_element() > 0.0,
            TextureSlot::Clearcoat | TextureSlot::ClearcoatRoughness => lit && material.clearcoat > 0.0,
            TextureSlot::ClearcoatNormal => lit && material.clearcoat > 0.0 && material.clearcoat_normal_scale != 0.0,
            TextureSlot::Anisotropy => lit && material.anisotropy > 0.0,
            TextureSlot::Iridescence => lit && material.iridescence > 0.0,
            TextureSlot::IridescenceThickness => {
                lit && material.iridescence > 0.0
                    && material.iridescence_thickness[0] != material.iridescence_thickness[1]
            }
            TextureSlot::SpecularGlossiness => lit,
        };
        if needed {
            material.textures[slot] = textures.register(document, info, slot, notes)?;
        } else {
            notes.not_loaded(&info.at, "a texture whose factor is 0, or that the material does not use");
        }
    }
    if let Some(text) = dimmed(&mut material.emissive) {
        notes.approximated(&from.at, text);
    }
    if material.transmits() {
        let text = "light passes through; shadow rays pass thin smooth glass alone, and smooth bodies by glass shadows: behind \
                    other glass, punctual lights do not shine";
        notes.convention(&from.at, text);
    }
    if from.has_occlusion {
        let text = "occlusion textures are not loaded: light transport computes the occlusion";
        notes.not_loaded(&format!("{}.occlusionTexture", from.at), text);
    }
    if !material.double_sided {
        let text =
            "doubleSided is false: the camera does not see back faces (unless back faces are shown); other light does";
        notes.convention(&from.at, text);
    }
    Ok(material)
}

/// The scene's materials, created when a mesh first uses them.
#[derive(Default)]
pub struct MaterialTable {
    pub materials: Vec<scene::Material>,
    by_index: HashMap<Option<usize>, u32>,
}

impl MaterialTable {
    /// The scene's index of a material of the document; `None` is the default material.
    /// Errors: A faulty material, or texture that it samples.
    pub fn get(
        &mut self,
        document: &Document,
        index: Option<usize>,
        textures: &mut TextureTable,
        notes: &mut Notes,
    ) -> Result<u32> {
        if let Some(&known) = self.by_index.get(&index) {
            return Ok(known);
        }
        let material = match index {
            Some(index) => resolve(document.materials.get(index)?, document, textures, notes)?,
            None => scene::Material::default(),
        };
        self.materials.push(material);
        let new = (self.materials.len() - 1) as u32;
        self.by_index.insert(index, new);
        Ok(new)
    }

    pub(crate) fn note_unused(&self, document: &Document, notes: &mut Notes) {
        for (index, material) in document.materials.sound() {
            if !self.by_index.contains_key(&Some(index)) {
                notes.not_loaded(&material.at, "a material that no placed mesh uses");
            }
        }
    }
}
