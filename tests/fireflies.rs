//! Bright paths are found and can be limited; light that is no number is left out, and reported.

use std::sync::Arc;

use bismar::integrator::clients::path_log::EventKind;
use bismar::rays::Backend;
use bismar::render::{Balance, Choice, Fireflies, GlassShadows, RenderSettings, Rendered, Replayed, Technique, replay};
use bismar::scene::{Environment, Scene};
use glam::Vec3;

use crate::helpers::program::{Folder, expect, read_json, scene, stdout};
use crate::helpers::stage::{Stage, area_light, glass_hall, hall, lambert, look, rectangle};

fn mean(rendered: &Rendered) -> f64 {
    rendered.film().pixels.iter().map(|p| p.sum[1]).sum()
}

const SMALL: (u32, u32) = (40, 30);

fn settings() -> RenderSettings {
    RenderSettings { width: SMALL.0, height: SMALL.1, spp: Some(32), ..RenderSettings::even() }
}

#[test]
fn a_limit_that_nothing_reaches_changes_no_bit_and_lower_ones_take_light_away() {
    let stage = Stage::new(hall(), Backend::Embree);
    let free = stage.render(&settings());
    let of = |direct, indirect| {
        stage.render(&RenderSettings { clamp_direct: direct, clamp_indirect: indirect, ..settings() })
    };
    assert_eq!(format!("{:?}", of(Some(1e9), Some(1e9)).film()), format!("{:?}", free.film()));
    let (all, direct, indirect) = (mean(&free), mean(&of(Some(0.05), None)), mean(&of(None, Some(0.01))));
    assert!(direct < 0.9 * all && indirect < 0.99 * all, "{all} {direct} {indirect}");
    // What the camera sees directly has no limit.
    let seen = |r: &Rendered| r.film().pixels.iter().map(|p| p.mean()[1]).fold(0.0, f32::max);
    assert!(seen(&of(Some(0.05), Some(0.05))) >= 0.3);
}

#[test]
fn light_beyond_all_numbers_is_left_out_counted_and_found_again() {
    let mut scene = Scene { environment: Some(Environment::constant([0.3; 3])), ..Default::default() };
    rectangle(&mut scene, 0.0, [-3.0, 3.0], [-3.0, 3.0], true, lambert(0.6));
    rectangle(&mut scene, 0.5, [-0.2, 0.2], [-0.2, 0.2], false, area_light(3e38));
    look(&mut scene, Vec3::new(0.0, 1.2, 4.0), Vec3::new(0.0, 0.2, 0.0), 0.6);
    let stage = Stage::new(Arc::new(scene), Backend::Embree);
    let found = stage.render(&settings());
    assert!(found.film().pixels.iter().all(|p| p.mean().iter().all(|x| x.is_finite())));
    let [x, y, path] = found.stats.first_not_finite.unwrap();
    assert!(found.stats.not_finite > 0 && x < SMALL.0 && y < SMALL.1 && path < 32);
    // The path is traced again, and something on it is left out.
    let mut replayed = Vec::new();
    replay(&stage.scene, &settings(), [x, y], Some(path), &mut |path| replayed.push(path)).unwrap();
    assert!(replayed.len() == 1);
    assert!(replayed[0].events.iter().any(|event| matches!(event.kind, EventKind::NotFinite)));
}

#[test]
fn the_brightest_firefly_is_the_path_that_replaying_shows() {
    let folder = Folder::new();
    let line = format!("render {} --size 60x40 --spp 16 --seed 3 -o a.exr", scene("veach.glb").display());
    let said = expect(&folder, &format!("{line} --stats s.json"), 0);
    let stats = read_json(&folder.join("s.json"));
    let brightest = &stats["fireflies"]["brightest"][0];
    let [x, y, path] = ["x", "y", "path"].map(|key| brightest[key].as_u64().unwrap());
    let replay = format!("--spp 16 --seed 3 --replay-pixel {x},{y},{path}");
    assert!(said.contains(&format!("the brightest by {replay}")), "{said}");
    let again = format!("render {} --size 60x40 {replay}", scene("veach.glb").display());
    let listed = stdout(&folder, &again, 0);
    // `pixel 3,4 path 5: [r, g, b]`
    let values = listed.lines().next().unwrap().split('[').nth(1).unwrap().trim_end_matches(']').to_owned();
    let rgb: Vec<f32> = values.split(", ").map(|x| x.parse().unwrap()).collect();
    let shown = bismar::color::luminance(Vec3::from_slice(&rgb));
    let kept = brightest["luminance"].as_f64().unwrap() as f32;
    assert!((shown - kept).abs() <= 1e-6 * kept, "{shown} {kept}");
    assert_eq!(Fireflies::default().count, 0);
}

/// What the events of a path add to it.
fn told(replayed: &Replayed) -> Vec3 {
    let of = |kind: &EventKind| match kind {
        EventKind::Emission { radiance, lent: false, .. } | EventKind::LightSample { radiance, lent: false, .. } => {
            *radiance
        }
        _ => Vec3::ZERO,
    };
    replayed.events.iter().map(|event| of(&event.kind)).sum()
}

#[test]
fn replayed_paths_are_those_of_the_picture_and_their_events_add_up_to_them() {
    use Technique::{Adaptive, Guiding, PathReuse};
    let (hall, glass) = (Stage::new(hall(), Backend::Obvhs), Stage::new(glass_hall(), Backend::Embree));
    let even = RenderSettings { width: 20, height: 18, balance: Balance::Half, ..settings() };
    let sizes = Some("16:8".parse().unwrap());
    let sharing = |of: RenderSettings| RenderSettings { reuse_sizes: sizes, ..of.with(PathReuse, Choice::On) };
    let guided = even.clone().with(Guiding, Choice::On);
    let straight = RenderSettings { glass_shadows: GlassShadows::Straight, max_depth: 9, ..even.clone() };
    for (stage, settings) in [
        (&hall, RenderSettings { noise: Some(0.04), spp: None, ..even.clone() }),
        (&hall, RenderSettings { spp: Some(40), ..even.clone().with(Adaptive, Choice::On) }),
        (&hall, RenderSettings { clamp_direct: Some(0.1), clamp_indirect: Some(0.05), ..even.clone() }),
        (&hall, sharing(even.clone())),
        (&hall, sharing(guided.clone())),
        (&glass, guided.clone()),
        (&glass, straight.clone()),
        (&glass, sharing(guided)),
        (&glass, sharing(straight)),
    ] {
        let film = stage.render(&settings).film();
        let mut lends = false;
        for [x, y] in [[0u32, 0], [7, 9], [13, 2], [17, 17]] {
            let stats = &film.pixels[(y * 20 + x) as usize];
            let (mut paths, mut sum, mut borrowed) = (0, [0.0; 3], Vec::new());
            replay(&stage.scene, &settings, [x, y], None, &mut |path| {
                assert_eq!(path.path, paths);
                (paths, sum) = (paths + 1, [0, 1, 2].map(|c| sum[c] + f64::from(path.radiance[c])));
                let loans: Vec3 = path.borrowed.iter().map(|loan| loan.radiance).sum();
                let (all, most) = (told(&path) + loans, path.radiance.max_element().max(1e-3));
                // Loans are differences of sums over a group; some hundred roundings of them.
                let close = (all - path.radiance).abs().max_element() <= 400.0 * f32::EPSILON * most;
                assert!(close, "{x} {y}: {all} of {}", path.radiance);
                borrowed.extend(path.borrowed);
            })
            .unwrap();
            assert_eq!(paths, stats.samples, "{x} {y}");
            // Bit for bit: the picture adds the same paths in the same order.
            assert_eq!(sum, stats.sum, "{x} {y}");
            // Most of what a pixel borrows is from others.
            let others = borrowed.iter().filter(|loan| loan.from[..2] != [x, y]).count();
            assert!(2 * others >= borrowed.len(), "{x} {y}: {others} of {}", borrowed.len());
            lends |= !borrowed.is_empty();
        }
        assert_eq!(lends, settings.reuse_sizes.is_some());
    }
}
