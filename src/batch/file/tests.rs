use super::*;

fn flags() -> HashMap<String, Flag> {
    [
        ("spp", Flag::Value),
        ("seed", Flag::Value),
        ("camera", Flag::Value),
        ("noise", Flag::Value),
        ("env", Flag::Input),
        ("size", Flag::List('x')),
        ("aov", Flag::List(',')),
        ("output", Flag::File),
        ("preview", Flag::File),
        ("no-env", Flag::Switch),
        ("frames", Flag::List(',')),
        ("seed-per-frame", Flag::Choice),
    ]
    .map(|(name, kind)| (name.to_owned(), kind))
    .into()
}

fn jobs(text: &str) -> FileResult<Vec<JobText>> {
    parse(text, Path::new("shots"), &flags())
}

#[test]
fn a_matrix_is_every_combination_and_defaults_stand_behind() {
    let text = r#"
        [defaults]
        spp = 64
        output = "out/{name}.exr"
        [[matrix]]
        scene = ["a/hall.glb", "yard.glb"]
        camera = ["front", "top"]
        seed = [1, 2, 3]
        noise = 1e-3
        [[job]]
        scene = "x.glb"
        name = "last"
        spp = 8
        no-env = true
    "#;
    let jobs = jobs(text).unwrap();
    assert_eq!(jobs.len(), 13);
    assert_eq!(jobs[0].name, "hall-front-1");
    assert_eq!(jobs[1].name, "hall-front-2");
    assert_eq!(jobs[11].name, "yard-top-3");
    assert_eq!(jobs[0].scene, Path::new("shots/a/hall.glb"));
    assert_eq!(jobs[0].output, Path::new("shots/out/hall-front-1.exr"));
    assert_eq!(jobs[0].flags, ["--spp=64", "--camera=front", "--seed=1", "--noise=1e-3"]);
    assert_eq!(jobs[12].flags, ["--spp=8", "--no-env"]);
    assert_eq!(jobs[12].output, Path::new("shots/out/last.exr"));
}

#[test]
fn lists_are_one_value_and_in_a_matrix_several() {
    let text = "[defaults]\naov = ['albedo', 'normal']\n[[job]]\nscene = 'a'\nsize = [64, 48]\n\
                [[matrix]]\nscene = 'b'\nsize = [[64, 48], '32x24']\n[[matrix]]\nscene = 'c'\naov = ['depth', 'all']";
    let lines: Vec<_> = jobs(text).unwrap().iter().map(|j| format!("{} {}", j.name, j.flags.join(" "))).collect();
    assert_eq!(
        lines,
        [
            "a --aov=albedo,normal --size=64x48",
            "b-64x48 --aov=albedo,normal --size=64x48",
            "b-32x24 --aov=albedo,normal --size=32x24",
            "c-depth --aov=depth",
            "c-all --aov=all"
        ]
    );
}

#[test]
fn wildcards_are_the_files_that_there_are() {
    let folder = tempfile::tempdir().unwrap();
    let odd = folder.path().join("[shots]");
    std::fs::create_dir_all(odd.join("a")).unwrap();
    for name in ["a/two.glb", "a/one.glb", "a/x.txt", "three.glb", "odd[1].glb"] {
        std::fs::write(odd.join(name), "").unwrap();
    }
    let names = |text: &str| -> Vec<_> {
        parse(text, &odd, &flags()).unwrap().into_iter().map(|job| (job.name, job.scene)).collect()
    };
    let of = |list: &[&str]| -> Vec<_> {
        let name = |file: &&str| Path::new(file).file_stem().unwrap().to_string_lossy().into_owned();
        list.iter().map(|file| (name(file), odd.join(file))).collect()
    };
    assert_eq!(names("[[matrix]]\nscene = 'a/*.glb'"), of(&["a/one.glb", "a/two.glb"]));
    let all = of(&["three.glb", "a/one.glb", "a/two.glb"]);
    assert_eq!(names("[[matrix]]\nscene = ['three.glb', '*/*.glb']"), all);
    // A file that is called so is meant.
    assert_eq!(names("[[job]]\nscene = 'odd[1].glb'"), of(&["odd[1].glb"]));
}

#[test]
fn mistakes_are_reported_with_their_location() {
    for (text, place, words) in [
        ("[[job]]\nscene = 'a'\nspq = 3", (3, 1), "no key `spq`"),
        ("[[job]]\nscene = 'a'\nspp = [1, 2]", (3, 7), "only a [[matrix]]"),
        ("[[job]]\nscene = 'a'\nspp = ", (3, 7), ""),
        ("\n[[job]]\nspp = 3", (2, 1), "no `scene`"),
        ("[job]\nscene = 'a'", (1, 1), "[[job]]"),
        ("[[jobs]]\nscene = 'a'", (1, 3), "there is no `jobs`"),
        ("[[job]]\nscene = 'a'\nno-env = 1", (3, 10), "true or false"),
        ("[[job]]\nscene = 7", (2, 9), "file"),
        ("[[job]]\nscene = 'a'\nspp = true", (3, 7), "number"),
        ("[[matrix]]\nscene = 'a'\nspp = []", (3, 7), "is an empty list"),
        ("[[matrix]]\nscene = 'a'\nsize = [640, 480]", (3, 8), "[[640, 480]]"),
        ("[[job]]\nscene = 'a'\naov = ['albedo', true]", (3, 18), "a number or text"),
        ("[[job]]\nscene = 'a'\nsize = []", (3, 8), "is an empty list"),
        ("[[matrix]]\nscene = 'none such/*.glb'", (2, 9), "no file is called"),
        ("[[matrix]]\nscene = '[a.glb'", (2, 9), "wildcards"),
        ("[[job]]\nscene = 'none such/*.glb'", (2, 9), "no file is called"),
        ("[[job]]\nscene = 'a'\noutput = '{nam}.exr'", (3, 1), "{nam} is not a key of this job"),
        ("[[job]]\nscene = 'a'\nname = 'x/y'", (1, 1), "cannot be"),
        ("[[job]]\nscene = 'a'\ncamera = \"x\\ny\"", (3, 10), "control character"),
        ("[[job]]\nscene = \"x\\ny\"", (2, 9), "control character"),
        ("[[job]]\nscene = 'a'\nseed-per-frame = 1", (3, 18), "true or false"),
        ("", (1, 1), "no jobs"),
    ] {
        let (at, why) = jobs(text).unwrap_err();
        assert_eq!(at, place, "{text}: {why}");
        assert!(why.contains(words), "{text}: {why}");
    }
    let huge = format!("[[matrix]]\nscene = 'a'\nseed = [{}]\nspp = [{0}]", "1,".repeat(400));
    assert!(jobs(&huge).unwrap_err().1.contains("more than"));
}
