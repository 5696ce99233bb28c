//! Pictures of other programs as environments, and in `develop` and `compare`: Radiance's forms, colour spaces and windows.

use std::fs;
use std::path::Path;

use bismar::scene::import::environment;
use exr::meta::attribute::Chromaticities;
use exr::prelude::*;

use crate::helpers::glb;
use crate::helpers::program::{assert_same_bits, expect};

const AP1: [f32; 8] = [0.713, 0.293, 0.165, 0.830, 0.128, 0.044, 0.32168, 0.33767];
const XYZ: [f32; 8] = [1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.333_333, 0.333_333];
/// One of ACEScg, and what the published matrix makes of it in Rec. 709.
const COLOR: [f32; 3] = [0.3, 0.5, 0.2];
const IN_REC709: [f32; 3] = [0.18397, 0.52921, 0.15890];
/// (0.4, 0.5, 0.3) of [`XYZ`].
const XYZ_IN_REC709: [f32; 3] = [0.28140, 0.59160, 0.26344];

/// Writes one colour over a window of this size at `position` in a display window of this size at 0.
fn write(
    path: &Path,
    color: [f32; 3],
    chromaticities: Option<[f32; 8]>,
    position: (i32, i32),
    size: (usize, usize),
    display: (usize, usize),
) {
    let channels = SpecificChannels::rgb(|_| (color[0], color[1], color[2]));
    let attributes = LayerAttributes { layer_position: position.into(), ..Default::default() };
    let mut image = Image::from_layer(Layer::new(size, attributes, Encoding::UNCOMPRESSED, channels));
    image.attributes.display_window = IntegerBounds::from_dimensions(display);
    let point = |x, y| Vec2(x, y);
    image.attributes.chromaticities = chromaticities.map(|[rx, ry, gx, gy, bx, by, wx, wy]| Chromaticities {
        red: point(rx, ry),
        green: point(gx, gy),
        blue: point(bx, by),
        white: point(wx, wy),
    });
    image.write().to_file(path).unwrap();
}

#[test]
fn colour_spaces_of_openexr_files_become_rec709() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    let whole = |name: &str, color, chromaticities| {
        write(&path.join(name), color, chromaticities, (0, 0), (16, 8), (16, 8));
        environment(&path.join(name), 0.0, 1.0).unwrap().pixels
    };
    let infinite = [f32::INFINITY; 3];
    for (name, color, chromaticities, right) in [
        ("plain.exr", IN_REC709, None, IN_REC709),
        ("ap1.exr", COLOR, Some(AP1), IN_REC709),
        // By Lindbloom's matrices: E to D65 (Bradford), XYZ to sRGB.
        ("xyz.exr", [0.4, 0.5, 0.3], Some(XYZ), XYZ_IN_REC709),
        // No colour space.
        ("line.exr", COLOR, Some([0.3; 8]), COLOR),
        // Outside of Rec. 709 nothing is negative, and an infinite sun is not black.
        ("green.exr", [0.0, 1.0, 0.0], Some(AP1), [0.0, 1.14080, 0.0]),
        ("sun.exr", infinite, Some(AP1), [65504.0; 3]),
    ] {
        let pixels = whole(name, color, chromaticities);
        // The digits of the matrices.
        let near = |p: &[f32; 3]| p.iter().zip(right).all(|(a, b)| (a - b).abs() < 5e-4);
        assert!(pixels.len() == 128 && pixels.iter().all(near), "{name}: {:?}", pixels[0]);
    }
    expect(path, "compare ap1.exr plain.exr --max-relmse 1e-6", 0);
    expect(path, "compare line.exr plain.exr --max-relmse 1e-6", 1);
    for name in ["ap1", "plain"] {
        expect(path, &format!("develop {name}.exr -o {name}.png --view srgb --exposure 0 -q"), 0);
    }
    // Dithering takes a difference of 2e-5 over few thresholds.
    expect(path, "compare ap1.png plain.png --max-relmse 1e-4", 0);
}

#[test]
fn the_environment_is_the_display_window() {
    let folder = tempfile::tempdir().unwrap();
    let path = &folder.path().join("w.exr");
    for (position, size, lit) in
        [((9, 2), (4, 3), 12), ((-4, -2), (24, 12), 128), ((40, 40), (4, 2), 0), ((14, 7), (9, 9), 2)]
    {
        write(path, [1.0; 3], None, position, size, (16, 8));
        let seen = environment(path, 0.0, 1.0).unwrap();
        assert_eq!((seen.width, seen.height), (16, 8));
        let pixel = |x: i32, y: i32| seen.pixels[(y * 16 + x) as usize][0];
        assert_eq!((0..128).filter(|i| pixel(i % 16, i / 16) > 0.0).count(), lit, "{position:?}");
        assert!(lit == 0 || pixel(position.0.max(0), position.1.max(0)) == 1.0);
    }
    // Pixels that nobody has are refused before they are allocated.
    write(path, [1.0; 3], None, (0, 0), (4, 2), (1 << 29, 1 << 29));
    let error = environment(path, 0.0, 1.0).unwrap_err();
    assert!(error.exit_code() == 65 && error.to_string().contains("536870912x536870912"), "{error}");
}

#[test]
fn radiance_pictures_of_other_programs_light_as_radiances_own() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    fs::write(path.join("s.glb"), glb::triangle()).unwrap();
    // 16 x 8 pixels, one colour per row, without run lengths.
    let rows: Vec<u8> = (1..=8).flat_map(|row| [row * 20, 90, 200 - row * 20, 129].repeat(16)).collect();
    let old: Vec<u8> = rows.chunks(64).flat_map(|row| [&row[..4], &[1, 1, 1, 15]].concat()).collect();
    let new = rows.chunks(64).flat_map(|row| [2, 2, 0, 16].into_iter().chain((0..4).flat_map(|c| [144, row[c]])));
    let below: Vec<u8> = rows.chunks(64).rev().flatten().copied().collect();
    let write = |name: &str, head: &str, data: &[u8]| {
        fs::write(path.join(name), [head.as_bytes(), data].concat()).unwrap();
    };
    write("own.hdr", "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 8 +X 16\n", &rows);
    write("old.hdr", "#?RGBE\n\n-Y 8 +X 16\n", &old);
    write("new.hdr", "#?AUTOPANO\r\nEXPOSURE=3\r\n\r\n-Y 8 +X 16\r\n", &new.collect::<Vec<u8>>());
    write("below.hdr", "#?pfstools\n# comment\nFORMAT=32-bit_rle_rgbe\n\n+Y 8 -X 16\n", &below);
    let render = |name: &str| {
        expect(path, &format!("render s.glb --env {name}.hdr --size 16x8 --spp 2 -o {name}.exr -q"), 0);
        path.join(format!("{name}.exr"))
    };
    let own = render("own");
    for name in ["old", "new", "below"] {
        assert_same_bits(&render(name), &own);
        expect(path, &format!("compare {name}.hdr own.hdr --max-relmse 0"), 0);
        expect(path, &format!("develop {name}.hdr -o {name}.png -q"), 0);
    }
}
