//! Materials, as far as they are the same everywhere.

use std::sync::Arc;

use glam::{Vec3, Vec4};

use crate::bsdf::{Anisotropy, Bsdf, Iridescence, LobeSet, Surface};
use crate::scene::{Material, Mesh, Scene, TextureSlot};

/// How much of shading a mesh needs.
#[derive(Debug, Clone, Copy)]
pub struct Kind {
    /// Its index into [`Scene::materials`].
    pub material: u32,
    /// No texture or vertex colour varies its scattering or its normal, and it stands still.
    pub plain: bool,
    /// No texture or vertex colour varies that nothing scatters.
    pub black: bool,
    /// It emits, or is unlit.
    pub shines: bool,
    /// It does nothing but emit its colour.
    pub unlit: bool,
    /// It bounds a body of this medium, an index into [`Materials::media`].
    pub bounds: Option<u32>,
}

/// The scattering of each material that no texture or vertex colour varies, made once, and each mesh's kind.
#[derive(Debug)]
pub struct Materials {
    /// Seen from the front and, where something transmits, from behind.
    constant: [Vec<Bsdf>; 2],
    kinds: Vec<Kind>,
    /// Lobes that the scene's surfaces may have.
    pub lobes: LobeSet,
    /// Does light pass through a surface of the scene?
    pub transmits: bool,
    /// Does it do so by its colour?
    pub disperses: bool,
    /// Absorption per metre in media by their numbers, the first of which absorbs nothing and is everywhere where no
    /// other is. Without others nobody asks in which a path is.
    pub media: Vec<Vec3>,
}

impl Materials {
    /// Prepares a scene's materials.
    pub fn new(scene: &Scene) -> Self {
        let constant: Vec<_> = scene.materials.iter().map(|m| plain(m).bsdf()).collect();
        let mut media = vec![Vec3::ZERO];
        let mut bounds = |m: &Material| {
            let absorbs = m.absorption.max_element() > 0.0;
            absorbs.then(|| media.push(m.absorption));
            if absorbs { media.len() as u32 - 1 } else { 0 }
        };
        let bodies: Vec<_> =
            scene.materials.iter().map(|m| (m.transmits() && m.bounds_medium).then(|| bounds(m))).collect();
        let kind = |(mesh, moves): (&Arc<Mesh>, bool)| {
            let kind = kind(scene, mesh, &constant);
            Kind { bounds: bodies[mesh.material as usize], plain: kind.plain && !moves, ..kind }
        };
        let kinds: Vec<_> = scene.meshes.iter().zip(scene.moving_meshes()).map(kind).collect();
        let lit = || kinds.iter().filter(|kind| !kind.unlit).map(|kind| &scene.materials[kind.material as usize]);
        let lobes = lit().map(lobes).fold(LobeSet::default(), LobeSet::union);
        let transmits = lit().any(Material::transmits);
        let disperses = lit().any(Material::disperses);
        let behind = if transmits {
            scene.materials.iter().map(|m| Surface { behind: true, ..plain(m) }.bsdf()).collect()
        } else {
            Vec::new()
        };
        Self { constant: [constant, behind], kinds, lobes, transmits, disperses, media }
    }

    /// The kind of a mesh.
    #[inline]
    pub fn kind(&self, mesh: u32) -> &Kind {
        &self.kinds[mesh as usize]
    }

    /// The scattering of a plain mesh. `behind` only where the scene transmits.
    #[inline]
    pub fn plain(&self, mesh: u32, behind: bool) -> &Bsdf {
        &self.constant[usize::from(behind)][self.kinds[mesh as usize].material as usize]
    }

    /// Do media absorb?
    #[inline]
    pub fn absorbs(&self) -> bool {
        self.media.len() > 1
    }

    /// The media on the eye's side of a surface and beyond it, where a ray in `medium` meets a mesh.
    #[inline]
    pub fn sides(&self, mesh: u32, behind: bool, medium: u32) -> [u32; 2] {
        match self.kind(mesh).bounds {
            Some(inside) if behind => [inside, 0],
            Some(inside) => [medium, inside],
            None => [medium; 2],
        }
    }
}

fn kind(scene: &Scene, mesh: &Mesh, constant: &[Bsdf]) -> Kind {
    let m = &scene.materials[mesh.material as usize];
    let plain = mesh.colors.is_none()
        && !m.disperses()
        && (m.anisotropy == 0.0 || mesh.tangents.is_none())
        && TextureSlot::ALL.iter().all(|&slot| match slot {
            TextureSlot::Emissive => true,
            TextureSlot::Normal | TextureSlot::ClearcoatNormal => m.textures[slot].is_none() || mesh.tangents.is_none(),
            _ => m.textures[slot].is_none(),
        });
    let black = plain && constant[mesh.material as usize].lobes().is_empty();
    Kind { material: mesh.material, plain, black, shines: m.unlit || m.is_emissive(), unlit: m.unlit, bounds: None }
}

/// The parameters without textures and vertex colours.
fn plain(material: &Material) -> Surface {
    surface(material, material.base_color.truncate(), |_| None)
}

/// Lobes that a material may have. Textures and vertex colours multiply: a lobe that is missing without them is missing
/// with them, but for those of dielectrics, and the innermost, which needs no place in the set.
fn lobes(material: &Material) -> LobeSet {
    let plain = plain(material);
    match material.textures[TextureSlot::MetallicRoughness] {
        Some(_) => plain.bsdf().lobes().union(Surface { metallic: 0.0, ..plain }.bsdf().lobes()),
        None => plain.bsdf().lobes(),
    }
}

/// A material's parameters where its base colour is `base_color` and its other textures read `texel`.
#[inline(always)]
pub fn surface(material: &Material, base_color: Vec3, texel: impl Fn(TextureSlot) -> Option<Vec4>) -> Surface {
    let mut s = Surface {
        transmission: material.transmission,
        diffuse_transmission: material.diffuse_transmission,
        diffuse_transmission_color: material.diffuse_transmission_color,
        bounds_medium: material.bounds_medium,
        sheen_color: material.sheen_color,
        sheen_roughness: material.sheen_roughness,
        clearcoat: material.clearcoat,
        clearcoat_roughness: material.clearcoat_roughness,
        anisotropy: (material.anisotropy > 0.0)
            .then_some(Anisotropy { strength: material.anisotropy, tangent: Vec3::ZERO }),
        iridescence: (material.iridescence > 0.0).then_some(Iridescence {
            factor: material.iridescence,
            ior: material.iridescence_ior,
            thickness: material.iridescence_thickness[1],
        }),
        ..core(material, base_color, &texel)
    };
    if let Some(texel) = texel(TextureSlot::Transmission) {
        s.transmission *= texel.x;
    }
    if let Some(texel) = texel(TextureSlot::DiffuseTransmission) {
        s.diffuse_transmission *= texel.w;
    }
    if let Some(texel) = texel(TextureSlot::DiffuseTransmissionColor) {
        s.diffuse_transmission_color *= texel.truncate();
    }
    if let Some(texel) = texel(TextureSlot::SheenColor) {
        s.sheen_color *= texel.truncate();
    }
    if let Some(texel) = texel(TextureSlot::SheenRoughness) {
        s.sheen_roughness *= texel.w;
    }
    if let Some(texel) = texel(TextureSlot::Clearcoat) {
        s.clearcoat *= texel.x;
    }
    if let Some(texel) = texel(TextureSlot::ClearcoatRoughness) {
        s.clearcoat_roughness *= texel.y;
    }
    if let (Some(anisotropy), Some(texel)) = (&mut s.anisotropy, texel(TextureSlot::Anisotropy)) {
        anisotropy.strength *= texel.z;
    }
    if let Some(iridescence) = &mut s.iridescence {
        if let Some(texel) = texel(TextureSlot::Iridescence) {
            iridescence.factor *= texel.x;
        }
        if let Some(texel) = texel(TextureSlot::IridescenceThickness) {
            let [least, most] = material.iridescence_thickness;
            iridescence.thickness = least + (most - least) * texel.y;
        }
    }
    s
}

/// Of these, the core model's.
#[inline(always)]
pub fn core(material: &Material, base_color: Vec3, texel: impl Fn(TextureSlot) -> Option<Vec4>) -> Surface {
    let mut s = Surface {
        base_color,
        metallic: material.metallic,
        roughness: material.roughness,
        specular: material.specular,
        specular_color: material.specular_color,
        ior: material.ior,
        specular_glossiness: material.specular_glossiness,
        ..Surface::default()
    };
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
    if let (Some(specular), Some(texel)) = (&mut s.specular_glossiness, texel(TextureSlot::SpecularGlossiness)) {
        *specular *= texel.truncate();
        s.roughness = 1.0 - (1.0 - s.roughness) * texel.w;
    }
    s
}
