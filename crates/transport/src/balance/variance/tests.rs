use super::*;
use crate::sampling::PixelSequence;

const WALL: PixelFeatures = PixelFeatures { object: 1, material: 1, normal: Vec3::Z, depth: 2.0, roughness: 0.5 };

const EQUAL: Cost = Cost { fixed: 1.0, light: 1.0, bsdf: 1.0 };

fn contribution(pixel: u32, technique: Technique, index: u32, r: f32, y: f32) -> Contribution {
    Contribution { pixel, technique, area: false, layer: 0, index, r, w: 0.0, radiance: Vec3::splat(y) }
}

/// The shares of the pixels of a tile with `width` pixels per row, after a pilot of 32 paths.
fn shares(
    candidates: &Candidates,
    width: usize,
    contributions: &[Contribution],
    features: &[PixelFeatures],
) -> Vec<Shares> {
    BlockVariances::new(candidates, contributions, features.len(), 32).choose(width, features, EQUAL, false)
}

/// The light share of one of them.
fn choose(pixel: usize, width: usize, contributions: &[Contribution], features: &[PixelFeatures]) -> f32 {
    shares(&Candidates::light_and_bsdf(Caution::DIRECT), width, contributions, features)[pixel].light_share
}

/// A row of pixels whose light samples agree and whose BSDF samples, except those of pixel `but`, find a rare large
/// contribution: light sampling is better.
fn noisy_bsdf(pixels: u32, but: u32) -> Vec<Contribution> {
    let mut contributions = Vec::new();
    for pixel in 0..pixels {
        for i in 0..32 {
            contributions.push(contribution(pixel, Technique::Light, i, 0.9, 1.0));
            if (i + pixel) % 11 == 0 && pixel != but {
                contributions.push(contribution(pixel, Technique::Bsdf, i, 0.9, 1.0));
            }
        }
    }
    contributions
}

#[test]
fn a_noisy_technique_gets_fewer_samples() {
    assert!(choose(2, 5, &noisy_bsdf(5, 9), &[WALL; 5]) > 0.5);
}

#[test]
fn a_pixels_own_pilot_has_no_part_in_its_share() {
    for pixel in 0..5 {
        let (all, but) = (noisy_bsdf(5, 9), noisy_bsdf(5, pixel));
        assert_eq!(choose(pixel as usize, 5, &all, &[WALL; 5]), choose(pixel as usize, 5, &but, &[WALL; 5]));
    }
}

/// In a row of pixels, light sampling is better for some and, though their neighbours say the same, worse for more.
#[test]
fn shares_that_do_not_pay_elsewhere_in_the_tile_are_not_used() {
    let pixels = 40;
    let candidates = Candidates::light_and_bsdf(Caution::INDIRECT);
    let shares = |contributions: &[Contribution]| shares(&candidates, pixels, contributions, &vec![WALL; pixels]);
    let all = noisy_bsdf(pixels as u32, 99);
    assert!(shares(&all).iter().all(|shares| shares.light_share > 0.5));
    // In one pixel of eight BSDF samples find what light samples do not.
    let spoiled = |own: u32| {
        let found = |pixel, i| contribution(pixel, Technique::Bsdf, i, -0.9, if i == 3 { 200.0 } else { 1.0 });
        let spoiled = (4..pixels as u32).step_by(8).flat_map(|pixel| (0..32).map(move |i| found(pixel, i)));
        all.iter().copied().chain(spoiled).filter(|c| c.pixel != own).collect::<Vec<_>>()
    };
    let found = shares(&spoiled(99));
    for (pixel, shares_now) in found.iter().enumerate() {
        assert_eq!(shares(&spoiled(pixel as u32))[pixel], *shares_now, "{pixel}");
    }
    assert!(found.iter().all(|shares| shares.light_share == 0.5));
}

#[test]
fn unlike_neighbours_teach_nothing() {
    let others = [
        PixelFeatures { object: 2, ..WALL },
        PixelFeatures { material: 2, ..WALL },
        PixelFeatures { normal: Vec3::X, ..WALL },
        PixelFeatures { depth: 3.0, ..WALL },
        PixelFeatures { roughness: 0.1, ..WALL },
        PixelFeatures::default(),
    ];
    for other in others {
        let mut features = [other; 5];
        features[2] = WALL;
        assert_eq!(choose(2, 5, &noisy_bsdf(5, 9), &features), 0.5, "{other:?}");
    }
    // What shows nothing is like nothing.
    assert_eq!(choose(2, 5, &noisy_bsdf(5, 9), &[PixelFeatures::default(); 5]), 0.5);
}

#[test]
fn black_pixels_and_bad_numbers_stay_at_half() {
    assert_eq!(choose(4, 3, &[], &[WALL; 9]), 0.5);
    let chosen = |y| {
        let contributions: Vec<_> = (0..9).map(|p| contribution(p, Technique::Light, 3, 0.5, y)).collect();
        choose(4, 3, &contributions, &[WALL; 9])
    };
    for y in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        assert_eq!(chosen(y), 0.5, "{y}");
    }
    // Channels are weighed by their mean: the unit of radiance does not matter.
    assert!([1e-30, 1e38].iter().all(|&y| chosen(y) == chosen(1.0)) && chosen(1.0) != 0.5);
}

#[test]
fn one_firefly_among_the_neighbours_is_not_believed() {
    let mut contributions = Vec::new();
    for pixel in 0..25 {
        for i in 0..32 {
            contributions.push(contribution(pixel, Technique::Light, i, 0.1, 1.0 + 0.1 * (i % 3) as f32));
            contributions.push(contribution(pixel, Technique::Bsdf, i, -0.1, 1.0 + 0.1 * (i % 5) as f32));
        }
    }
    contributions.push(contribution(3, Technique::Bsdf, 5, -1.0, 1e4));
    assert_eq!(choose(12, 5, &contributions, &[WALL; 25]), 0.5);
}

#[test]
fn weighing_by_the_share_is_the_balance_heuristic() {
    // p_l = 3, p_b = 1: r = ½.
    let f = contribution(0, Technique::Light, 0, 0.5, 1.0 / 4.0);
    assert_eq!(f.reweighted([1.0; 3]).x, 0.25);
    assert!((f.reweighted([1.5, 1.0, 0.5]).x - 1.0 / (2.0 * (0.75 * 3.0 + 0.25))).abs() < 1e-7);
}

/// Mean and its standard error of `replicas` estimates of ∫x⁴ dx = 1/5 by the middle of nine similar pixels. Its share
/// follows from its neighbours or, with `own`, from its own pilot. p_l = 2x, p_b = 2(1 − x).
fn estimate(replicas: u32, own: bool) -> (f64, f64) {
    const PILOT: u32 = 4;
    const PATHS: u32 = 16;
    let (mut sum, mut squares) = (0.0, 0.0);
    for replica in 0..replicas {
        let of = |pixel: u32, technique: u32, index: u32| {
            // Independent samples: each from a sequence of its own.
            let [u, ..] = PixelSequence::new(pixel, replica, 2 * index + technique).sample(0, 0);
            let (kind, x) = match technique {
                0 => (Technique::Light, u.sqrt()),
                _ => (Technique::Bsdf, 1.0 - (1.0 - u).sqrt()),
            };
            contribution(pixel, kind, index, 2.0 * x - 1.0, x.powi(4) / 2.0)
        };
        let contributions: Vec<Contribution> = (0..9)
            .flat_map(|p| (0..2).flat_map(move |t| (0..PILOT).map(move |i| (p, t, i))))
            .map(|(p, t, i)| of(p, t, i))
            .collect();
        let from = |p: u32| if own { 4 } else { p };
        let learned = (0..9).flat_map(|p| {
            let of_pixel = contributions.iter().filter(move |f| f.pixel == from(p));
            of_pixel.map(move |f| Contribution { pixel: p, ..*f })
        });
        let learned: Vec<_> = learned.collect();
        let candidates = Candidates::light_and_bsdf(Caution::DIRECT);
        let chosen = BlockVariances::new(&candidates, &learned, 9, PILOT).choose(3, &[WALL; 9], EQUAL, false)[4];
        let total = Counts::from_shares(chosen, PATHS);
        let ratios = total.relative_to(Counts::half(PILOT));
        let weighed = |technique, i| f64::from(of(4, technique, i).reweighted(ratios).x);
        let light: f64 = (0..total.light).map(|i| weighed(0, i)).sum();
        let bsdf: f64 = (0..total.bsdf).map(|i| weighed(1, i)).sum();
        let l = (light + bsdf) / f64::from(PATHS);
        sum += l;
        squares += l * l;
    }
    let n = f64::from(replicas);
    let mean = sum / n;
    (mean, ((squares / n - mean * mean) / n).sqrt())
}

#[test]
fn the_total_weights_are_unbiased_because_the_share_is_the_neighbours() {
    // False alarm: |z| > 4 in 6·10⁻⁵ of seeds; the seed is fixed.
    let (mean, error) = estimate(20_000, false);
    let z = (mean - 0.2) / error;
    assert!(z.abs() < 4.0, "z = {z}");
}

#[test]
fn a_share_from_the_pixels_own_pilot_would_be_biased() {
    // The positive control: what the test above can see.
    let (mean, error) = estimate(20_000, true);
    let z = (mean - 0.2) / error;
    assert!(z.abs() > 5.0, "z = {z}");
}

#[test]
fn the_kind_of_light_that_varies_gets_the_samples() {
    let share = |noisy_area: bool| {
        let mut contributions = Vec::new();
        for pixel in 0..9 {
            for i in 0..16 {
                for area in [false, true] {
                    let y = if area == noisy_area { 1.0 + (7 * (i + pixel) % 11) as f32 } else { 5.0 };
                    contributions.push(Contribution { area, ..contribution(pixel, Technique::Light, i, 0.9, y) });
                }
            }
        }
        shares(&Candidates::environment_area_and_bsdf(0.5, Caution::DIRECT), 3, &contributions, &[WALL; 9])[4]
    };
    assert!(share(true).environment_share < Some(0.5) && share(true).light_share > 0.5, "{:?}", share(true));
    assert!(share(false).environment_share > Some(0.5) && share(false).light_share > 0.5, "{:?}", share(false));
}

#[test]
fn without_evidence_the_prior_share_of_the_environment_stands() {
    for (chance, eighths) in [(0.1, 1.0), (0.5, 4.0), (0.7, 6.0), (0.9, 7.0)] {
        let share = shares(&Candidates::environment_area_and_bsdf(chance, Caution::DIRECT), 3, &[], &[WALL; 9])[4];
        assert_eq!(share, Shares { light_share: 0.5, environment_share: Some(eighths / 8.0) });
    }
}

#[test]
fn every_candidate_has_at_least_the_pilots_samples() {
    for candidates in
        [Candidates::light_and_bsdf(Caution::DIRECT), Candidates::environment_area_and_bsdf(0.3, Caution::DIRECT)]
    {
        for (pilot, paths) in [(8, 32), (16, 64), (32, 128)] {
            let pilot = candidates.pilot(pilot);
            for &share in &candidates.shares {
                let total = Counts::from_shares(share, paths);
                let rest = total.after(pilot);
                assert_eq!(rest.light + pilot.light, total.light, "{share:?} {paths}");
                assert_eq!(rest.bsdf + pilot.bsdf, total.bsdf, "{share:?} {paths}");
                assert_eq!(
                    rest.environment.zip(pilot.environment).map(|(a, b)| a + b),
                    total.environment,
                    "{share:?} {paths}"
                );
                let area = |c: Counts| c.environment.map_or(0, |environment| c.light - environment);
                assert_eq!(area(rest) + area(pilot), area(total), "{share:?} {paths}");
            }
        }
    }
}

#[test]
fn ratios_are_the_counts_over_the_pilots() {
    let candidates = Candidates::environment_area_and_bsdf(0.3, Caution::DIRECT);
    let pilot = candidates.pilot(32);
    for (i, &share) in candidates.shares.iter().enumerate() {
        let ratios = Counts::from_shares(share, 128).relative_to(pilot);
        for (t, ratio) in ratios.into_iter().enumerate() {
            let stated = candidates.ratios[i / LANES][t].as_array()[i % LANES];
            assert!((stated - ratio).abs() <= 4.0 * f32::EPSILON * ratio, "{share:?} {t}: {stated} {ratio}");
        }
    }
}

#[test]
fn of_shares_that_are_surely_better_the_cheapest_work_wins() {
    // Light samples vary four times as much as BSDF samples; both find all of the light, disjoint.
    let mut contributions = Vec::new();
    for pixel in 0..25 {
        for i in 0..32 {
            let number = |k: u32| (crate::sampling::hash(1000 * pixel + 2 * i + k) >> 8) as f32 / (1 << 24) as f32;
            contributions.push(contribution(pixel, Technique::Light, i, 1.0, 1.0 + 4.0 * number(0)));
            contributions.push(contribution(pixel, Technique::Bsdf, i, -1.0, 1.0 + number(1)));
        }
    }
    let candidates = Candidates::light_and_bsdf(Caution::DIRECT);
    let variances = BlockVariances::new(&candidates, &contributions, 25, 32);
    let share = |cost| variances.choose(5, &[WALL; 25], cost, false)[12].light_share;
    // V ∝ 16/α + 1/(1 − α) is least at ¾ of the candidates; V α falls with α, but nothing below ½ is better than ½.
    let dear_light = share(Cost { fixed: 0.0, light: 1.0, bsdf: 0.0 });
    assert!(dear_light > 0.5 && dear_light < share(EQUAL), "{dear_light} {}", share(EQUAL));
}
