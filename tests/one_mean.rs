//! All balances have one mean, that of closed forms: lamps with alpha, covers close to lamps, and unlit surfaces. `bismar study means`
//! compares balances and techniques with each other.

use std::f64::consts::PI;
use std::sync::Arc;

use bismar::rays::Backend;
use bismar::render::{Balance, Integrator, RenderSettings};
use bismar::scene::{
    AlphaMode, Encoding, Filter, Image, Material, Scene, Texels, Texture, TextureRef, TextureSlot, Wrap,
};
use glam::{DVec3, Vec3, Vec4};

use crate::closed_forms::{BOTH, agrees, polygon_irradiance, settings};
use crate::helpers::stage::{Stage, area_light, lambert, look, metal, rectangle};

/// Radiance of the floor under a lamp of radiance 10 over x in [-0.2, `x1`].
fn under_lamp(x1: f64) -> f64 {
    let corners = [(-0.2, -0.7), (x1, -0.7), (x1, 0.4), (-0.2, 0.4)].map(|(x, z)| DVec3::new(x, 1.5, z));
    0.5 / PI * 10.0 * polygon_irradiance(DVec3::ZERO, &corners)
}

/// A diffuse floor under a lamp of this material, which the camera does not see.
fn lamp(material: Material) -> Scene {
    let mut scene = Scene::default();
    rectangle(&mut scene, 0.0, [-5.0, 5.0], [-5.0, 5.0], true, lambert(0.5));
    rectangle(&mut scene, 1.5, [-0.2, 1.0], [-0.7, 0.4], false, material);
    look(&mut scene, Vec3::new(0.0, 1.0, 3.0), Vec3::ZERO, 1e-3);
    scene
}

fn with_alpha(alpha: f32, alpha_mode: AlphaMode) -> Material {
    Material { base_color: Vec4::new(0.0, 0.0, 0.0, alpha), alpha_mode, ..area_light(10.0) }
}

/// Adds a scene's first texture, of one row of texels.
pub fn add_texture(scene: &mut Scene, width: u32, texels: Texels, wrap: Wrap, filter: Filter) -> TextureRef {
    scene.images.push(Arc::new(Image { name: "row".into(), width, height: 1, texels, ..Default::default() }));
    scene.textures.push(Texture { image: 0, wrap_s: wrap, wrap_t: wrap, filter });
    TextureRef { texture: 0, set: 0, transform: None, encoding: Encoding::Linear }
}

/// Gives the lamp a picture of two texels, which has alpha 1 where x < 0.4 and 0 elsewhere.
fn with_picture(scene: &mut Scene, slots: &[TextureSlot]) {
    let texels = Texels::Rgba8(vec![[255; 4], [255, 255, 255, 0]]);
    let map = add_texture(scene, 2, texels, Wrap::ClampToEdge, Filter::Nearest);
    let mesh = Arc::make_mut(&mut scene.meshes[1]);
    mesh.texcoords[0] = Some(mesh.positions.iter().map(|p| [(p[0] + 0.2) / 1.2, 0.5]).collect());
    for slot in slots {
        scene.materials[1].textures[*slot] = Some(map.clone());
    }
}

#[test]
fn a_lamp_gives_the_light_of_what_its_alpha_covers() {
    let whole = under_lamp(1.0);
    for (alpha, mode, coverage) in [
        (0.25, AlphaMode::Opaque, 1.0),
        (0.25, AlphaMode::Blend, 0.25),
        (0.25, AlphaMode::Mask(0.5), 0.0),
        (0.75, AlphaMode::Mask(0.5), 1.0),
    ] {
        agrees(lamp(with_alpha(alpha, mode)), coverage * whole, &BOTH);
    }
    // Vertex colours.
    let mut scene = lamp(with_alpha(0.8, AlphaMode::Blend));
    let vertices = scene.meshes[1].positions.len();
    Arc::make_mut(&mut scene.meshes[1]).colors = Some(vec![[1.0, 1.0, 1.0, 0.5]; vertices]);
    agrees(scene, 0.4 * whole, &BOTH);
    // A texture's alpha, alone and beside an emissive texture.
    for slots in [&[TextureSlot::BaseColor][..], &[TextureSlot::BaseColor, TextureSlot::Emissive]] {
        for (mode, factor, coverage) in [(AlphaMode::Mask(0.5), 1.0, 1.0), (AlphaMode::Blend, 0.5, 0.5)] {
            let mut scene = lamp(with_alpha(factor, mode));
            with_picture(&mut scene, slots);
            agrees(scene, coverage * under_lamp(0.4), &BOTH);
        }
    }
}

#[test]
fn a_sheet_close_to_a_lamp_covers_it_and_the_lamp_does_not_cover_itself() {
    for size in [1e-3, 1.0, 1e3f32] {
        let scaled = |cover: Option<f32>| {
            let mut scene = Scene::default();
            rectangle(&mut scene, 0.0, [-5.0 * size, 5.0 * size], [-5.0 * size, 5.0 * size], true, lambert(0.5));
            rectangle(&mut scene, 1.5 * size, [-0.2 * size, size], [-0.7 * size, 0.4 * size], false, area_light(10.0));
            if let Some(gap) = cover {
                let black = Material { double_sided: true, ..lambert(0.0) };
                let y = (1.5 - gap) * size;
                rectangle(&mut scene, y, [-0.3 * size, 1.1 * size], [-0.8 * size, 0.5 * size], false, black);
            }
            look(&mut scene, Vec3::new(0.0, size, 3.0 * size), Vec3::ZERO, 1e-3);
            scene
        };
        agrees(scaled(None), under_lamp(1.0), &[Integrator::Direct]);
        // A hundredth of what hid a cover before.
        agrees(scaled(Some(1e-5)), 0.0, &[Integrator::Direct]);
    }
}

#[test]
fn an_unlit_surface_is_seen_directly_and_in_mirrors_and_gives_no_light() {
    let over = |floor: Material| {
        let unlit = Material { unlit: true, double_sided: true, base_color: Vec4::ONE, ..Material::default() };
        let mut scene = Scene::default();
        rectangle(&mut scene, 0.0, [-5.0, 5.0], [-5.0, 5.0], true, floor);
        rectangle(&mut scene, 1.5, [-9.0, 9.0], [-9.0, 9.0], false, unlit);
        look(&mut scene, Vec3::new(0.0, 1.0, 3.0), Vec3::ZERO, 1e-3);
        scene
    };
    agrees(over(lambert(0.8)), 0.0, &BOTH);
    // One in a hundred reflections of the smoothest metal is too far from the mirror's direction to count.
    for balance in Balance::all() {
        let of = RenderSettings { balance: *balance, ..settings() };
        let mirrored = Stage::new(Arc::new(over(metal(0.0))), Backend::Embree).mean_green(&of, 20).mean;
        assert!((0.97..=1.0).contains(&mirrored), "{balance:?}: {mirrored}");
    }
}
