//! Layers of groups of lights, and their mixes.

use std::path::Path;
use std::sync::Arc;

use bismar::film::{Picture, Pixels, exr_file};
use bismar::integrator::Reuse;
use bismar::rays::Backend;
use bismar::render::{Balance, Choice, LightGroups, RenderSettings, Technique};
use bismar::scene::{Environment, LightNode, Material, PunctualKind, PunctualLight, Scene};
use glam::Vec3;

use crate::helpers::gltf_parts::Parts;
use crate::helpers::program::{Folder, assert_same_bits, bismar, expect, says, stderr};
use crate::helpers::stage::{Stage, area_light, lambert, look, metal, punctual, rectangle};
use crate::helpers::statistics::{Mean, z_limit};
use crate::merge::in_parts;
use crate::pictures::{denoiser, false_denoiser};

/// A floor, a wall of metal and a shelf under two lamps of one mesh each, an unlit sign, a point, a spherical light and a sky;
/// only the lights that `is_on` chooses by the numbers of their group and kind.
fn room(is_on: impl Fn(usize, usize) -> bool) -> Scene {
    let environment = is_on(2, 0).then(|| Environment::constant([0.2, 0.3, 0.4]));
    let mut scene = Scene { environment, ..Default::default() };
    rectangle(&mut scene, 0.0, [-2.0, 2.0], [-2.0, 2.0], true, lambert(0.7));
    rectangle(&mut scene, 0.5, [-1.0, 0.0], [-1.0, 0.0], true, metal(0.3));
    rectangle(&mut scene, 1.0, [0.2, 1.0], [-1.0, 0.5], true, lambert(0.8));
    let sign = Material { unlit: true, base_color: glam::Vec4::ONE, ..Material::default() };
    for (own, name, x, material) in
        [(1, "Lamp left", -0.8, area_light(6.0)), (3, "Lantern", 0.8, area_light(9.0)), (1, "Lamp sign", 1.5, sign)]
    {
        let dark =
            if material.unlit { Material { base_color: glam::Vec4::W, ..material.clone() } } else { lambert(0.0) };
        let material = if is_on(own, 1) { material } else { dark };
        let up = material.unlit;
        rectangle(&mut scene, if up { 0.1 } else { 2.0 }, [x - 0.2, x + 0.2], [-0.6, -0.2], up, material);
        scene.instances.last_mut().unwrap().name = name.into();
    }
    for (own, name, x, size) in [(0, "Point", -0.5, 0.0), (0, "Ball", 0.3, 0.2), (3, "Other", 0.6, 0.1)] {
        if is_on(own, 2) {
            scene.light_nodes.push(LightNode { name: format!("Key {name}"), group: (own == 3).then(|| "none".into()) });
            let light = punctual(PunctualKind::Point, 0.8, Vec3::new(x, 1.5, 0.5), Vec3::NEG_Y);
            scene.lights.push(PunctualLight { name: name.into(), size, ..light });
        }
    }
    if is_on(3, 2) {
        scene.light_nodes.last_mut().unwrap().name = "Third".into();
    }
    look(&mut scene, Vec3::new(0.0, 1.2, 4.0), Vec3::new(0.0, 0.8, 0.0), 0.8);
    scene
}

fn settings() -> RenderSettings {
    RenderSettings { width: 24, height: 16, spp: Some(32), max_depth: 5, ..RenderSettings::even() }
}

/// The means of layers of many renders against those of scenes with the lights of one layer alone.
#[test]
fn layers_are_pictures_by_their_lights_and_add_up_to_the_beauty() {
    const REPLICAS: u32 = 24;
    let only = |is_on: &dyn Fn(usize, usize) -> bool| {
        let stage = Stage::new(Arc::new(room(is_on)), Backend::Embree);
        stage.mean_green(&RenderSettings { seed: 900, ..settings() }, 2 * REPLICAS)
    };
    let groups = [0, 1, 2, 3].map(|wanted| only(&|group, _| group == wanted));
    let kinds = [0, 1, 2].map(|wanted| only(&|_, kind| kind == wanted));
    let sizes: Option<Reuse> = "16:4".parse().ok();
    let shared = RenderSettings { reuse_sizes: sizes, ..settings().with(Technique::PathReuse, Choice::On) };
    let adaptive = settings().with(Technique::Adaptive, Choice::On);
    let by = |balance| RenderSettings { balance, ..settings() };
    let all = [
        (Backend::Embree, settings()),
        (Backend::Obvhs, by(Balance::Half)),
        (Backend::Embree, by(Balance::SecondOrder)),
        (Backend::Embree, shared),
        (Backend::Obvhs, adaptive),
    ];
    let limit = z_limit((groups.len() + kinds.len()) * all.len());
    let by_name: LightGroups = "key=Key*,practicals=Lamp*,sky=env".parse().unwrap();
    assert_eq!(by_name.names(), ["key", "practicals", "sky", "rest"]);
    for (number, (backend, of)) in (1..).zip(all) {
        let stage = Stage::new(Arc::new(room(|_, _| true)), backend);
        for (by, alone) in [(&by_name, &groups[..]), (&LightGroups::kinds(), &kinds)] {
            let mut means = vec![Mean::default(); alone.len()];
            for seed in 0..REPLICAS {
                let of = RenderSettings { seed: 100 * number + seed, light_groups: Some(by.clone()), ..of.clone() };
                let rendered = stage.render(&of);
                let pixels = rendered.pixels();
                let mut sums = vec![0.0; alone.len()];
                for (x, y) in (0..16).flat_map(|y| (0..24).map(move |x| (x, y))) {
                    let stats = pixels.at(x, y).0;
                    let lights = (0..alone.len()).map(|group| f64::from(pixels.light(x, y, group)[1]));
                    let (sum, beauty) = (lights.clone().sum::<f64>(), stats.sum[1]);
                    assert!((sum - beauty).abs() <= 1e-4 * beauty.max(1.0), "{sum} for {beauty}");
                    let samples = f64::from(stats.samples) * 384.0;
                    sums.iter_mut().zip(lights).for_each(|(sum, light)| *sum += light / samples);
                }
                means.iter_mut().zip(sums).for_each(|(mean, sum)| mean.add(sum));
                let plain = RenderSettings { light_groups: None, ..of.clone() };
                // Where paths are shared, light is summed by group: other roundings.
                if seed == 0 && of.reuse_sizes.is_none() {
                    assert_eq!(stage.green(&plain), stage.green(&of), "layers change no bit of the beauty");
                }
            }
            for (name, (ours, alone)) in by.names().iter().zip(means.iter().zip(alone)) {
                let z = ours.z_to(alone);
                let [ours, alone] = [ours.mean, alone.mean];
                assert!(alone > 0.01 && z.abs() < limit, "{number}, {name}: {ours} {alone}, z {z}");
            }
        }
    }
}

#[test]
fn wrong_groups_are_refused_by_name() {
    let stage = Stage::new(Arc::new(room(|_, _| true)), Backend::Obvhs);
    let table = |groups: &str| {
        let parsed = groups.parse::<LightGroups>()?;
        parsed.table(&stage.scene).map(drop).map_err(|e| e.to_string())
    };
    for (groups, words) in [
        ("key=Key*,lamps=L*,all=Lamp left", "'Lamp left' is in two groups, lamps and all"),
        ("key=Key*,sky=env,both=*", "'env' is in two groups, sky and both"),
        (
            "key=Sun*",
            "no light is in the group key; the names are 'Ball', 'Key Ball', 'Key Point', 'Lamp left', 'Lamp sign', 'Lantern', 'Other', \
             'Point', 'Third', 'default' and 2 more",
        ),
        ("rest=*", "'rest' is the group of all lights"),
        ("k y=*", "'k y=*' is not NAME=PATTERN"),
        ("key=", "'key=' is not NAME=PATTERN"),
        ("key=[", "'key=['"),
        ("", "'' is not NAME=PATTERN"),
        ("by kind", "'by kind' is not NAME=PATTERN"),
        ("a=*,b,c,d,e,f,g,h,i", "9 groups: at most 8"),
        (format!("a={}b", "*a".repeat(50_000)).as_str(), "100003 bytes: at most 4096"),
        (format!("a={}b", "*a".repeat(128)).as_str(), "a pattern of 'a' has 257 bytes: at most 256"),
    ] {
        let said = table(groups).unwrap_err();
        assert!(said.contains(words), "{groups}: {said}");
    }
    table("key=Key P*,key=Key B*,none").unwrap();
    table("all=*").unwrap();
    // The longest pattern and a long name, in linear time.
    let mut scene = room(|_, _| true);
    scene.light_nodes[0].name = "a".repeat(1 << 18);
    let stage = Stage::new(Arc::new(scene), Backend::Obvhs);
    let began = std::time::Instant::now();
    for pattern in [format!("{}b", "*a".repeat(127)), format!("*{}b", "a".repeat(254))] {
        let groups: LightGroups = format!("a={pattern}").parse().unwrap();
        assert!(groups.table(&stage.scene).unwrap_err().to_string().contains("no light is in the group a"));
    }
    assert!(began.elapsed().as_secs_f64() < 5.0, "{:?}", began.elapsed());
}

/// A triangle below two lights, one of which is in a group by the node above it, and a second triangle that glows.
fn gltf() -> String {
    let nodes = r#"[{"children":[1,2,3,4,5]},{"mesh":0,"rotation":[-0.7071068,0,0,0.7071068]},
        {"name":"Sun.L","extras":{"radius":0.1},"translation":[0.3,1,-0.3],"extensions":{"KHR_lights_punctual":{"light":0}}},
        {"extras":{"light_group":"fill"},"children":[6]},{"mesh":0,"translation":[0,0,-1],"name":"glow"},
        {"camera":0,"translation":[0.3,0.5,1.5],"rotation":[-0.1305262,0,0,0.9914449]},
        {"translation":[1,1,0],"extensions":{"KHR_lights_punctual":{"light":0}}}]"#;
    let more = r#","materials":[{"emissiveFactor":[0.2,0.1,0],"extras":{"light_group":"glow"}}],
        "cameras":[{"type":"perspective","perspective":{"yfov":1,"znear":0.1}}],
        "extensions":{"KHR_lights_punctual":{"lights":[{"type":"point"}]}}"#;
    let primitive = r#"{"attributes":{"POSITION":0},"material":0}"#.into();
    Parts { nodes: nodes.into(), more: more.into(), primitive, ..Default::default() }.json()
}

fn layer(path: &Path, name: &str) -> Vec<[f32; 3]> {
    Picture::open(path, Some(name)).unwrap().rgb
}

#[test]
fn groups_are_merged_and_resumed_and_mixed_after_the_render() {
    let folder = Folder::new().with("a.gltf", gltf());
    let at = |name: &str| folder.join(name);
    let line = "render a.gltf --size 24x16 --spp 256 -q --light-groups key=Sun*,fill,glow";
    expect(&folder, &format!("{line} -o whole.exr"), 0);
    assert_same_bits(&at("whole.exr"), &in_parts(&folder, line, 2));
    expect(&folder, &format!("{line} --checkpoint 9 -o out.exr").replace("256", "128"), 0);
    expect(&folder, &format!("{line} -o out.exr --resume"), 0);
    assert_same_bits(&at("whole.exr"), &at("out.exr"));
    expect(&folder, "render a.gltf --size 24x16 --spp 256 -q -o plain.exr", 0);
    expect(&folder, "check whole.exr", 0);

    let beauty = Picture::open(&at("whole.exr"), None).unwrap().rgb;
    let [key, fill, glow, rest] =
        ["key", "fill", "glow", "rest"].map(|name| layer(&at("whole.exr"), &format!("light_{name}")));
    assert!([&key, &fill, &glow].iter().all(|layer| layer.iter().any(|c| c[0] > 0.01)));
    let mut mixed = Vec::new();
    for (i, beauty) in beauty.iter().enumerate() {
        let sum: Vec3 = [&key, &fill, &glow, &rest].map(|layer| Vec3::from(layer[i])).into_iter().sum();
        assert!((sum - Vec3::from(*beauty)).abs().max_element() < 1e-5);
        mixed.push((1.5 * Vec3::from(key[i]) + Vec3::new(1.0, 0.5, 0.0) * Vec3::from(glow[i])).to_array());
    }
    exr_file::write_rgb(&at("hand.exr"), [0, 0, 24, 16], [0, 0, 24, 16], &mixed).unwrap();
    let develop = "--view srgb --exposure 1 -q";
    let mix = "--mix key=1.5,fill=0,glow=1:0.5:0,rest=0";
    expect(&folder, &format!("develop whole.exr {mix} {develop} -o a.png"), 0);
    expect(&folder, &format!("develop hand.exr {develop} -o b.png"), 0);
    let [a, b] = ["a.png", "b.png"].map(|name| image::open(at(name)).unwrap().into_rgb8());
    assert!(a.pixels().any(|pixel| pixel.0[0] > 20) && a == b);
    expect(&folder, "render a.gltf --size 24x16 --spp 256 -q --light-groups all=* --part 2/2 -o other.exr", 0);
    for (line, code, words) in [
        (
            "develop whole.exr --mix sun=1",
            64,
            "no layer light_sun; of lights (`render --light-groups`) it has fill, glow, key, rest",
        ),
        ("develop plain.exr --mix key=1", 64, "it has none"),
        ("develop whole.exr --mix key=1 --layer albedo", 64, "the only --layer that it can be of is denoised"),
        ("develop whole.exr --mix key=1 --layer denoised", 64, "no layer denoised_key"),
        ("develop whole.exr --mix key=-1", 64, "'key=-1' is not NAME=FACTOR"),
        ("develop whole.exr --mix key=1:2", 64, "'key=1:2' is not NAME=FACTOR"),
        ("render a.gltf --light-groups key=Sun*,all=*", 64, "'Sun.L' is in two groups, key and all"),
        ("merge part1.exr other.exr -o no.exr", 65, "light-groups (all=* there, key=Sun*,fill,glow here)"),
    ] {
        says(&folder, line, code, words);
    }
}

#[test]
fn denoised_layers_add_up_to_the_denoised_beauty() {
    let path = &Folder::new().with("a.gltf", gltf());
    let groups = "--light-groups key=Sun*,fill,glow";
    let render = |library: &Path, name: &str| {
        let line = format!("render a.gltf --size 48x32 --spp 16 -q {groups} --denoise oidn -o {name}");
        let output = bismar(path).args(line.split(' ')).env("BISMAR_OIDN", library).output().unwrap();
        assert!(output.status.success(), "{}", stderr(&output));
        let names = ["", "_key", "_fill", "_glow", "_rest"];
        let [whole, lights @ ..] = names.map(|light| layer(&path.join(name), &format!("denoised{light}")));
        for (i, whole) in whole.iter().enumerate() {
            let sum: Vec3 = lights.iter().map(|light| Vec3::from(light[i])).sum();
            let error = (sum - Vec3::from(*whole)).abs();
            assert!(error.cmple(Vec3::from(*whole) * 1e-6).all(), "{sum} for {whole:?}");
        }
        (whole, lights)
    };
    // A denoiser that is not linear. What its layers lack is shared in proportion.
    let square = "for (size_t i = 0; i < 3 * w * h; i++) out[i] = in[i] * in[i];";
    let (whole, lights) = render(&false_denoiser(path, "square.so", square), "square.exr");
    let noisy = ["key", "fill", "glow", "rest"].map(|name| layer(&path.join("square.exr"), &format!("light_{name}")));
    for (i, whole) in whole.iter().enumerate() {
        let squares = [0, 1, 2, 3].map(|light| Vec3::from(noisy[light][i]).powf(2.0));
        let sum: Vec3 = squares.iter().sum();
        for (light, own) in lights.iter().zip(squares).filter(|_| sum.min_element() > 0.0) {
            let expected = own / sum * Vec3::from(*whole);
            assert!((Vec3::from(light[i]) - expected).abs().max_element() <= 1e-5 * whole[0].max(1e-3));
        }
    }
    let developed = |flags: &str| {
        expect(path, &format!("develop square.exr --layer denoised {flags} --view srgb --exposure 1 -q -o a.png"), 0);
        image::open(path.join("a.png")).unwrap().into_rgb8()
    };
    let [plain, mixed, none] = ["", "--mix key=1", "--mix key=0,fill=0,glow=0"].map(developed);
    let largest = plain.iter().zip(mixed.iter()).map(|(a, b)| a.abs_diff(*b)).max();
    assert!(largest <= Some(1) && plain.iter().max() > Some(&20) && none.iter().max() == Some(&0));

    let Some(library) = denoiser() else { return };
    let (_, clean) = render(&library, "clean.exr");
    expect(path, &format!("render a.gltf --size 48x32 --spp 4096 --seed 9 -q {groups} -o true.exr"), 0);
    let [before, truth] = ["clean.exr", "true.exr"].map(|name| layer(&path.join(name), "light_key"));
    let error = |layer: &[[f32; 3]]| layer.iter().zip(&truth).map(|(a, b)| (a[0] - b[0]).powi(2)).sum::<f32>();
    assert!(error(&clean[0]) < 0.7 * error(&before), "{} {}", error(&clean[0]), error(&before));
}
