//! `--ground shadow`: alpha is what the scene takes from the light of the ground, against renders of a floor with and without
//! the scene.

use std::sync::Arc;

use bismar::film::Pixels;
use bismar::rays::Backend;
use bismar::render::{Ground, Integrator, RenderSettings, Rendered};
use bismar::scene::{Environment, PunctualKind, PunctualLight, Scene};
use glam::Vec3;

use crate::closed_forms::settings;
use crate::helpers::program::{Folder, assert_same_bits, channel, expect};
use crate::helpers::stage::{Stage, area_light, closed_box, lambert, look, punctual, rectangle};
use crate::helpers::statistics::{Mean, z_limit};
use crate::thin_walls::pane;

#[derive(Debug, Clone, Copy)]
enum Lights {
    Environment,
    Lamps,
    All,
}

/// A camera and lights, with what takes light: a black box and a pane of thin glass on four legs of air.
fn stage(lit: Lights, has_floor: bool, has_objects: bool) -> Stage {
    let mut scene = Scene::default();
    if !matches!(lit, Lights::Lamps) {
        scene.environment = Some(Environment::constant([1.0; 3]));
    }
    if !matches!(lit, Lights::Environment) {
        rectangle(&mut scene, 3.0, [1.0, 2.0], [-0.5, 0.5], false, area_light(20.0));
        for (x, size) in [(-1.5, 0.0), (0.5, 0.4)] {
            let light = punctual(PunctualKind::Point, 9.0, Vec3::new(x, 2.5, 0.5), Vec3::NEG_Y);
            scene.lights.push(PunctualLight { size, ..light });
        }
    }
    if has_floor {
        rectangle(&mut scene, 0.0, [-99.0, 99.0], [-99.0, 99.0], true, lambert(0.5));
    }
    if has_objects {
        closed_box(&mut scene, Vec3::new(-0.3, 0.0, -0.3), Vec3::new(0.3, 0.8, 0.3), lambert(0.0));
        rectangle(&mut scene, 1.2, [-1.5, -0.5], [-1.0, 1.0], true, pane());
    }
    look(&mut scene, Vec3::new(0.0, 3.0, 4.0), Vec3::new(0.0, 0.0, 0.3), 0.7);
    Stage::new(Arc::new(scene), Backend::Embree)
}

#[test]
fn alpha_is_the_difference_of_two_renders_over_the_light() {
    for lit in [Lights::Environment, Lights::Lamps, Lights::All] {
        // Without the scene each light shines as if alone: the lamp's body hides nothing of the environment.
        let alone = match lit {
            Lights::All => vec![Lights::Environment, Lights::Lamps],
            one => vec![one],
        };
        let (catcher, with) = (stage(lit, false, true), stage(lit, true, true));
        let without: Vec<_> = alone.into_iter().map(|lit| stage(lit, true, false)).collect();
        let (mut difference, mut taken, mut light) = (Mean::default(), 0.0, 0.0);
        for replica in 0..24 {
            let of = |stage: &Stage, number: u32, ground: Ground| {
                let integrator = Integrator::Direct;
                let (width, height, spp, seed) = (8, 6, Some(2048), 3000 * number + replica);
                stage.render(&RenderSettings { width, height, spp, seed, ground, integrator, ..settings() })
            };
            let catcher = of(&catcher, 0, Ground::Shadow);
            let with = of(&with, 1, Ground::None);
            let without: Vec<_> = (2..).zip(&without).map(|(k, stage)| of(stage, k, Ground::None)).collect();
            let mut sum = 0.0;
            for (x, y) in (0..6).flat_map(|y| (0..8).map(move |x| (x, y))) {
                let (stats, sums) = catcher.pixels().at(x, y);
                if stats.covered > 0 {
                    continue;
                }
                assert_eq!(stats.sum, [0.0; 3], "the ground has no colour");
                let green = |of: &Rendered| f64::from(of.pixels().at(x, y).0.mean()[1]);
                let all: f64 = without.iter().map(green).sum();
                sum += f64::from(sums.shadow) * all - (all - green(&with));
                taken += all - green(&with);
                light += all;
            }
            difference.add(sum);
        }
        assert!(taken > 0.01 * light, "{lit:?}: the shadow is visible: {}", taken / light);
        let z = difference.z(0.0);
        assert!(z.abs() < z_limit(3), "{lit:?}: {} ± {}, z = {z}", difference.mean, difference.standard_error());
    }
}

#[test]
fn a_point_that_sees_the_lamp_has_no_alpha_and_one_that_does_not_is_black() {
    let mut scene = Scene::default();
    rectangle(&mut scene, 1.0, [-0.5, 0.5], [-0.5, 0.5], true, lambert(0.5));
    rectangle(&mut scene, 0.0, [9.0, 9.1], [9.0, 9.1], true, lambert(0.5));
    scene.lights.push(punctual(PunctualKind::Point, 9.0, Vec3::new(0.0, 2.0, 0.0), Vec3::NEG_Y));
    // From the side: the shadow of the square is twice as large, from -1 to 1.
    look(&mut scene, Vec3::new(0.0, 6.0, 8.0), Vec3::new(0.0, 0.0, 1.2), 0.6);
    let stage = Stage::new(Arc::new(scene), Backend::Embree);
    let settings = RenderSettings { width: 40, height: 30, ground: Ground::Shadow, ..settings() };
    let rendered = stage.render(&settings);
    let (mut clear, mut dark, mut between) = (0, 0, 0);
    for (x, y) in (0..30).flat_map(|y| (0..40).map(move |x| (x, y))) {
        let (stats, sums) = rendered.pixels().at(x, y);
        if stats.covered == 0 {
            match sums.shadow {
                0.0 => clear += 1,
                1.0 => dark += 1,
                shadow => {
                    between += 1;
                    assert!(shadow > 0.0 && shadow < 1.0);
                }
            }
        }
    }
    assert!(clear > 600 && dark > 30 && between > 5 && between < 60, "{clear} {dark} {between}");
}

#[test]
fn shadows_are_in_files_previews_parts_and_resumed_pictures() {
    let path = &Folder::new().with_scene("c.glb", "cornell.glb");
    let line = "render c.glb --orbit 40,30,2.5 --size 48x36 --sky --ground shadow -q";
    expect(path, &format!("{line} --spp 256 -o whole.exr --preview whole.png"), 0);
    let [alpha, green] = ["A", "G"].map(|name| channel(&path.join("whole.exr"), name));
    let shadow = alpha.iter().zip(&green).filter(|(a, g)| **a > 0.05 && **a < 1.0 && **g == 0.0).count();
    assert!(shadow > 200 && alpha.iter().all(|a| (0.0..=1.0).contains(a)), "{shadow}");
    let png = image::open(path.join("whole.png")).unwrap().into_rgba8();
    for (pixel, alpha) in png.pixels().zip(&alpha) {
        assert!((f32::from(pixel.0[3]) - 255.0 * alpha).abs() <= 0.51);
    }
    for part in ["1/2", "2/2"] {
        expect(path, &format!("{line} --spp 256 --part {part} -o part{}.exr", &part[..1]), 0);
    }
    expect(path, "merge part1.exr part2.exr -o merged.exr -q", 0);
    assert_same_bits(&path.join("whole.exr"), &path.join("merged.exr"));
    expect(path, &format!("{line} --spp 128 --checkpoint 1000 -o go.exr"), 0);
    expect(path, &format!("{line} --spp 256 --checkpoint 1000 -o go.exr --resume"), 0);
    assert_same_bits(&path.join("whole.exr"), &path.join("go.exr"));
    // It is another picture than the one without.
    expect(path, "render c.glb --orbit 40,30,2.5 --size 48x36 --sky --transparent --spp 256 -q -o go.exr --resume", 65);
    expect(path, &format!("{line} --ground grass -o x.exr"), 64);
}
