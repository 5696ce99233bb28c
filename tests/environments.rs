//! Pictures of other programs as environments, and in `develop` and `compare`: Radiance's forms, colour spaces and windows.

use std::fs;
use std::path::Path;

use bismar::scene::import::environment;
use exr::meta::attribute::Chromaticities;
use exr::prelude::*;

use crate::helpers::glb;
use crate::helpers::program::{Folder, assert_same_bits, bits, expect, says};

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
    image.attributes.chromaticities = chromaticities.map(|[rx, ry, gx, gy, bx, by, wx, wy]| Chromaticities {
        red: Vec2(rx, ry),
        green: Vec2(gx, gy),
        blue: Vec2(bx, by),
        white: Vec2(wx, wy),
    });
    image.write().to_file(path).unwrap();
}

#[test]
fn colour_spaces_of_openexr_files_become_rec709() {
    let path = &Folder::new();
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
    let folder = Folder::new();
    let path = &folder.join("w.exr");
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
    let path = &Folder::new().with("s.glb", glb::triangle());
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

#[test]
fn pictures_in_other_primaries_say_so_and_are_read_back() {
    let path = &Folder::new().with_scene("c.glb", "cornell.glb");
    let line = "render c.glb --size 24x16 --spp 8 -q --aov all";
    expect(path, &format!("{line} -o a.exr --preview a.png"), 0);
    for (space, primaries) in [("acescg", AP1), ("rec2020", [0.708, 0.292, 0.170, 0.797, 0.131, 0.046, 0.3127, 0.3290])]
    {
        expect(path, &format!("{line} --colorspace {space} -o b.exr --preview b.png"), 0);
        let image = read_first_flat_layer_from_file(path.join("b.exr")).unwrap();
        let c = image.attributes.chromaticities.unwrap();
        assert_eq!([c.red, c.green, c.blue, c.white].map(|Vec2(x, y)| [x, y]).as_flattened(), primaries);
        // Other numbers in the file, and the same colours in all that is read; the variance too.
        let (plain, other) = (bits(&path.join("a.exr")), bits(&path.join("b.exr")));
        for ((name, ours), (_, theirs)) in plain.iter().zip(&other) {
            let is_color = ["R", "G", "B"].iter().any(|c| name.ends_with(c)) && !name.starts_with("Crypto");
            assert!(is_color && !name.starts_with("variance") || ours == theirs, "{name}");
        }
        let is_other = |wanted: &str| plain.iter().zip(&other).any(|((name, a), (_, b))| name == wanted && a != b);
        assert!(["R", "albedo.G", "direct.B", "light_surfaces.R", "guide_albedo.B"].into_iter().all(is_other));
        for layer in ["", "--layer albedo", "--layer light_surfaces", "--layer variance"] {
            expect(path, &format!("compare b.exr a.exr {layer} --max-relmse 1e-9 -q"), 0);
        }
        let [a, b] = ["a.exr", "b.exr"].map(|name| bismar::film::exr_file::read(&path.join(name)).unwrap().variance);
        assert_eq!(a, b);
        assert_eq!(fs::read(path.join("a.png")).unwrap().len(), fs::read(path.join("b.png")).unwrap().len());
        // Parts keep it; a picture in other primaries is no part of it, and is not taken for finished.
        expect(path, &format!("{line} --colorspace {space} --part 1/2 -o p1.exr"), 0);
        expect(path, &format!("{line} --colorspace {space} --part 2/2 -o p2.exr"), 0);
        expect(path, &format!("{line} --part 2/2 -o q2.exr"), 0);
        expect(path, "merge p1.exr p2.exr -o merged.exr -q", 0);
        assert_same_bits(&path.join("merged.exr"), &path.join("b.exr"));
        assert!(expect(path, "merge p1.exr q2.exr -o x.exr", 65).contains("--colorspace"));
        assert!(!expect(path, &format!("{line} --resume -o b.exr"), 65).contains("nothing to do"));
    }
}

#[test]
fn a_lut_is_a_view_and_what_is_none_is_refused() {
    let invert = "# input space: rec709\nLUT_3D_SIZE 2\nDOMAIN_MAX 0.5 0.5 0.5\n\
                  1 1 1\n0 1 1\n1 0 1\n0 0 1\n1 1 0\n0 1 0\n1 0 0\n0 0 0\n";
    let path = &Folder::new().with_scene("c.glb", "cornell.glb").with("looks/i.cube", invert);
    let line = "render c.glb --size 24x16 --spp 4 -q --exposure 1";
    expect(path, &format!("{line} --view looks/i.cube -o a.exr --preview a.png"), 0);
    let (linear, shown) =
        (bismar::film::exr_file::read(&path.join("a.exr")).unwrap(), image::open(path.join("a.png")).unwrap());
    for (color, pixel) in linear.rgb.iter().zip(shown.into_rgb8().pixels()) {
        let near = |(x, byte): (&f32, &u8)| (255.0 * (1.0 - (4.0 * x).min(1.0)) - f32::from(*byte)).abs() <= 1.0;
        assert!(color.iter().zip(&pixel.0).all(near), "{color:?} {pixel:?}");
    }
    let said = expect(path, "develop a.exr -o b.png --view looks/i.cube --exposure 1", 0);
    assert!(said.contains("view looks/i.cube, exposure 1 EV"), "{said}");
    let pixels = |name: &str| image::open(path.join(name)).unwrap().into_rgb8();
    assert!(pixels("a.png") == pixels("b.png"));
    // In a batch it lies beside the file; the preview is made again if the LUT is another.
    let jobs = "[[job]]\nscene = \"../c.glb\"\nsize = [24, 16]\nspp = 4\nexposure = 1\noutput = \"c.exr\"\n\
                preview = \"c.png\"\nview = \"i.cube\"\n";
    fs::write(path.join("looks/jobs.toml"), jobs).unwrap();
    expect(path, "batch looks/jobs.toml", 0);
    assert!(pixels("a.png") == pixels("looks/c.png"));
    fs::write(path.join("looks/i.cube"), invert.replace("DOMAIN_MAX 0.5 0.5 0.5", "DOMAIN_MAX 2 2 2")).unwrap();
    expect(path, "batch looks/jobs.toml", 0);
    assert!(pixels("a.png") != pixels("looks/c.png"));

    fs::write(path.join("quiet.cube"), invert.replace('#', "# no")).unwrap();
    assert!(expect(path, "develop a.exr -o b.png --view quiet.cube", 0).contains("linear Rec. 709 is assumed"));
    fs::write(path.join("nan.cube"), "LUT_1D_SIZE 2\n0 0 0\n1 nan 1\n").unwrap();
    fs::File::create(path.join("large.cube")).unwrap().set_len(1 << 30).unwrap();
    for (view, code, why) in [
        ("nan.cube", 65, "line 3: not finite"),
        ("large.cube", 65, "bytes are more"),
        ("none.cube", 66, "none.cube"),
        ("looks", 64, "possible values"),
        ("agx --view-space rec709", 64, "input of a LUT"),
        ("quiet.cube --view-space sepia", 64, "none of rec709"),
    ] {
        for line in ["develop a.exr -o x.png", "render c.glb -o x.exr --preview x.png"] {
            says(path, &format!("{line} --view {view}"), code, why);
        }
    }
    assert!(expect(path, "develop a.exr -o looks/i.cube --view looks/i.cube", 64).contains(".png"));
    assert!(!path.join("x.exr").exists() && !path.join("x.png").exists());
}
