//! The plain command decides which techniques it uses, says so, and is the command with these decisions as flags.

use std::fs;

use serde_json::Value;

use crate::helpers::program::{Folder, assert_same_bits, attribute, expect, read_json, scene};

fn folder() -> Folder {
    let folder = Folder::new().with_scene("veach.glb", "veach.glb").with_scene("cornell.glb", "cornell.glb");
    folder.with_scene("ajar.glb", "study/ajar.glb")
}

const NAMES: [&str; 4] = ["compensation", "learned_lights", "guiding", "adaptive"];

/// The flags that stand for the decisions of a picture.
fn as_flags(stats: &Value) -> String {
    let choice = |name: &str| if stats["techniques"][name]["on"] == true { "on" } else { "off" };
    let sizes = &stats["path_reuse"]["sizes"];
    let reuse = match stats["techniques"]["path_reuse"]["on"] == true {
        true => format!("{}:{}", sizes["group"], sizes["traced"]),
        false => "off".into(),
    };
    NAMES.map(|name| format!("--{}={} ", name.replace('_', "-"), choice(name))).concat()
        + &format!("--path-reuse={reuse} ")
}

#[test]
fn the_plain_command_is_the_one_with_its_decisions_as_flags() {
    let path = &folder();
    let (mut used, mut unchanged) = (Vec::new(), 0);
    for (line, file) in [
        ("render veach.glb --size 96x64 --spp 32", "veach"),
        ("render ajar.glb --size 72x48 --spp 64", "ajar"),
        ("render cornell.glb --size 40x30 --spp 16 --integrator direct", "direct"),
    ] {
        let said = expect(path, &format!("{line} -v -o {file}.exr --stats {file}.json"), 0);
        let stats = read_json(&path.join(format!("{file}.json")));
        let techniques = &stats["techniques"];
        for name in NAMES {
            let Value::String(why) = &techniques[name]["why"] else { panic!("{techniques}") };
            let line = format!("{}: {why}, ", name.replace('_', " "));
            assert!(said.contains(&line), "{line}: {said}");
            if techniques[name]["on"] == true {
                used.push(name);
            }
        }
        let flags = as_flags(&stats);
        expect(path, &format!("{line} {flags}-q -o chosen.exr --stats chosen.json"), 0);
        // Lights that learned from paths which guiding guided until it was refused learn anew from others.
        let refused = techniques["guiding"]["why"].as_str().is_some_and(|why| why.contains("leaves"));
        if refused && techniques["guiding"]["on"] == false && techniques["learned_lights"]["on"] == true {
            expect(path, &format!("compare {file}.exr chosen.exr --max-z 4"), 0);
        } else {
            assert_same_bits(&path.join(format!("{file}.exr")), &path.join("chosen.exr"));
            unchanged += 1;
        }
        assert_eq!(as_flags(&read_json(&path.join("chosen.json"))), flags);
        expect(path, &format!("{line} --guiding auto --adaptive=auto -q -o auto.exr"), 0);
        assert_same_bits(&path.join(format!("{file}.exr")), &path.join("auto.exr"));
        // The header has the rule, and what it led to.
        let header = |name: &str| attribute(&path.join(format!("{file}.exr")), name);
        let settings: Value = serde_json::from_str(&header("bismar.settings")).unwrap();
        assert_eq!([&settings["guiding"], &settings["adaptive"]], ["auto", "auto"]);
        let fingerprint: Value = serde_json::from_str(&header("bismar.fingerprint")).unwrap();
        assert_eq!([&fingerprint["guiding"], &fingerprint["adaptive"]], ["auto", "auto"]);
        assert!(header("bismar.stats").contains("\"techniques\""));
    }
    let decided = |seed: u32| {
        expect(
            path,
            &format!("render cornell.glb --size 72x48 --spp 16 --seed {seed} -q -o any.exr --stats any.json"),
            0,
        );
        read_json(&path.join("any.json"))["techniques"].clone()
    };
    let first = decided(0);
    assert!((1..4).all(|seed| decided(seed) == first), "pictures of other seeds decide alike");
    assert!(unchanged >= 2);
    for name in ["learned_lights", "guiding", "adaptive"] {
        assert!(used.contains(&name), "none of the scenes uses {name}: {used:?}");
    }
}

#[test]
fn each_technique_is_off_where_nobody_asked_for_it() {
    let path = &folder();
    // Other balances are there to compare with.
    expect(path, "render veach.glb --size 48x32 --spp 16 --balance half -q -o half.exr --stats half.json", 0);
    let half = read_json(&path.join("half.json"));
    assert!(
        ["learned_lights", "guiding", "adaptive", "compensation"].iter().all(|name| half[*name].is_null()),
        "{half}"
    );
    assert!(half["settings"]["guiding"] == "off" && half["settings"]["adaptive"] == "off", "{half}");
    let off = "--guiding off --adaptive=off --learned-lights off --compensation off";
    expect(path, &format!("render veach.glb --size 48x32 --spp 16 {off} -q -o off.exr --stats off.json"), 0);
    let off = read_json(&path.join("off.json"));
    assert!(["learned_lights", "guiding", "adaptive", "compensation"].iter().all(|name| off[*name].is_null()), "{off}");
    assert_eq!(off["techniques"]["guiding"]["why"], "not asked for");
    // Each can be used with any balance.
    let on = "--balance half --learned-lights on --adaptive=on --guiding on";
    expect(path, &format!("render veach.glb --size 48x32 --spp 16 {on} -q -o on.exr --stats on.json"), 0);
    let on = read_json(&path.join("on.json"));
    assert!(["learned_lights", "guiding"].iter().all(|name| on[*name]["on"] == true), "{on}");
    assert!(on["adaptive"].is_object(), "{on}");
    // A few paths, and goals of noise.
    for (flags, why) in [("--spp 4", "fewer than 16 paths per pixel"), ("--noise 0.5", "a noise goal gives")] {
        let line = format!("render cornell.glb --size 24x16 {flags} -q -o few.exr --stats few.json");
        expect(path, &line, 0);
        let few = read_json(&path.join("few.json"));
        let said = few["techniques"]["adaptive"]["why"].as_str().unwrap();
        assert!(said.contains(why) && few["adaptive"].is_null(), "{flags}: {said}");
    }
}

#[test]
fn a_picture_of_other_choices_is_refused_and_goes_on_by_its_own() {
    let path = &folder();
    let line = "render cornell.glb --size 40x30 -q -o out.exr --checkpoint 9";
    let before = "--guiding off --adaptive=off";
    expect(path, &format!("{line} --spp 16 {before}"), 0);
    let said = expect(path, &format!("{line} --spp 32 --resume"), 65);
    assert!(said.contains("guiding (off there, auto here)") && said.contains("adaptive (off there"), "{said}");
    expect(path, &format!("{line} --spp 32 --resume {before}"), 0);
    // The flag may stand alone, and a batch file's true and false are on and off.
    expect(path, "render --adaptive cornell.glb --size 40x30 --spp 16 -q -o a.exr --stats a.json", 0);
    assert_eq!(read_json(&path.join("a.json"))["settings"]["adaptive"], "on");
    let jobs = "[defaults]\nscene = \"cornell.glb\"\nsize = [40, 30]\nspp = 16\nstats = \"{name}.json\"\n\
                [[job]]\nname = \"on\"\nadaptive = true\n[[job]]\nname = \"off\"\nadaptive = false\n\
                [[job]]\nname = \"auto\"\nadaptive = \"auto\"\n";
    fs::write(path.join("jobs.toml"), jobs).unwrap();
    expect(path, "batch jobs.toml -q", 0);
    let of = |name: &str| read_json(&path.join(format!("{name}.json")))["settings"]["adaptive"].clone();
    assert_eq!([of("on"), of("off"), of("auto")], ["on", "off", "auto"]);
}

#[test]
fn short_time_limits_are_no_longer_because_of_pre_passes() {
    let path = &folder();
    expect(path, "render ajar.glb --size 960x540 --time 6 -q -o timed.exr --stats timed.json", 0);
    let timed = read_json(&path.join("timed.json"));
    assert!(timed["samples"]["paths"].as_u64().unwrap() > 0, "{timed}");
    // Pre-passes take no more than their share of the limit, whatever the machine: it is not all spent when the picture begins.
    assert_eq!(timed["stop"], "time");
}

/// Stratified points gain as much in cornell as its field: guided pictures have 1.08 of the error times CPU seconds. The interior of
/// `window` has 0.57 of the error and 0.6 of the rays.
#[test]
fn paths_are_not_guided_where_stratified_points_gain_as_much() {
    let path = &Folder::new();
    for (name, more, guided) in [
        ("cornell.glb", String::new(), false),
        ("study/window.glb", format!("--env {}", scene("study/window.hdr").display()), true),
    ] {
        let line = format!("render {} {more} --size 960x540 --spp 32 --crop 0,0,8,8", scene(name).display());
        let said = expect(path, &format!("{line} -v -o {guided}.exr --stats s.json"), 0);
        let stats = read_json(&path.join("s.json"));
        assert_eq!(stats["guiding"]["on"], guided, "{name}: {said}");
        assert!(said.contains("guiding: leaves ") && said.contains(" of error × time, "), "{name}: {said}");
        assert!(!guided || stats["guiding"]["standard_error"].is_number(), "{name}: {stats}");
    }
}
