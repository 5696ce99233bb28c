//! Materials, as far as they are the same everywhere.

use glam::{Vec3, Vec4};

use crate::bsdf::{Bsdf, LobeSet, Surface};
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
    constant: Vec<Bsdf>,
    kinds: Vec<Kind>,
    /// Lobes that the scene's surfaces may have.
    pub lobes: LobeSet,
}

impl Materials {
    /// Prepares a scene's materials.
    pub fn new(scene: &Scene) -> Self {
        let constant: Vec<_> = scene.materials.iter().map(constant).collect();
        let kinds: Vec<_> = scene.meshes.iter().map(|mesh| kind(scene, mesh, &constant)).collect();
        // Textures and vertex colours multiply: a lobe that is missing without them is missing with them, but for the
        // innermost, which needs no place in the set.
        let lit = kinds.iter().filter(|kind| !kind.unlit);
        let lobes = lit.map(|kind| constant[kind.material as usize].lobes()).fold(LobeSet::default(), LobeSet::union);
        Self { constant, kinds, lobes }
    }

    /// The kind of a mesh.
    #[inline]
    pub fn kind(&self, mesh: u32) -> &Kind {
        &self.kinds[mesh as usize]
    }

    /// The scattering of a plain mesh.
    #[inline]
    pub fn plain(&self, mesh: u32) -> &Bsdf {
        &self.constant[self.kinds[mesh as usize].material as usize]
    }
}

fn kind(scene: &Scene, mesh: &Mesh, constant: &[Bsdf]) -> Kind {
    let m = &scene.materials[mesh.material as usize];
    let plain = mesh.colors.is_none()
        && TextureSlot::ALL.iter().all(|&slot| match slot {
            TextureSlot::Emissive => true,
            TextureSlot::Normal => m.textures[slot].is_none() || mesh.tangents.is_none(),
            _ => m.textures[slot].is_none(),
        });
    let black = plain && constant[mesh.material as usize].lobes().is_empty();
    Kind { material: mesh.material, plain, black, shines: m.unlit || m.is_emissive(), unlit: m.unlit }
}

/// The scattering without textures and vertex colours.
fn constant(material: &Material) -> Bsdf {
    surface(material, material.base_color.truncate(), |_| None).bsdf()
}

/// A material's parameters where its base colour is `base_color` and its other textures read `texel`.
#[inline(always)]
pub fn surface(material: &Material, base_color: Vec3, texel: impl Fn(TextureSlot) -> Option<Vec4>) -> Surface {
    let &Material { metallic, roughness, specular, specular_color, ior, .. } = material;
    let mut s = Surface { base_color, metallic, roughness, specular, specular_color, ior };
    if let Some(texel) = texel(TextureSlot::MetallicRoughness) {
        s.roughness *= texel.y;
        s.metallic *= texel.z;
    }
    if let Some(texel) = texel(TextureSlot::Specular) {
        s.specular *= texel.w;
    }
    if let Some(texel) = texel(TextureSlot::SpecularColor) {
        s.specular_color *= texel.truncate();
    }
    s
}
