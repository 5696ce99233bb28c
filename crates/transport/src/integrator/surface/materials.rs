//! Per-scene and per-mesh material data that does not depend on the hit point.

use std::collections::HashMap;
use std::sync::Arc;

use glam::{Vec3, Vec4};

use super::media::{Media, Medium};
use crate::bsdf::{Anisotropy, Bsdf, Iridescence, LobeSet, Surface};
use crate::scene::{Material, Mesh, Scene, TextureSlot};

/// Bodies that are compared with each other at most; of more, some meet.
const MOST_BODIES: usize = 10_000;
/// Most entries of [`Materials::bodies`].
const MOST_BOXES: usize = 64;

/// What shading a mesh needs.
#[derive(Debug, Clone, Copy)]
pub struct MeshMaterial {
    /// Index into [`Scene::materials`].
    pub material: u32,
    /// Are BSDF and normal map constant (no textures, no vertex colours), and is the mesh static?
    pub constant: bool,
    /// Is the BSDF constant and zero?
    pub black: bool,
    /// Does it emit, or is it unlit?
    pub emits: bool,
    /// KHR_materials_unlit: does it only emit its base colour?
    pub unlit: bool,
    /// Is it [single-sided](Material::is_single_sided)?
    pub single_sided: bool,
    /// Is it a thin wall that light may pass straight on ([`thin_walls`](crate::integrator::through::thin_walls))? Textures decide at each point.
    pub thin_wall: bool,
    /// Does it bound a medium, and is it smooth, so that shadow rays may pass it straight
    /// ([`glass_shadows`](crate::integrator::through::glass_shadows))? Textures decide at each point.
    pub smooth_body: bool,
    /// The medium that it bounds, as in stacks of [`Materials::media`]; `None` for surfaces that bound none.
    pub interior_medium: Option<u32>,
}

/// The constant BSDF of each material, computed once, and the shading that each mesh needs.
#[derive(Debug)]
pub struct Materials {
    /// By material, seen from the front and, if the scene transmits, from the back.
    constant: [Vec<Bsdf>; 2],
    mesh_materials: Vec<MeshMaterial>,
    /// Union of the lobes that surfaces of the scene may have.
    pub lobes: LobeSet,
    /// Does any surface transmit light?
    pub transmits: bool,
    /// Does any surface have a front only?
    pub has_single_sided: bool,
    /// Is any surface a thin wall that light may pass straight on?
    pub has_thin_walls: bool,
    /// Does any surface bound a medium, and is it smooth?
    pub has_smooth_bodies: bool,
    pub disperses: bool,
    /// The media of the scene.
    pub media: Media,
    /// Do rays track media: does any absorb, or may bodies touch or overlap?
    pub tracks_media: bool,
    /// May bodies touch or overlap, so that boundaries are relative to the medium on the other side?
    pub bodies_meet: bool,
    /// Boxes outside of which there are no bodies, world space: the lowest and the highest corner.
    pub bodies: Vec<[Vec3; 2]>,
    /// Sum of the edges of a body's box in metres, by instance and mesh.
    pub body_sizes: HashMap<[u32; 2], f32>,
}

impl Materials {
    /// Prepares the materials of a scene.
    pub fn new(scene: &Scene) -> Self {
        let constant: Vec<_> = scene.materials.iter().map(|m| untextured(m).bsdf()).collect();
        let medium = |m: &Material| m.bounds_body().then_some(Medium { absorption: m.absorption, ior: m.ior });
        let (media, interiors) = Media::new(scene.materials.iter().map(medium));
        let (bodies, bodies_meet, body_sizes) = boxes_of_bodies(scene);
        let kind = |(mesh, moves): (&Arc<Mesh>, bool)| {
            let own = mesh.material as usize;
            let mut kind = classify(scene, mesh, moves, &constant[own], interiors[own]);
            kind.constant &= !(bodies_meet && kind.interior_medium.is_some());
            kind
        };
        let mesh_materials: Vec<_> = scene.meshes.iter().zip(scene.moving_meshes()).map(kind).collect();
        let lit =
            || mesh_materials.iter().filter(|kind| !kind.unlit).map(|kind| &scene.materials[kind.material as usize]);
        let any = |of: fn(&MeshMaterial) -> bool| mesh_materials.iter().any(of);
        let transmits = lit().any(Material::transmits);
        let back_facing = if transmits {
            scene.materials.iter().map(|m| Surface { back_facing: true, ..untextured(m) }.bsdf()).collect()
        } else {
            Vec::new()
        };
        Self {
            constant: [constant, back_facing],
            lobes: lit().map(possible_lobes).fold(LobeSet::default(), LobeSet::union),
            transmits,
            has_single_sided: any(|kind| kind.single_sided),
            has_thin_walls: any(|kind| kind.thin_wall),
            has_smooth_bodies: any(|kind| kind.smooth_body),
            disperses: lit().any(Material::disperses),
            tracks_media: bodies_meet || media.absorb(),
            media,
            bodies_meet,
            bodies,
            body_sizes,
            mesh_materials,
        }
    }

    /// The shading that a mesh needs.
    #[inline]
    pub fn mesh_material(&self, mesh: u32) -> &MeshMaterial {
        &self.mesh_materials[mesh as usize]
    }

    /// The BSDF of a mesh whose material is constant; `back_facing` only in scenes that transmit.
    #[inline]
    pub(crate) fn constant_bsdf(&self, mesh: u32, back_facing: bool) -> &Bsdf {
        &self.constant[usize::from(back_facing)][self.mesh_materials[mesh as usize].material as usize]
    }

    /// A mesh's surface between these stacks: relative to the medium on the other side, where bodies meet.
    #[inline]
    pub fn relative(&self, surface: Surface, mesh: u32, stacks: [u32; 2]) -> Surface {
        match self.mesh_material(mesh).interior_medium {
            Some(medium) if self.bodies_meet => self.media.relative(surface, medium, stacks),
            _ => surface,
        }
    }

    /// The stacks on the side of `wo` and beyond the surface, where a ray with this stack hits a mesh.
    #[inline]
    pub fn media_at_surface(&self, mesh: u32, back_facing: bool, stack: u32) -> [u32; 2] {
        match self.mesh_material(mesh).interior_medium {
            Some(medium) => self.media.at_boundary(medium, back_facing, stack),
            None => [stack; 2],
        }
    }
}

/// Boxes around the bodies of a scene, world space: the lowest and the highest corner. Those of bodies that touch or overlap, to
/// rounding, are one. Says too whether there are such. A body that moves may be everywhere. Also [`Materials::body_sizes`].
fn boxes_of_bodies(scene: &Scene) -> (Vec<[Vec3; 2]>, bool, HashMap<[u32; 2], f32>) {
    if !scene.has_bodies() {
        return Default::default();
    }
    let is_body = |mesh: &Mesh| scene.materials[mesh.material as usize].bounds_body();
    let (bodies, mut boxes): (Vec<_>, Vec<_>) = scene.boxes(|_, mesh| is_body(mesh)).unzip();
    let size = |[low, high]: &[Vec3; 2]| (*high - *low).element_sum();
    let sizes = bodies.into_iter().zip(boxes.iter().map(size)).collect();
    if scene.meshes.iter().zip(scene.moving_meshes()).any(|(mesh, moves)| moves && is_body(mesh)) {
        boxes.fill([Vec3::NEG_INFINITY, Vec3::INFINITY]);
    }
    let union = |[low, high]: [Vec3; 2], [l, h]: [Vec3; 2]| [low.min(l), high.max(h)];
    let all = |boxes: &[[Vec3; 2]]| boxes.iter().copied().reduce(union).into_iter().collect::<Vec<_>>();
    if boxes.len() > MOST_BODIES {
        return (all(&boxes), true, sizes);
    }
    let mut apart: Vec<[Vec3; 2]> = Vec::new();
    for &[low, high] in &boxes {
        let margin = 1e-5 * low.abs().max(high.abs()).max_element();
        let mut one = [low - margin, high + margin];
        while let Some(at) = apart.iter().position(|[l, h]| l.cmple(one[1]).all() && h.cmpge(one[0]).all()) {
            one = union(one, apart.swap_remove(at));
        }
        apart.push(one);
    }
    let meet = apart.len() < boxes.len();
    (if apart.len() > MOST_BOXES { all(&apart) } else { apart }, meet, sizes)
}

/// What shading a mesh needs, with the BSDF of its material without textures.
fn classify(scene: &Scene, mesh: &Mesh, moves: bool, bsdf: &Bsdf, interior_medium: Option<u32>) -> MeshMaterial {
    let m = &scene.materials[mesh.material as usize];
    let constant_surface = mesh.colors.is_none()
        && !m.disperses()
        && (m.anisotropy == 0.0 || mesh.tangents.is_none())
        && TextureSlot::ALL.iter().all(|&slot| match slot {
            TextureSlot::Emissive => true,
            TextureSlot::Normal | TextureSlot::ClearcoatNormal => m.textures[slot].is_none() || mesh.tangents.is_none(),
            _ => m.textures[slot].is_none(),
        });
    MeshMaterial {
        material: mesh.material,
        constant: constant_surface && !moves,
        black: constant_surface && bsdf.lobes().is_empty(),
        emits: m.unlit || m.is_emissive(),
        unlit: m.unlit,
        single_sided: m.is_single_sided(),
        thin_wall: !m.bounds_medium && may_be_smooth_glass(m),
        smooth_body: m.bounds_medium && may_be_smooth_glass(m),
        interior_medium,
    }
}

/// Can the material be smooth glass at some point?
fn may_be_smooth_glass(material: &Material) -> bool {
    let glass = material.has_dielectric() && material.transmission > 0.0;
    // Textures multiply the roughness, or the glossiness.
    let smoothest = match material.textures[TextureSlot::MetallicRoughness] {
        Some(_) => Surface { roughness: 0.0, ..untextured(material) },
        None => untextured(material),
    };
    glass && Surface { metallic: 0.0, anisotropy: None, ..smoothest }.is_smooth_glass()
}

/// Material parameters without textures and vertex colours.
fn untextured(material: &Material) -> Surface {
    surface(material, material.base_color.truncate(), |_| None)
}

/// The lobes that a material may have at some point. Textures and vertex colours multiply, so a lobe that is absent without
/// them is absent with them; only a metalness texture can uncover the lobes of the dielectric.
fn possible_lobes(material: &Material) -> LobeSet {
    let surface = untextured(material);
    match material.textures[TextureSlot::MetallicRoughness] {
        Some(_) => surface.bsdf().lobes().union(Surface { metallic: 0.0, ..surface }.bsdf().lobes()),
        None => surface.bsdf().lobes(),
    }
}

/// Material parameters for the base colour `base_color` and the texels that `texel` returns for the other textures.
#[inline(always)]
pub fn surface(material: &Material, base_color: Vec3, texel: impl Fn(TextureSlot) -> Option<Vec4>) -> Surface {
    let factor = |slot: TextureSlot, channel: usize| texel(slot).map_or(1.0, |texel| texel[channel]);
    let tint = |slot: TextureSlot| texel(slot).map_or(Vec3::ONE, Vec4::truncate);
    let [thinnest, thickest] = material.iridescence_thickness;
    Surface {
        transmission: material.transmission * factor(TextureSlot::Transmission, 0),
        diffuse_transmission: material.diffuse_transmission * factor(TextureSlot::DiffuseTransmission, 3),
        diffuse_transmission_color: material.diffuse_transmission_color * tint(TextureSlot::DiffuseTransmissionColor),
        bounds_medium: material.bounds_medium,
        sheen_color: material.sheen_color * tint(TextureSlot::SheenColor),
        sheen_roughness: material.sheen_roughness * factor(TextureSlot::SheenRoughness, 3),
        clearcoat: material.clearcoat * factor(TextureSlot::Clearcoat, 0),
        clearcoat_roughness: material.clearcoat_roughness * factor(TextureSlot::ClearcoatRoughness, 1),
        anisotropy: (material.anisotropy > 0.0).then(|| Anisotropy {
            strength: material.anisotropy * factor(TextureSlot::Anisotropy, 2),
            tangent: Vec3::ZERO,
        }),
        iridescence: (material.iridescence > 0.0).then(|| Iridescence {
            factor: material.iridescence * factor(TextureSlot::Iridescence, 0),
            ior: material.iridescence_ior,
            thickness: texel(TextureSlot::IridescenceThickness)
                .map_or(thickest, |texel| thinnest + (thickest - thinnest) * texel.y),
        }),
        ..core(material, base_color, &texel)
    }
}

/// Parameters of the core model only, from the same arguments as [`surface`].
#[inline(always)]
pub fn core(material: &Material, base_color: Vec3, texel: impl Fn(TextureSlot) -> Option<Vec4>) -> Surface {
    let mut s = Surface {
        base_color,
        metallic: material.metallic,
        roughness: material.roughness,
        specular: material.specular,
        specular_color: material.specular_color,
        ior: material.ior,
        energy_compensation: material.energy_compensation,
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
