//! The same bits, whatever the threads, the window or the number of samples asked for in the end.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};

use bismar::film::{Film, Pixels};
use bismar::rays::Backend;
use bismar::render::{Balance, RenderSettings, Rendered, StopReason, Technique, render};
use bismar::scene::Scene;

use crate::helpers::stage::{Stage, hall};

fn settings() -> RenderSettings {
    RenderSettings { width: 50, height: 37, spp: Some(40), aovs: true, ..RenderSettings::even() }
}

/// Everything about the pixels of a window, each as text that differs when a bit differs.
fn pixels(rendered: &Rendered, [x0, y0, x1, y1]: [u32; 4]) -> Vec<String> {
    let pixels = rendered.pixels();
    let text = |(x, y)| format!("{x} {y} {:?} {}", pixels.at(x, y), pixels.light_share(x, y));
    (y0..y1).flat_map(|y| (x0..x1).map(move |x| (x, y))).map(text).collect()
}

const WHOLE: [u32; 4] = [0, 0, 50, 37];

#[track_caller]
fn assert_same_bits(a: &Rendered, b: &Rendered, window: [u32; 4], what: &str) {
    for (a, b) in pixels(a, window).iter().zip(&pixels(b, window)) {
        assert_eq!(a, b, "{what}");
    }
}

#[test]
fn any_number_of_threads_gives_the_same_bits() {
    for backend in [Backend::Embree, Backend::Obvhs] {
        let stage = Stage::new(hall(), backend);
        for balance in [Balance::Progressive, Balance::SecondOrder, Balance::Power] {
            for (noise, adaptive) in [(Some(0.12), false), (None, true)] {
                let settings = RenderSettings { balance, noise, spp: Some(160), ..settings() };
                let settings = settings.with(Technique::Adaptive, adaptive.into());
                let one = stage.render_on(1, &settings);
                for threads in [2, 7] {
                    let other = stage.render_on(threads, &settings);
                    assert_same_bits(&one, &other, WHOLE, &format!("{backend:?} {balance:?} {threads}"));
                }
            }
        }
    }
}

#[test]
fn a_crop_has_the_bits_of_the_whole() {
    let stage = Stage::new(hall(), Backend::Embree);
    for (noise, adaptive, spp) in [(None, false, 40), (None, true, 40), (Some(0.12), false, 160)] {
        let settings =
            RenderSettings { noise, spp: Some(spp), ..settings() }.with(Technique::Adaptive, adaptive.into());
        let whole = stage.render_on(2, &settings);
        for crop in [[0, 0, 1, 1], [13, 9, 34, 33], [49, 36, 50, 37]] {
            let part = stage.render_on(2, &RenderSettings { crop: Some(crop), ..settings.clone() });
            assert_same_bits(&whole, &part, crop, &format!("{crop:?}"));
        }
    }
}

#[test]
fn seeds_differ() {
    let stage = Stage::new(hall(), Backend::Embree);
    let a = stage.render_on(2, &settings());
    let b = stage.render_on(2, &RenderSettings { seed: 1, ..settings() });
    // The lower rows show the floor, where no pixel is without noise.
    let floor = [0, 25, 50, 37];
    assert!(pixels(&a, floor).iter().zip(&pixels(&b, floor)).all(|(a, b)| a != b));
}

#[test]
fn a_raised_stop_flag_ends_the_render_with_what_there_is() {
    let stage = Stage::new(hall(), Backend::Embree);
    let stop = AtomicBool::new(false);
    let tiles = AtomicU32::new(0);
    let settings = RenderSettings { spp: Some(1 << 20), ..settings() };
    let rendered = render(&stage.scene, &settings, &stop, &|_| {
        if tiles.fetch_add(1, Ordering::Relaxed) == 100 {
            stop.store(true, Ordering::Relaxed);
        }
    })
    .unwrap();
    assert_eq!(rendered.stop, StopReason::Interrupted);
    assert!(rendered.film().pixels.iter().all(|p| p.samples > 0 && p.samples < 1 << 20));
}

#[test]
fn small_first_passes_leave_the_picture_unbiased_and_the_balance_learnt() {
    use bismar::film::PixelStats;
    // One with an area light alone, one with an environment, too: there light samples divide.
    let with_sky = Stage::new(hall(), Backend::Embree);
    let mut scene = Scene::clone(&hall());
    scene.environment = None;
    let settings = RenderSettings { spp: Some(132), ..settings() };
    let timed = RenderSettings { time: Some(1e9), seed: 7, ..settings.clone() };
    for stage in [with_sky, Stage::new(Arc::new(scene), Backend::Embree)] {
        let both = [stage.render_on(2, &settings), stage.render_on(2, &timed)];
        let [plain, early] = both.each_ref().map(Rendered::film);
        let sum = |film: &Film, of: &dyn Fn(&PixelStats) -> f64| film.pixels.iter().map(of).sum::<f64>();
        for c in 0..3 {
            let mean = |film: &Film| sum(film, &|p| f64::from(p.mean()[c]));
            let variance = |film: &Film| sum(film, &|p| f64::from(p.variance_of_mean()[c]));
            let z = (mean(&plain) - mean(&early)) / (variance(&plain) + variance(&early)).sqrt();
            assert!(z.abs() < 5.0, "channel {c}: z {z}");
        }
        // Pixels learn their shares as ever, from other samples.
        let shares =
            |rendered: &Rendered| rendered.tiles.iter().flat_map(|tile| tile.shares.clone()).collect::<Vec<_>>();
        let learnt = |rendered| shares(rendered).iter().filter(|share| share.light_share != 0.5).count() as f64;
        let [plain, early] = both.each_ref().map(learnt);
        assert!(plain > 0.0 && (early / plain - 1.0).abs() < 0.2, "{early} pixels, {plain} without");
    }
}

#[test]
fn time_and_noise_goals_stop_a_render() {
    let stage = Stage::new(hall(), Backend::Embree);
    let run = |settings: RenderSettings| stage.render(&settings);
    let by_time = run(RenderSettings { spp: None, time: Some(0.2), ..settings() });
    assert_eq!(by_time.stop, StopReason::Time);
    assert!(by_time.film().pixels.iter().all(|p| p.samples > 0));
    let by_noise = |min_spp| run(RenderSettings { spp: None, noise: Some(0.05), min_spp, ..settings() });
    let picture = by_noise(None);
    assert_eq!(picture.stop, StopReason::Noise);
    // What one group shows is not quite what another one is.
    assert!(picture.stats.noise <= 0.05 && picture.worst_noise() <= 1.2 * 0.05, "{}", picture.worst_noise());
    // Tiles end by themselves, and none before its time.
    let (fewest, most) = picture.paths_range();
    assert!(32 <= fewest && 2 * fewest <= most, "{fewest} {most}");
    assert!(by_noise(Some(fewest + 1)).paths_range().0 > fewest);
    // --spp is the most.
    let limited = run(RenderSettings { noise: Some(0.05), spp: Some(40), ..settings() });
    assert_eq!((limited.stop, limited.paths_range().1), (StopReason::Samples, 40));
}
