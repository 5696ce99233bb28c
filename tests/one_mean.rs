//! All balances have one mean: for each kind of light and of surface, against closed forms or against each other. Lamps with alpha,
//! covers close to lamps, and unlit surfaces are among them.

use std::f64::consts::PI;
use std::sync::Arc;

use bismar::rays::Backend;
use bismar::render::{Balance, Integrator, RenderSettings};
use bismar::scene::{
    AlphaMode, Encoding, Environment, Filter, Image, Material, PunctualKind, PunctualLight, Scene, Texels, Texture,
    TextureRef, TextureSlot, Wrap,
};
use glam::{DVec3, Vec3, Vec4};

use crate::closed_forms::{BOTH, agrees, polygon_irradiance, settings};
use crate::helpers::stage::{Stage, add, area_light, lambert, look, metal, punctual, rectangle, sphere};
use crate::helpers::statistics::z_limit;

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

/// A surface under each kind of light that there is: lamps with and without alpha, environment, punctual lights
/// with and without a size.
fn surface(material: Material) -> Scene {
    let mut scene = Scene { environment: Some(Environment::constant([0.4; 3])), ..Default::default() };
    let (points, indices) = sphere(10, 0.5, Vec3::new(0.0, 0.5, 0.0));
    add(&mut scene, points, indices, material);
    rectangle(&mut scene, 0.0, [-2.0, 2.0], [-2.0, 2.0], true, lambert(0.5));
    rectangle(&mut scene, 1.6, [-0.5, 0.1], [-0.4, 0.4], false, area_light(6.0));
    rectangle(&mut scene, 1.5, [0.2, 0.9], [-0.4, 0.4], false, with_alpha(0.5, AlphaMode::Blend));
    let spot = PunctualKind::Spot { inner: 0.2, outer: 0.9 };
    let points = [PunctualKind::Point, spot, PunctualKind::Directional].map(|kind| (kind, 0.0));
    // The second sphere touches the floor and the surface.
    let sized = [(PunctualKind::Point, 0.2), (PunctualKind::Directional, 0.3), (spot, 1.6)];
    for (kind, size) in points.into_iter().chain(sized) {
        let position = Vec3::new(1.0, 2.0, 1.0);
        scene.lights.push(PunctualLight { size, ..punctual(kind, 0.5, position, -position.normalize()) });
    }
    look(&mut scene, Vec3::new(0.0, 1.0, 2.0), Vec3::new(0.0, 0.4, 0.0), 0.6);
    scene
}

#[test]
fn all_balances_have_one_mean_on_every_kind_of_surface_under_all_kinds_of_light() {
    let plastic = Material { metallic: 0.0, roughness: 0.4, ..Material::default() };
    let surfaces = [
        lambert(0.7),
        metal(0.3),
        metal(0.05),
        plastic.clone(),
        Material { clearcoat: 1.0, clearcoat_roughness: 0.1, ..plastic.clone() },
        Material { sheen_color: Vec3::ONE, sheen_roughness: 0.5, ..plastic.clone() },
        Material { diffuse_transmission: 0.6, ..plastic.clone() },
        Material { iridescence: 1.0, ..metal(0.3) },
        Material { transmission: 1.0, roughness: 0.0, ..plastic.clone() },
        Material { transmission: 1.0, roughness: 0.3, bounds_medium: true, ..plastic.clone() },
        Material { base_color: Vec4::new(1.0, 0.5, 0.2, 0.5), alpha_mode: AlphaMode::Blend, ..plastic },
    ];
    const REPLICAS: u32 = 60;
    let balances = Balance::all();
    let limit = z_limit(surfaces.len() * balances.len());
    for material in surfaces {
        let name = format!("{material:?}");
        let stage = Stage::new(Arc::new(surface(material)), Backend::Embree);
        let of = |balance, seed| {
            let settings = RenderSettings { balance, seed, width: 8, height: 6, max_depth: 5, ..settings() };
            stage.mean_green(&settings, REPLICAS)
        };
        let reference = of(Balance::Half, 1);
        for balance in balances {
            let mean = of(*balance, 1000);
            let z = mean.z_to(&reference);
            assert!(z.abs() < limit, "{balance:?}: {} for {}, z = {z}: {name}", mean.mean, reference.mean);
        }
    }
}
