//! Materials, as far as they are the same everywhere.

use crate::bsdf::{MetallicRoughness, Surface};
use crate::scene::{Material, Mesh, Scene, TextureSlot};

/// How much of shading a mesh needs.
#[derive(Debug, Clone, Copy)]
pub struct Kind {
    /// Its index into [`Scene::materials`].
    pub material: u32,
    /// No texture or vertex colour varies its scattering or its normal.
    pub plain: bool,
    /// Plain, and nothing scatters.
    pub black: bool,
    /// It emits, or is unlit.
    pub shines: bool,
    /// It does nothing but emit its colour.
    pub unlit: bool,
}

/// The scattering of each material that no texture or vertex colour varies, made once, and each mesh's kind.
#[derive(Debug)]
pub struct Materials {
    constant: Vec<MetallicRoughness>,
    kinds: Vec<Kind>,
    /// No surface of the scene has a specular lobe.
    pub lambert: bool,
}

impl Materials {
    /// Prepares a scene's materials.
    pub fn new(scene: &Scene) -> Self {
        let constant: Vec<_> = scene.materials.iter().map(constant).collect();
        let kinds: Vec<_> = scene.meshes.iter().map(|mesh| kind(scene, mesh, &constant)).collect();
        let lambert = kinds.iter().all(|k| k.plain && constant[k.material as usize].is_lambert());
        Self { constant, kinds, lambert }
    }

    /// The kind of a mesh.
    #[inline]
    pub fn kind(&self, mesh: u32) -> &Kind {
        &self.kinds[mesh as usize]
    }

    /// The scattering of a plain mesh.
    #[inline]
    pub fn plain(&self, mesh: u32) -> &MetallicRoughness {
        &self.constant[self.kinds[mesh as usize].material as usize]
    }
}

fn kind(scene: &Scene, mesh: &Mesh, constant: &[MetallicRoughness]) -> Kind {
    let m = &scene.materials[mesh.material as usize];
    let plain = mesh.colors.is_none()
        && TextureSlot::ALL.iter().all(|&slot| match slot {
            TextureSlot::Emissive => true,
            TextureSlot::Normal => m.textures[slot].is_none() || mesh.tangents.is_none(),
            _ => m.textures[slot].is_none(),
        });
    let black = plain && constant[mesh.material as usize].is_black();
    Kind { material: mesh.material, plain, black, shines: m.unlit || m.is_emissive(), unlit: m.unlit }
}

/// The scattering without textures and vertex colours.
fn constant(m: &Material) -> MetallicRoughness {
    MetallicRoughness::new(&Surface {
        base_color: m.base_color.truncate(),
        metallic: m.metallic,
        roughness: m.roughness,
        specular: m.specular,
        specular_color: m.specular_color,
        ior: m.ior,
    })
}
