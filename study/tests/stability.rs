//! The stability study: its checks catch what they are there for, and its command writes what it says.

use std::fs;
use std::process::Command;
use std::sync::atomic::AtomicBool;

use bismar::balance::Balance;
use bismar::render::prepass::SEED;
use bismar::render::{Choice, render};
use bismar_study::stability::judge::{FALSE_ALARM, Verdict, z_limit};
use bismar_study::stability::page::write;
use bismar_study::stability::{Found, Results, guiding, measure, sharing};
use serde_json::Value;
use statrs::distribution::{ContinuousCDF, Normal};

/// The exact cases; replicas have fixed seeds. Means raise a false alarm with a chance of `FALSE_ALARM`.
fn exact(replicas: u32) -> Results {
    measure(replicas, None, &AtomicBool::new(false), &mut || Ok(())).unwrap()
}

#[test]
fn controls_are_caught_every_mean_is_right_and_the_default_survives() {
    let results = exact(500);
    assert!(results.controls.iter().all(|c| c.caught), "{:?}", results.controls);
    let wrong: Vec<_> = results.wrong().iter().map(|(e, m)| format!("{e} {}", m.mode)).collect();
    assert!(wrong.is_empty(), "{wrong:?}");
    for mode in &results.modes {
        let names: Vec<_> = mode.outcomes.iter().map(|o| o.estimator.clone()).collect();
        assert_eq!(names, Balance::all().iter().map(|b| b.name()).collect::<Vec<_>>());
        let half = mode.outcomes.iter().find(|o| o.estimator == "half").unwrap();
        assert!((half.worst_ratio - 1.0).abs() < 1e-9, "half against half in {}: {}", mode.mode, half.worst_ratio);
        // No fixed share is better than the best one.
        assert!(mode.best.unwrap() <= 1.0 + 1e-9);
        let own = mode.outcomes.iter().find(|o| o.estimator == "progressive").unwrap();
        assert!(results.verdict(mode, own) != Verdict::Fails, "{} {}: {own:?}", mode.mode, mode.name);
    }
    for fact in &results.facts {
        for (name, share, right) in fact.answers.iter().filter(|(name, ..)| name == "progressive") {
            assert!(right, "{name} in {}: {share} after {}", fact.mode, fact.shown);
        }
    }
    // Threads have no part in it.
    let alone = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap().install(|| exact(500));
    let numbers =
        |r: &Results| r.modes.iter().flat_map(|m| &m.outcomes).map(|o| (o.z, o.worst_ratio)).collect::<Vec<_>>();
    assert_eq!(numbers(&alone), numbers(&results));
}

#[test]
fn the_stated_false_alarm_rate_is_kept() {
    for tests in [1, 100, 10_000] {
        let tail = 2.0 * Normal::new(0.0, 1.0).unwrap().cdf(-z_limit(tests));
        let level = FALSE_ALARM / tests as f64;
        // The bound of the tail is an upper one, 1/z² too large at most.
        assert!(tail <= level && tail > 0.9 * level, "{tests} tests: {tail} for {level}");
    }
}

#[test]
fn tables_name_every_mode_and_estimator() {
    // Too few renders for their tests; the tables are there all the same.
    let stop = AtomicBool::new(false);
    let balance = Some(measure(1000, Some(20), &stop, &mut || Ok(())).unwrap());
    let guiding = Some(guiding::measure(20, &stop, &mut || Ok(())).unwrap());
    let folder = tempfile::tempdir().unwrap();
    let path_reuse = Some(sharing::measure(20, &stop, &mut || Ok(())).unwrap());
    write(folder.path(), &Found { balance, guiding, path_reuse }).unwrap();
    let read = |name: &str| fs::read_to_string(folder.path().join(name)).unwrap();
    let text = read("stability.md");
    for mode in (1..=29).map(|i| format!("| F{i} ")) {
        assert!(text.contains(&mode), "{mode} in\n{text}");
    }
    let json: Value = serde_json::from_str(&read("stability.json")).unwrap();
    let caught: Vec<_> = json["controls"].as_array().unwrap().iter().map(|c| &c["caught"]).collect();
    assert_eq!(caught, [&Value::Bool(true), &Value::Bool(true)]);
    let rendered = json["modes"].as_array().unwrap().iter().filter(|m| m["rendered"] == true);
    for mode in rendered {
        for outcome in mode["outcomes"].as_array().unwrap() {
            assert!(outcome["finite"] == true && outcome["worst_ratio"].is_number(), "{outcome}");
        }
    }
    assert!(read("report.html").contains("Who survives what"));
}

#[test]
fn guiding_moves_no_mean_and_as_its_pilot_decides_no_pixel_is_worse_for_sure() {
    let results = guiding::measure(1000, &AtomicBool::new(false), &mut || Ok(())).unwrap();
    assert!(results.controls.iter().all(|c| c.caught), "{:?}", results.controls);
    let wrong: Vec<_> = results.wrong().iter().map(|(e, m)| format!("{e} {}", m.mode)).collect();
    assert!(wrong.is_empty(), "{wrong:?}");
    for mode in &results.modes {
        let [on, auto] = &mode.outcomes[..] else { panic!("on and auto") };
        assert!(results.verdict(mode, auto) != Verdict::Fails, "{} {}: {auto:?}", mode.mode, mode.name);
        // A light that was never seen, and a firefly, are worse than no field at all: what they are there for.
        assert!(mode.adversarial == Some(false) || on.mean_ratio > 1.5, "{} {}: {on:?}", mode.mode, mode.name);
    }
}

#[test]
fn what_is_lent_moves_no_mean() {
    let results = sharing::measure(1000, &AtomicBool::new(false), &mut || Ok(())).unwrap();
    let wrong: Vec<_> = results.wrong().iter().map(|(e, m)| format!("{e} {}", m.mode)).collect();
    assert!(wrong.is_empty(), "{wrong:?}");
    // A firefly is divided among its borrowers, never multiplied.
    let firefly = results.modes.iter().find(|mode| mode.mode == "F27").unwrap();
    let all = firefly.outcomes.iter().find(|outcome| outcome.estimator == "16").unwrap();
    assert!(results.verdict(firefly, all) == Verdict::Survives, "{all:?}");
}

#[test]
fn a_picture_in_the_modes_of_guiding_is_what_a_render_is() {
    for case in guiding::scenes::cases().unwrap() {
        for way in [Choice::Off, Choice::On, Choice::Auto] {
            let settings = guiding::scenes::settings(7, way);
            let field = guiding::scenes::field(&case.scene, &guiding::scenes::settings(SEED, way));
            assert_eq!(way == Choice::On, field.is_some() && way != Choice::Auto, "{}", case.mode);
            let own = guiding::pixels(&case.scene, field.as_ref(), 7, settings.spp.unwrap());
            let rendered = render(&case.scene, &settings, &AtomicBool::new(false), &|_| ()).unwrap();
            let film = rendered.film();
            assert_eq!(film.pixels.len(), own.len());
            for (a, b) in film.pixels.iter().zip(&own) {
                assert_eq!((a.sum, a.samples), (b.sum, b.samples), "{} {way:?}", case.mode);
            }
        }
    }
}

#[test]
fn too_few_replicas_are_wrong_usage() {
    let folder = tempfile::tempdir().unwrap();
    let line = "stability --out out --replicas 5";
    let mut command = Command::new(assert_cmd::cargo::cargo_bin!("bismar-study"));
    let output = command.current_dir(folder.path()).args(line.split(' ')).output().unwrap();
    assert_eq!(output.status.code(), Some(64));
    assert!(!folder.path().join("out").exists());
}
