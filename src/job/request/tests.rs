use super::*;
use crate::render::{Choice, PerTechnique};

fn of(line: &str) -> RenderRequest {
    of_flags(line.split(' ').filter(|word| !word.is_empty()).map(str::to_owned)).unwrap()
}

#[test]
fn a_request_of_fields_is_that_of_flags() {
    let plain = RenderRequest::default;
    let groups = "a=b*".parse::<LightGroups>().unwrap();
    let off = TechniqueOptions {
        choices: PerTechnique::new(|it| (it == Technique::PathReuse).then_some(Choice::On)),
        ..TechniqueOptions::default()
    };
    for (request, line) in [
        (plain(), ""),
        (RenderRequest { denoise: Some(Denoise::Oidn), ..plain() }, "--denoise oidn"),
        (RenderRequest { denoise: Some(Denoise::Oidn), techniques: off, ..plain() }, "--denoise oidn --path-reuse on"),
        (RenderRequest { ground: Ground::Shadow, ..plain() }, "--ground shadow"),
        (RenderRequest { light_groups: Some(groups), ..plain() }, "--light-groups a=b*"),
        (RenderRequest { aov: vec![Aov::Lights, Aov::Depth], ..plain() }, "--aov lights,depth"),
        (RenderRequest { balance: Balance::Half, ..plain() }, "--balance half"),
        (RenderRequest { noise: Some(0.1), ..plain() }, "--noise 0.1"),
    ] {
        assert_eq!(format!("{:?}", request.settings()), format!("{:?}", of(line).settings()), "{line}");
    }
    let denoised = of("--denoise oidn").settings();
    assert!(denoised.extras && denoised.techniques[Technique::PathReuse] == Choice::Off);
    let shadows = of("--ground shadow").settings();
    assert!(shadows.transparent && shadows.techniques[Technique::Adaptive] == Choice::Off);
    assert!(of("--light-groups a=b*").aovs().contains(&Aov::Lights));
    let pilot = RenderRequest { pilot: Some(0.5), ..plain() };
    assert_eq!(pilot.check(false).unwrap_err().exit_code(), 64);
}

#[test]
fn requests_survive_as_json_and_as_flags() {
    for line in [
        "",
        "--orbit 30,-20,0.8 --half --sky --env-strength 0.5 --aov none --seed 7 --balance half",
        "--size 24x16 --crop 1,2,3,4 --aperture f/2.8 --focus 2.5 --lens-blades 5 --no-clip --back-faces show",
        "--aperture 0.01 --frame 3.5 --fps 10 --shutter -0.25,0.25 --motion-steps 4 --seed-per-frame --variant 1",
        "--preset thumbnail",
        "--preset product --ground none --spp 3 --guiding on",
        "--preset final --time 90s",
        "--sunsky 40,400,2.5 --light-unit watt --light-radius 0.1 --sun-angle 0.53 --light-groups a=b*,c=d",
        "--env a.hdr --env-rotate -30.1 --energy-compensation off --integrator direct --max-depth 3 --time 1.5",
        "--noise 1e-3 --min-spp 8 --path-reuse 4:2 --guiding auto --adaptive=off --filter box --clamp-direct 2",
        "--checkpoint 10m --keep 3 --resume --rays obvhs --threads 2 --memory-limit 6G --guiding-memory 256M",
        "--colorspace acescg --transparent --denoise oidn --preview a.png --view a.cube --view-space acescg-log2:-1,2.5",
        "--exposure -1.5 --stats a.json --strict --aov all --tev localhost:14 --seed-per-frame false",
    ] {
        let request = RenderRequest { part: "2/3".parse().ok(), scene: "a\u{e9}.glb".into(), ..of(line) };
        let text = serde_json::to_string(&request.entries().unwrap()).unwrap();
        let read: RenderRequest = serde_json::from_str(&text).unwrap();
        assert_eq!(format!("{read:?}"), format!("{request:?}"), "{text}");
        let own = RenderRequest { part: None, ..request };
        let again = RenderRequest { scene: own.scene.clone(), ..of(&own.arguments().unwrap().join(" ")) };
        assert_eq!(format!("{again:?}"), format!("{own:?}"), "{line}");
    }
    use std::os::unix::ffi::OsStringExt;
    let odd = PathBuf::from(std::ffi::OsString::from_vec(vec![b'/', 0xff]));
    let request = RenderRequest { env: Some(odd.clone()), scene: odd, ..RenderRequest::default() };
    let text = serde_json::to_string(&request.entries().unwrap()).unwrap();
    assert_eq!(format!("{:?}", serde_json::from_str::<RenderRequest>(&text).unwrap()), format!("{request:?}"));
    assert_eq!(request.arguments().unwrap_err().exit_code(), 64);
}
