//! `bismar study rays` from end to end on small scenes, and the judge of its differences.

use std::fs;
use std::path::Path;
use std::process::{Command, Output};
use std::sync::Arc;

use bismar::rays::{HitBatch, MISS, RayBatch, RayOrder, RayQueries};
use bismar::scene::{Mesh, Scene};
use bismar_study::rays::Contender;
use bismar_study::rays::agree::{Answers, Class, Judge};
use bismar_study::rays::exact::Hit;
use bismar_study::rays::stream::{Kind, Query, Stream};
use glam::{Affine3A, Quat, Vec3, vec3};
use serde_json::Value;

use crate::helpers::random::Random;
use crate::helpers::ray_scenes::{box_room, scene};

fn study(folder: &Path, line: &str) -> Output {
    let mut command = Command::new(assert_cmd::cargo::cargo_bin!("bismar-study"));
    command.current_dir(folder).args(["rays"]).args(line.split_whitespace()).output().unwrap()
}

fn results(folder: &Path, out: &str) -> Value {
    serde_json::from_str(&fs::read_to_string(folder.join(out).join("results.json")).unwrap()).unwrap()
}

fn names<'a>(rows: &'a Value, column: &str) -> Vec<&'a str> {
    let mut all = rows.as_array().unwrap().iter().map(|r| r[column].as_str().unwrap()).collect::<Vec<_>>();
    all.dedup();
    all
}

const FEW: &str =
    "--rays 2048 --rounds 3 --spp 2 --progress none -q --backends obvhs,embree+robust+single,obvhs+bvh2+slow";

#[test]
fn a_study_reports_every_contender() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let first = study(folder, &format!("--generate sphere:2000,foliage:1000 --out a {FEW}"));
    assert_eq!(first.status.code(), Some(0), "{}", String::from_utf8_lossy(&first.stderr));
    let a = results(folder, "a");
    let contenders = ["embree", "embree (again)", "obvhs", "embree+robust+single", "obvhs+bvh2+slow"];
    assert_eq!(names(&a["builds"], "backend"), [contenders, contenders].concat());
    assert_eq!(names(&a["builds"], "scene"), ["sphere-2000", "foliage-1000"]);
    for row in a["traces"].as_array().unwrap() {
        assert!(row["mrays_per_second"].as_f64().unwrap() > 0.0 && row["rays"].as_u64().unwrap() >= 256, "{row}");
    }
    let streams = ["camera", "shadow", "diffuse", "glossy", "later", "diffuse-shuffled", "diffuse-sorted"];
    assert_eq!(names(&a["traces"], "stream")[..7], streams);
    for row in a["agreements"].as_array().unwrap() {
        assert_eq!(row["unexplained"], 0, "{row}");
    }
    // Four contenders and the baseline on each stream; a scene of few leaves may have too few later bounces.
    let replayed = a["traces"].as_array().unwrap().iter().filter(|t| t["backend"] == "embree").count();
    assert!(replayed >= 7 + 5);
    assert_eq!(a["agreements"].as_array().unwrap().len(), 4 * replayed);
    assert_eq!(fs::read_to_string(folder.join("a/agreements.csv")).unwrap().lines().count(), 1 + 4 * replayed);
    assert_eq!(a["pictures"].as_array().unwrap().len(), 2 * 4);
    let host = &a["hosts"][0];
    // As the renderer's threads are.
    assert_eq!((&host["flush_to_zero"], &host["denormals_are_zero"]), (&Value::Bool(false), &Value::Bool(false)));

    let page = fs::read_to_string(folder.join("a/report.html")).unwrap();
    assert!(page.contains("They agree") && page.contains("obvhs+bvh2+slow"));
}

#[test]
fn wrong_usage_is_told() {
    let folder = tempfile::tempdir().unwrap();
    for (line, words) in [
        ("--out a", "SCENE"),
        ("--out a --generate cube:12", "cube:12"),
        ("--out a --generate sphere:100 --backends embree+best", "there is no 'best'"),
        ("--out a --generate sphere:100 --isa neon", "neon"),
        ("--out a --generate sphere:100,foliage:100,sphere:100", "two scenes are called 'sphere-100'"),
    ] {
        let output = study(folder.path(), line);
        assert_eq!(output.status.code(), Some(64), "{line}");
        assert!(String::from_utf8_lossy(&output.stderr).contains(words), "{line}");
    }
}

fn build(scene: &Arc<Scene>, name: &str) -> Box<dyn RayQueries> {
    let contender = Contender::list(name).unwrap().remove(0);
    contender.build(Arc::clone(scene), &|_| true).unwrap()
}

fn stream(kind: Kind, rays: RayBatch) -> Stream {
    let queries = vec![Query { kind, order: RayOrder::Incoherent, rays }];
    Stream { name: "test".into(), queries }
}

/// A grid that rays meet exactly on vertices and edges, twice in the same place, with needles and a turned copy.
fn adversary() -> Arc<Scene> {
    let n = 8;
    let at = |i: u32, j: u32| [i as f32 / 4.0 - 1.0, 0.0, j as f32 / 4.0 - 1.0];
    let vertices = (0..=n).flat_map(|i| (0..=n).map(move |j| at(i, j))).collect::<Vec<_>>();
    let cells = (0..n).flat_map(|i| (0..n).map(move |j| i * (n + 1) + j));
    let grid = cells.flat_map(|a| [[a, a + 1, a + n + 1], [a + 1, a + n + 2, a + n + 1]]).collect::<Vec<_>>();
    let needles = (0..50).flat_map(|i| {
        let x = i as f32 / 25.0 - 1.0;
        [[x, -0.5, -1.0], [x + 1e-6, -0.5, -1.0], [x, -0.5 + 1e-6, 1.0]]
    });
    let needle_indices = (0..50).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    let turn = Affine3A::from_rotation_translation(Quat::from_rotation_x(0.7), vec3(0.1, -2.0, 0.2));
    let meshes = vec![Mesh::new(vertices, grid), Mesh::new(needles.collect(), needle_indices)];
    Arc::new(scene(meshes, &[(0, None), (0, None), (1, None), (0, Some(turn))]))
}

/// Rays through vertices and edges, in the plane, from the plane, and at random.
fn adversarial_rays() -> RayBatch {
    let mut random = Random(3);
    let mut rays = RayBatch::default();
    for i in 0..4000_u32 {
        let on_grid = vec3((i % 9) as f32 / 4.0 - 1.0, 0.0, (i / 9 % 17) as f32 / 8.0 - 1.0);
        let above = match i % 4 {
            0 => on_grid + Vec3::Y,
            _ => on_grid + random.direction() * 2.0,
        };
        let (origin, direction, tfar) = match i % 8 {
            // Along the plane, from the plane, ending in the plane.
            5 => (vec3(-3.0, 0.0, on_grid.z), Vec3::X, f32::INFINITY),
            6 => (on_grid, random.direction(), f32::INFINITY),
            7 => (above, (on_grid - above).normalize(), (on_grid - above).length()),
            _ => (above, (on_grid - above).normalize(), f32::INFINITY),
        };
        rays.push(origin, direction, 0.0, tfar, i);
    }
    rays
}

#[test]
fn on_adversarial_geometry_backends_differ_and_every_difference_is_explained() {
    for scene in [adversary(), Arc::new(box_room())] {
        let judge = Judge::new(&scene);
        let base = build(&scene, "embree");
        let mut different = 0;
        for kind in [Kind::Closest, Kind::Occluded] {
            let stream = stream(kind, adversarial_rays());
            let of_base = Answers::of(&*base, &stream);
            for name in
                ["embree", "embree+high+robust", "embree+low+compact+x4", "obvhs", "obvhs+bvh2+split", "obvhs+own-test"]
            {
                let other = build(&scene, name);
                let own = Answers::of(&*other, &stream);
                let mut messages = Vec::new();
                let mut tell = |text| messages.push(text);
                let counts = judge.compare(&stream, (&*base, &of_base), (&*other, &own), &mut tell);
                assert_eq!(counts[Class::Unexplained as usize], 0, "{name}: {counts:?} {messages:#?}");
                assert_eq!(counts.iter().sum::<u64>(), 4000);
                different += 4000 - counts[Class::Same as usize];
            }
        }
        // Two grids in one place: some must have chosen the other one.
        assert!(scene.instances.len() == 1 || different > 100, "{different}");
    }
}

#[test]
fn wrong_answers_are_not_explained_away() {
    let scene = Arc::new(box_room());
    let judge = Judge::new(&scene);
    let base = build(&scene, "embree");
    let mut random = Random(5);
    let mut rays = RayBatch::default();
    for _ in 0..500 {
        rays.push(random.point() * 0.3, random.direction(), 0.0, f32::INFINITY, 0);
    }
    let mut hits = HitBatch::default();
    base.closest_hits(&rays, RayOrder::Incoherent, &mut hits);
    let (mut judged, mut caught, mut grazing) = (0, 0, 0);
    for i in (0..rays.len()).filter(|&i| hits.prim[i] != MISS) {
        let truth = Hit::new(&hits, i).unwrap();
        let wrong = [
            None,
            Some(Hit { id: [truth.id[0], truth.id[1], (truth.id[2] + 7) % 36], ..truth }),
            Some(Hit { at: [truth.at[0] + 0.01, truth.at[1], truth.at[2]], ..truth }),
            Some(Hit { at: [truth.at[0], truth.at[1] + 0.01, truth.at[2]], ..truth }),
        ];
        for (k, answer) in wrong.into_iter().enumerate() {
            judged += 1;
            match judge.class(&rays, i, Some(truth), answer) {
                Class::Unexplained => caught += 1,
                // Another triangle whose plane the ray happens to run along: what it says there cannot be refuted.
                Class::Grazing if k == 1 => grazing += 1,
                class => panic!("ray {i}, wrong answer {k}: {class:?}"),
            }
        }
        let within = Hit { at: [truth.at[0] * (1.0 + f32::EPSILON), truth.at[1], truth.at[2]], ..truth };
        assert_eq!(judge.class(&rays, i, Some(truth), Some(within)), Class::Same);
    }
    // None of these rays lies within rounding of an edge.
    assert!(judged > 1200 && caught + grazing == judged && 100 * grazing < judged, "{caught} of {judged}");
}
