//! FLIP against the numbers of its authors' program, recorded with `tests/pictures/flip.py` (flip-evaluator 1.7).

use bismar::film::flip::flip;

const SIZE: (usize, usize) = (48, 37);

/// Waves over a ramp; with `hdr` over eleven stops.
fn picture(hdr: bool) -> Vec<[f32; 3]> {
    let pixel = |x: f64, y: f64| {
        std::array::from_fn(|c| {
            let wave = 0.5 + 0.5 * (0.37 * x * (c as f64 + 1.0) + 0.23 * y + c as f64).sin();
            let across = x / SIZE.0 as f64;
            (wave * if hdr { (8.0 * across - 3.0).exp2() } else { across }) as f32
        })
    };
    (0..SIZE.1).flat_map(|y| (0..SIZE.0).map(move |x| pixel(x as f64, y as f64))).collect()
}

fn changed(mut pixels: Vec<[f32; 3]>) -> Vec<[f32; 3]> {
    for (i, pixel) in pixels.iter_mut().enumerate() {
        let (x, y) = (i % SIZE.0, i / SIZE.0);
        if (10..14).contains(&y) && (20..30).contains(&x) {
            pixel[0] *= 0.5;
        }
        if (x, y) == (40, 25) {
            *pixel = pixel.map(|c| c * 0.25);
        }
        if x == 5 {
            pixel[2] *= 0.75;
        }
    }
    pixels
}

#[test]
fn numbers_are_those_of_its_authors() {
    for (hdr, mean, most, some) in [
        (false, 0.014_584_658, 0.386_005_28, [0.209_206_97, 0.242_980_52, 0.049_289_8, 0.0, 0.010_826_256]),
        (true, 0.023_512_99, 0.395_975_35, [0.314_250_56, 0.205_052_58, 0.096_023_41, 0.0, 0.027_700_774]),
    ] {
        let reference = picture(hdr);
        let found = flip(&reference, &changed(reference.clone()), SIZE.0, !hdr);
        let close = |a: f32, b: f32, what: &str| assert!((a - b).abs() < 2e-4, "hdr {hdr}, {what}: {a} for {b}");
        close(found.iter().sum::<f32>() / found.len() as f32, mean, "mean");
        close(found.iter().copied().fold(0.0, f32::max), most, "most");
        for ((x, y), expected) in [(25, 12), (40, 25), (5, 0), (47, 36), (6, 18)].into_iter().zip(some) {
            close(found[y * SIZE.0 + x], expected, &format!("({x}, {y})"));
        }
    }
}
