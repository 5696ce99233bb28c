//! The materials of random scenes, by name.

use std::sync::Arc;

use bismar::sampling::SplitMix64;
use bismar::scene::build::{glass, lambert, metal};
use bismar::scene::{AlphaMode, Filter, Image, Material, Scene, Texels, Texture, TextureRef, TextureSlot, Wrap};
use glam::{Vec3, Vec4};

/// Makes a material; its textures go to the scene.
type Make = fn(&mut Scene, &mut SplitMix64) -> Material;

/// Materials of surfaces that need not be closed.
pub const SURFACES: [(&str, Make); 27] = [
    ("diffuse", |_, random| lambert(between(random, [0.2, 0.9]))),
    ("plastic", |_, random| plastic(between(random, [0.1, 0.6]))),
    ("polished-plastic", |_, _| plastic(0.0)),
    ("black-texels", |scene, random| textured(scene, random, lambert(0.8), TextureSlot::BaseColor, black_or_white)),
    ("black-gloss", |scene, random| textured(scene, random, plastic(0.3), TextureSlot::BaseColor, black_or_white)),
    ("no-specular", |_, random| Material { specular: 0.0, ..plastic(between(random, [0.0, 0.5])) }),
    ("bumps", |scene, random| textured(scene, random, plastic(1.0), TextureSlot::Normal, bump)),
    ("bumpy-metal", |scene, random| textured(scene, random, metal(0.4), TextureSlot::Normal, bump)),
    ("mirror", |_, _| metal(0.0)),
    ("polished-metal", |_, random| metal(between(random, [0.05, 0.25]))),
    // α = 0.1, the commonest in public scenes.
    ("metal-0.316", |_, _| Material { base_color: Vec4::new(0.9, 0.7, 0.4, 1.0), ..metal(0.3163) }),
    ("rough-metal", |_, random| metal(between(random, [0.4, 1.0]))),
    ("half-metal", |_, _| Material { metallic: 0.4, base_color: GREY, ..metal(0.0) }),
    ("rough-half-metal", |_, _| Material { metallic: 0.5, base_color: GREY, ..metal(0.35) }),
    ("roughness-texture", |scene, random| {
        textured(scene, random, metal(1.0), TextureSlot::MetallicRoughness, |random| [0, byte(random), byte(random)])
    }),
    ("varnish", |_, _| Material { clearcoat: 1.0, ..lambert(0.7) }),
    ("rough-coat", |_, random| Material {
        clearcoat: 0.6,
        clearcoat_roughness: between(random, [0.1, 0.5]),
        ..metal(0.5)
    }),
    ("sheen", |_, random| {
        let sheen_roughness = between(random, [0.2, 0.8]);
        Material { sheen_color: Vec3::new(0.9, 0.6, 0.8), sheen_roughness, ..lambert(0.3) }
    }),
    ("brushed", |_, random| {
        let anisotropy_rotation = between(random, [0.0, 3.0]);
        Material { anisotropy: 0.8, anisotropy_rotation, ..metal(0.3) }
    }),
    ("film", |_, random| Material { iridescence: 1.0, ..metal(between(random, [0.0, 0.4])) }),
    ("film-on-plastic", |_, random| Material { iridescence: 0.8, ..plastic(between(random, [0.0, 0.4])) }),
    ("leaf", |_, random| Material { diffuse_transmission: between(random, [0.2, 0.9]), ..lambert(0.8) }),
    ("mask", |scene, random| Material {
        alpha_mode: AlphaMode::Mask(0.5),
        ..textured(scene, random, lambert(0.7), TextureSlot::BaseColor, opaque_or_not)
    }),
    ("blend", |_, random| {
        let base_color = Vec4::new(0.8, 0.5, 0.3, between(random, [0.2, 0.9]));
        Material { alpha_mode: AlphaMode::Blend, base_color, ..plastic(0.5) }
    }),
    ("vertex-colors", |_, _| plastic(0.8)),
    ("glow", |scene, random| {
        let glowing = Material { emissive: Vec3::splat(1.5), ..lambert(0.5) };
        textured(scene, random, glowing, TextureSlot::Emissive, black_or_white)
    }),
    ("pane", |_, random| Material { transmission: 0.9, ..plastic([0.0, 0.3][usize::from(random.f32() < 0.5)]) }),
];

/// Materials of closed bodies, besides those of surfaces.
pub const BODIES: [(&str, Make); 4] = [
    ("glass", |_, _| glass(1.5, 0.0)),
    ("tinted-glass", |_, _| Material { absorption: Vec3::new(2.0, 0.5, 1.0), ..glass(1.4, 0.0) }),
    ("frosted-glass", |_, random| glass(1.5, between(random, [0.15, 0.5]))),
    ("dispersive-glass", |_, _| Material { dispersion: 2.0, ..glass(1.6, 0.0) }),
];

const GREY: Vec4 = Vec4::new(0.8, 0.8, 0.8, 1.0);
/// Texels along a side of a texture.
const SIDE: u32 = 16;

/// Makes a material by name; a diffuse one for an unknown name.
pub fn make(name: &str, scene: &mut Scene, random: &mut SplitMix64) -> Material {
    let found = SURFACES.iter().chain(&BODIES).find(|(own, _)| *own == name);
    Material { name: name.into(), ..found.map_or_else(|| lambert(0.7), |(_, make)| make(scene, random)) }
}

pub fn between(random: &mut SplitMix64, [low, high]: [f32; 2]) -> f32 {
    low + (high - low) * random.f32()
}

fn plastic(roughness: f32) -> Material {
    Material { metallic: 0.0, base_color: GREY, roughness, ..Material::default() }
}

fn byte(random: &mut SplitMix64) -> u8 {
    random.bits() as u8
}

fn black_or_white(random: &mut SplitMix64) -> [u8; 3] {
    [if random.f32() < 0.7 { 0 } else { 255 }; 3]
}

fn opaque_or_not(random: &mut SplitMix64) -> [u8; 4] {
    [200, 220, 160, if random.f32() < 0.5 { 0 } else { 255 }]
}

/// A texel of a normal map; a third of them are steeper than 45°.
fn bump(random: &mut SplitMix64) -> [u8; 3] {
    let [x, y] = [0; 2].map(|_| between(random, [-1.2, 1.2]));
    (Vec3::new(x, y, 1.0).normalize() * 127.5 + 127.5).to_array().map(|x| x as u8)
}

/// The same material with a texture of random texels.
pub fn textured<const N: usize>(
    scene: &mut Scene,
    random: &mut SplitMix64,
    mut material: Material,
    slot: TextureSlot,
    mut texel: impl FnMut(&mut SplitMix64) -> [u8; N],
) -> Material {
    let texel = |_| {
        let mut rgba = [255; 4];
        rgba[..N].copy_from_slice(&texel(random));
        rgba
    };
    let texels = Texels::Rgba8((0..SIDE * SIDE).map(texel).collect());
    let (image, texture) = (scene.images.len() as u32, scene.textures.len() as u32);
    let image_of = Image { name: "texels".into(), width: SIDE, height: SIDE, texels, ..Default::default() };
    scene.images.push(Arc::new(image_of));
    scene.textures.push(Texture { image, wrap_s: Wrap::Repeat, wrap_t: Wrap::Repeat, filter: Filter::Nearest });
    material.textures[slot] = Some(TextureRef { texture, set: 0, transform: None, encoding: slot.encoding() });
    material
}
