//! Depth of field against closed forms: the blurred edge of an area light, for round and polygonal lenses; what has no lens is
//! as it was.

use std::f64::consts::{PI, TAU};
use std::fs;
use std::sync::Arc;

use bismar::rays::Backend;
use bismar::render::settings::lens::{Aperture, Focus, LensSettings};
use bismar::render::{Balance, RenderSettings};
use bismar::scene::{Projection, Scene};
use glam::Vec3;

use crate::closed_forms::settings;
use crate::helpers::glb;
use crate::helpers::program::{Folder, assert_same_bits, channel, expect, says};
use crate::helpers::stage::{Stage, add, area_light, look};
use crate::helpers::statistics::z_limit;
use crate::merge::in_parts;
use crate::motion::pixel_means;

const YFOV: f32 = 0.2;
const COLUMNS: u32 = 8;
const REPLICAS: u32 = 200;

/// An area light over all x < 0 at this distance, seen along -z.
fn edge(distance: f32, orthographic: bool) -> Arc<Scene> {
    let mut scene = Scene::default();
    let points =
        vec![[-50.0, -50.0, -distance], [0.0, -50.0, -distance], [0.0, 50.0, -distance], [-50.0, 50.0, -distance]];
    add(&mut scene, points, vec![[0, 1, 2], [0, 2, 3]], area_light(3.0));
    look(&mut scene, Vec3::ZERO, Vec3::NEG_Z, YFOV);
    if orthographic {
        scene.cameras[0].projection = Projection::Orthographic { xmag: 0.2, ymag: 0.2 };
    }
    Arc::new(scene)
}

/// The share of a lens of radius 1 that lies at x < c.
fn share(blades: u32, c: f64) -> f64 {
    let c = c.clamp(-1.0, 1.0);
    if blades == 0 {
        return 0.5 + (c * (1.0 - c * c).sqrt() + c.asin()) / PI;
    }
    // The polygon's corners, cut at c, and its area by the shoelace formula.
    let corner = |i: u32| (TAU * f64::from(i) / f64::from(blades)).sin_cos();
    let corners: Vec<(f64, f64)> = (0..blades).map(corner).map(|(s, c)| (c, s)).collect();
    let mut cut = Vec::new();
    for (i, &a) in corners.iter().enumerate() {
        let b = corners[(i + 1) % corners.len()];
        if a.0 < c {
            cut.push(a);
        }
        if (a.0 < c) != (b.0 < c) {
            let t = (c - a.0) / (b.0 - a.0);
            cut.push((c, a.1 + t * (b.1 - a.1)));
        }
    }
    let area = |points: &[(f64, f64)]| {
        let n = points.len();
        0.5 * (0..n).map(|i| points[i].0 * points[(i + 1) % n].1 - points[(i + 1) % n].0 * points[i].1).sum::<f64>()
    };
    area(&cut) / area(&corners)
}

/// A ray through the lens at l meets the plane of focus at f, and the area light's plane at l (1 - D/F) + f D/F.
fn expected(column: u32, (radius, focus, blades): (f64, f64, u32), distance: f64, orthographic: bool) -> f64 {
    const STEPS: u32 = 4000;
    let half = if orthographic { 0.2 } else { f64::from(0.5 * YFOV).tan() * focus } * f64::from(COLUMNS) / 2.0;
    let one = |step: u32| {
        let at = (f64::from(column) + (f64::from(step) + 0.5) / f64::from(STEPS)) / f64::from(COLUMNS);
        let f = half * (2.0 * at - 1.0);
        let (lens, through) = (1.0 - distance / focus, if orthographic { f } else { f * distance / focus });
        // Of an orthographic camera lens points are offsets from the ray's own.
        let lens = radius * lens;
        match lens {
            0.0 => f64::from(u8::from(through < 0.0)),
            l if l > 0.0 => share(blades, -through / l),
            l => 1.0 - share(blades, -through / l),
        }
    };
    3.0 * (0..STEPS).map(one).sum::<f64>() / f64::from(STEPS)
}

#[test]
fn a_blurred_edge_is_its_closed_form() {
    let cases = [
        // Before and behind the focus, in it, round and not.
        (2.0, 4.0, 0.5, 0, false),
        (5.0, 2.0, 0.3, 0, false),
        (3.0, 3.0, 0.5, 0, false),
        (2.0, 4.0, 0.5, 3, false),
        (5.0, 2.0, 0.3, 7, false),
        (2.0, 4.0, 0.6, 0, true),
        (4.0, 2.0, 0.4, 6, true),
    ];
    let limit = z_limit(2 * cases.len() * COLUMNS as usize);
    for backend in [Backend::Embree, Backend::Obvhs] {
        for (distance, focus, radius, blades, orthographic) in cases {
            let stage = Stage::new(edge(distance, orthographic), backend);
            let lens = LensSettings { aperture: Aperture::Radius(radius), focus: Focus::Distance(focus), blades };
            let of = RenderSettings { width: COLUMNS, spp: Some(16), lens: Some(lens), ..settings() };
            let means = pixel_means(&stage, &RenderSettings { balance: Balance::Half, ..of }, REPLICAS);
            for (column, mean) in (0..COLUMNS).zip(&means) {
                let expected = expected(column, (radius, focus, blades), f64::from(distance), orthographic);
                let z = mean.z(expected);
                let agrees = z.abs() < limit || (mean.mean - expected).abs() < 1e-6;
                let what = format!("{backend:?} lamp at {distance}, focus {focus}, {blades} blades, column {column}");
                assert!(agrees, "{what}: {} for {expected}, z = {z}", mean.mean);
            }
        }
    }
}

#[test]
fn a_lens_is_a_f_stop_of_35_mm_film_and_focuses_by_itself() {
    let path = &Folder::new().with("scene.glb", glb::triangle());
    let flags = "scene.glb --size 40x30 --spp 8 -q";
    expect(path, &format!("render {flags} -o sharp.exr"), 0);
    // The camera stands 3 m before the triangle; half its field of view is 0.35.
    let radius = 0.012 / 0.35_f64.tan() / (2.0 * 0.7);
    expect(path, &format!("render {flags} --aperture f/0.7 -o auto.exr"), 0);
    expect(path, &format!("render {flags} --aperture {radius} --focus 3 -o by-hand.exr"), 0);
    let [sharp, auto, by_hand] =
        ["sharp", "auto", "by-hand"].map(|name| channel(&path.join(format!("{name}.exr")), "G"));
    assert_ne!(sharp, auto);
    assert!(auto.iter().zip(&by_hand).all(|(a, b)| (a - b).abs() < 1e-3));
    // Going on and parts as ever.
    let lens = "--aperture f/0.7 --focus 2 --lens-blades 5";
    expect(path, &format!("render {flags} {lens} -o whole.exr"), 0);
    assert_same_bits(&path.join("whole.exr"), &in_parts(path, &format!("render {flags} {lens}"), 2));
    expect(path, &format!("render {flags} --part 2/2 --aperture f/0.7 -o part2.exr"), 0);
    says(path, "merge part1.exr part2.exr -o merged.exr -q", 65, "lens");
    for (flags, words) in [
        ("--aperture 0", "f-stop"),
        ("--aperture f/", "f-stop"),
        ("--aperture f/2 --focus -1", "distance"),
        ("--aperture f/2 --lens-blades 2", "3 to 32"),
        ("--focus 2", "--aperture"),
        ("--lens-blades 5", "--aperture"),
        ("--camera b --aperture f/2 --crop 0,0,4,4 --size 40x3000", ""),
    ] {
        let code = if words.is_empty() { 0 } else { 64 };
        says(path, &format!("render scene.glb --spp 1 {flags} -o x.exr"), code, words);
    }
    // Nothing in the middle to focus on.
    let mut away = glb::triangle();
    let at = away.windows(7).position(|window| window == b"[0,0,3]").unwrap();
    away[at + 1] = b'9';
    fs::write(path.join("away.glb"), away).unwrap();
    says(path, "render away.glb --aperture f/2 --size 8x6 --spp 1 -o x.exr", 64, "nothing to focus on");
    expect(path, "render away.glb --aperture f/2 --focus 3 --size 8x6 --spp 1 -o x.exr", 0);
}
