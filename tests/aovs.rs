//! What the layers besides the beauty contain.

use std::sync::Arc;

use bismar::film::{Aov, AovSums, ExtraSums, PixelStats, Pixels, exr_file};
use bismar::rays::Backend;
use bismar::render::{Balance, Choice, LightGroups, RenderSettings, Rendered, Technique};
use bismar::scene::{Environment, Material, PunctualKind, PunctualLight, Scene};
use glam::{Vec3, Vec4};

use crate::helpers::gltf_parts::{data_uri, floats};
use crate::helpers::pictures::{python, run};
use crate::helpers::program::{Folder, bits, channel, expect, scene};
use crate::helpers::stage::{Stage, area_light, lambert, look, metal, punctual, rectangle};
use crate::import_content::{accessor, with};

fn rendered(scene: Scene, balance: Balance, adaptive: Choice) -> Rendered {
    let stage = Stage::new(Arc::new(scene), Backend::Embree);
    let settings = RenderSettings {
        width: 24,
        height: 16,
        spp: Some(32),
        aovs: true,
        extras: true,
        light_groups: Some(LightGroups::kinds()),
        balance,
        ..RenderSettings::even().with(Technique::Adaptive, adaptive)
    };
    stage.render(&settings)
}

/// The last argument is light by kind.
fn each(rendered: &Rendered, mut check: impl FnMut(PixelStats, AovSums, ExtraSums, [[f32; 3]; 3])) {
    let pixels = rendered.pixels();
    for (x, y) in (0..16).flat_map(|y| (0..24).map(move |x| (x, y))) {
        let (stats, sums) = pixels.at(x, y);
        check(stats, sums, pixels.extras(x, y).unwrap().into_owned(), [0, 1, 2].map(|kind| pixels.light(x, y, kind)));
    }
}

/// A floor under an area light, a bulb and an environment.
fn lit(radiance: f32) -> Scene {
    let mut scene = Scene { environment: Some(Environment::constant([0.3, 0.2, 0.1])), ..Default::default() };
    rectangle(&mut scene, 0.0, [-3.0, 3.0], [-3.0, 3.0], true, lambert(0.6));
    rectangle(&mut scene, 2.0, [-0.4, 0.4], [-0.9, -0.3], false, area_light(radiance));
    rectangle(&mut scene, 0.6, [-1.5, 1.5], [-2.0, -1.0], true, metal(0.3));
    let bulb = punctual(PunctualKind::Point, 1.0, Vec3::new(1.0, 1.0, 0.5), Vec3::NEG_Y);
    scene.lights.push(PunctualLight { intensity: Vec3::new(0.5, 1.0, 2.0), ..bulb });
    look(&mut scene, Vec3::new(0.0, 1.2, 4.0), Vec3::new(0.0, 0.8, 0.0), 0.8);
    scene
}

#[test]
fn groups_of_light_and_direct_and_indirect_light_add_up_to_the_beauty() {
    // On the silhouettes of a bright light, camera rays for emission alone add to both.
    for (balance, radiance, adaptive, size) in [
        (Balance::Progressive, 9.0, Choice::Off, 0.0),
        (Balance::Progressive, 9.0, Choice::Off, 0.3),
        (Balance::Half, 9.0, Choice::Off, 0.0),
        (Balance::Progressive, 900.0, Choice::On, 0.0),
        (Balance::Progressive, 900.0, Choice::On, 0.3),
    ] {
        let mut scene = lit(radiance);
        scene.lights[0].size = size;
        let rendered = rendered(scene, balance, adaptive);
        let found = rendered.stats.techniques[Technique::Adaptive].and_then(|adaptive| adaptive.emission_rays);
        assert_eq!(found > Some(0.0), adaptive == Choice::On);
        let mut by_group = [0.0; 3];
        each(&rendered, |stats, sums, _, lights| {
            for c in 0..3 {
                let all: f32 = lights.iter().map(|light| light[c]).sum();
                let beauty = stats.sum[c] as f32;
                assert!((all - beauty).abs() <= 1e-4 * beauty.max(1.0), "{all} {beauty}");
                let both = sums.direct[c] + sums.indirect[c];
                assert!((both - beauty).abs() <= 1e-4 * beauty.max(1.0), "{both} {beauty}");
            }
            for (total, group) in by_group.iter_mut().zip(lights) {
                *total += f64::from(group[1]);
            }
        });
        assert!(by_group.iter().all(|light| *light > 1.0), "{by_group:?}");
    }
}

#[test]
fn emission_is_the_lamps_own_and_position_is_where_the_ray_ends() {
    let eye = Vec3::new(0.0, 1.2, 4.0);
    let (mut seen, mut near) = (0, 0);
    each(&rendered(lit(9.0), Balance::Half, Choice::Off), |stats, sums, extras, _| {
        let share = extras.emission[1] / (9.0 * stats.samples as f32);
        seen += u32::from(share > 0.0);
        assert!((0.0..=1.0).contains(&share), "{share}");
        if stats.covered == stats.samples {
            let n = stats.covered as f32;
            let position = Vec3::from(extras.position) / n;
            // A pixel sees little of the floor near the eye.
            let depth = sums.depth / n;
            if depth < 5.0 {
                near += 1;
                assert!((position.distance(eye) - depth).abs() < 0.05 * depth, "{position} {depth}");
            }
        } else if stats.covered == 0 {
            assert_eq!(extras.position, [0.0; 3]);
        }
    });
    assert!(seen > 0 && near > 50, "{seen} {near}");
}

#[test]
fn a_denoisers_guides_are_what_a_mirror_shows() {
    let mut scene = Scene { environment: Some(Environment::constant([1.0; 3])), ..Default::default() };
    let colored = |material: Material, r, g, b| Material { base_color: Vec4::new(r, g, b, 1.0), ..material };
    // Looked at from above: a mirror, and above the eye a red ceiling that only the mirror shows.
    rectangle(&mut scene, 0.0, [-5.0, 5.0], [-5.0, 5.0], true, colored(metal(0.0), 0.9, 0.8, 0.7));
    rectangle(&mut scene, 3.0, [-90.0, 90.0], [-90.0, 90.0], false, colored(lambert(0.5), 0.5, 0.1, 0.1));
    look(&mut scene, Vec3::new(0.0, 2.0, 0.0), Vec3::ZERO, 0.5);
    each(&rendered(scene, Balance::Progressive, Choice::Off), |stats, sums, extras, _| {
        let n = stats.samples as f32;
        let close = |sum: [f32; 3], expected: [f32; 3]| {
            sum.iter().zip(expected).for_each(|(a, b)| assert!((a / n - b).abs() < 1e-3, "{sum:?} {expected:?} {n}"));
        };
        close(sums.albedo, [0.9, 0.8, 0.7]);
        close(sums.normal, [0.0, 1.0, 0.0]);
        close(extras.guide_albedo, [0.45, 0.08, 0.07]);
        close(extras.guide_normal, [0.0, -1.0, 0.0]);
    });
}

#[test]
fn mattes_are_read_by_the_specification_and_say_what_the_numbers_of_objects_say() {
    let folder = Folder::new();
    let line = format!("render {} --size 60x45 --spp 16 -q --aov all", scene("cornell.glb").display());
    expect(&folder, &format!("{line} -o a.exr"), 0);
    for part in [1, 2] {
        expect(&folder, &format!("{line} --part {part}/2 -o {part}.exr"), 0);
    }
    expect(&folder, "merge 1.exr 2.exr -o merged.exr -q", 0);
    assert!(bits(&folder.join("a.exr")) == bits(&folder.join("merged.exr")));
    let Some(python) = python() else { return };
    for file in ["a.exr", "merged.exr"] {
        let found = run(&python, "matte.py", &folder, &[file]);
        for kind in ["object", "material"] {
            let of = &found[kind];
            let number = |key: &str| of[key].as_f64().unwrap();
            // Every hash has a name, whose hash it is by another's program; coverage adds up to alpha.
            assert_eq!((number("unknown"), number("wrong_hashes")), (0.0, 0.0), "{kind}: {of}");
            assert!(number("coverage_error") < 1e-5 && number("names") >= 3.0, "{kind}: {of}");
            assert!(number("whole_pixels") > 1000.0 && number("other_than_number") == 0.0, "{kind}: {of}");
        }
    }
}

#[test]
fn every_layer_of_a_picture_of_one_path_is_finite() {
    let folder = Folder::new();
    let line = format!("render {} --size 24x16 --spp 1 --aov all -q -o one.exr", scene("cornell.glb").display());
    expect(&folder, &line, 0);
    let mut seen = 0;
    for (name, values) in bits(&folder.join("one.exr")) {
        // Ids and hashes are no numbers.
        if name.starts_with("variance") || name.starts_with("lights") || name.len() == 1 {
            assert!(values.iter().all(|value| f32::from_bits(*value).is_finite()), "{name}");
            seen += 1;
        }
    }
    assert!(seen >= 6, "{seen}");
}

#[test]
fn the_balance_layer_holds_the_light_shares_of_the_next_pass() {
    let rendered = rendered(lit(9.0), Balance::SecondOrder, Choice::Off);
    let folder = Folder::new();
    let path = folder.join("a.exr");
    exr_file::write(&path, &rendered.pixels(), &[Aov::Balance], &exr_file::Header::new(), None).unwrap();
    let written = channel(&path, "balance.V");
    let pixels = rendered.pixels();
    let learned: Vec<_> =
        (0..16).flat_map(|y| (0..24).map(move |x| (x, y))).map(|(x, y)| pixels.light_share(x, y)).collect();
    assert_eq!(written, learned);
    assert!(learned.iter().filter(|share| **share != 0.5).count() > 100);
}

#[test]
fn the_uv_layer_is_texcoord_0_whatever_the_material_samples() {
    let path = &Folder::new();
    // TEXCOORD_0 is x and y, TEXCOORD_1 something else.
    let coordinates = floats(&[0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.5, 0.5, 0.25, 0.5, 0.5, 0.25]);
    let accessors = [36, 60].map(|offset| accessor(offset, 5126, 3, "VEC2", false)).concat();
    let primitive = r#"{"attributes":{"POSITION":0,"TEXCOORD_0":1,"TEXCOORD_1":2},"material":0}"#;
    let mut parts = with(coordinates, &accessors, primitive);
    let png = data_uri("image/png", &bismar::film::preview::encoded(1, 1, &[200; 3]).unwrap());
    let transform = r#","extensions":{"KHR_texture_transform":{"scale":[3,2],"offset":[0.5,0.25]}}"#;
    for (slot, set, transform) in [
        ("baseColorTexture", 0, transform),
        ("baseColorTexture", 1, ""),
        ("metallicRoughnessTexture", 1, transform),
        ("normalTexture", 1, ""),
        ("emissiveTexture", 1, ""),
    ] {
        let texture = format!(r#""{slot}":{{"index":0,"texCoord":{set}{transform}}}"#);
        let material = match slot {
            "normalTexture" | "emissiveTexture" => format!(r#"{{{texture},"emissiveFactor":[1,1,1]}}"#),
            _ => format!(r#"{{"pbrMetallicRoughness":{{{texture}}}}}"#),
        };
        parts.more = format!(
            r#","extensionsUsed":["KHR_texture_transform"],"materials":[{material}],"textures":[{{"source":0}}],
            "images":[{{"uri":"{png}"}}]"#
        );
        std::fs::write(path.join("t.gltf"), parts.json()).unwrap();
        expect(path, "render t.gltf --sky --size 24x16 --spp 4 --aov uv,position -o t.exr -q", 0);
        let of = |name: &str| channel(&path.join("t.exr"), name);
        for (uv, position) in [("uv.U", "position.X"), ("uv.V", "position.Y")] {
            let largest = of(uv).into_iter().fold(0.0, f32::max);
            assert!(largest > 0.5, "{slot} on set {set}: {uv} is at most {largest}");
            for (uv, position) in of(uv).into_iter().zip(of(position)) {
                // Both are interpolated in 32-bit floats.
                assert!((uv - position).abs() < 1e-5, "{slot} on set {set}: {uv} for {position}");
            }
        }
    }
}
