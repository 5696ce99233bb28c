//! Ray backends with options, by names such as `embree+high+robust`.

use std::sync::Arc;

use bismar::Result;
use bismar::rays::cwbvh::{ObvhsOptions, ObvhsRays, Preset, TreeKind, TriangleTest};
use bismar::rays::embree::{EmbreeOptions, EmbreeRays, Packets, Quality};
use bismar::rays::{RayQueries, Watch};
use bismar::scene::Scene;

/// A backend with its options.
#[derive(Debug, Clone, PartialEq)]
pub enum Contender {
    Embree(EmbreeOptions),
    Obvhs(ObvhsOptions),
}

/// Words of names with what they set, in the order in which names have them. Names omit those that set a default.
type Words<Options> = [(&'static str, fn(&mut Options))];

const EMBREE: &Words<EmbreeOptions> = &[
    ("medium", |o| o.quality = Quality::Medium),
    ("low", |o| o.quality = Quality::Low),
    ("two-level", |o| o.quality = Quality::TwoLevel),
    ("high", |o| o.quality = Quality::High),
    ("compact", |o| o.compact = true),
    ("robust", |o| o.robust = true),
    ("single", |o| o.packets = Packets::Single),
    ("x4", |o| o.packets = Packets::Four),
    ("x8", |o| o.packets = Packets::Eight),
    ("x16", |o| o.packets = Packets::Sixteen),
    ("sse2", |o| o.isa = Some("sse2")),
    ("sse4.2", |o| o.isa = Some("sse4.2")),
    ("avx", |o| o.isa = Some("avx")),
    ("avx2", |o| o.isa = Some("avx2")),
    ("simd128", |o| o.frequency_level = Some("simd128")),
    ("simd256", |o| o.frequency_level = Some("simd256")),
];
const OBVHS: &Words<ObvhsOptions> = &[
    ("cwbvh", |o| o.tree = TreeKind::EightWide),
    ("bvh2", |o| o.tree = TreeKind::Binary),
    ("medium", |o| o.preset = Preset::Medium),
    ("fastest", |o| o.preset = Preset::Fastest),
    ("very-fast", |o| o.preset = Preset::VeryFast),
    ("fast", |o| o.preset = Preset::Fast),
    ("slow", |o| o.preset = Preset::Slow),
    ("very-slow", |o| o.preset = Preset::VerySlow),
    ("split", |o| o.split = Some(true)),
    ("whole", |o| o.split = Some(false)),
    ("own-test", |o| o.test = TriangleTest::Obvhs),
];
/// Instruction sets that Embree can be held to.
pub(crate) const ISAS: [&str; 4] = ["sse2", "sse4.2", "avx", "avx2"];

/// The options of a name's words.
fn options<'a, O: Default>(all: &Words<O>, words: impl Iterator<Item = &'a str>) -> std::result::Result<O, String> {
    let mut options = O::default();
    for word in words {
        let known = || all.iter().map(|(known, _)| *known).collect::<Vec<_>>().join(", ");
        let row = all.iter().find(|(known, _)| *known == word);
        row.ok_or_else(|| format!("there is no '{word}'; there are {}", known()))?.1(&mut options);
    }
    Ok(options)
}

/// The name with the words that have set options.
fn name<O: Clone + Default + PartialEq>(library: &str, all: &Words<O>, options: &O) -> String {
    let changes = |options: &O, set: &fn(&mut O)| {
        let mut changed = options.clone();
        set(&mut changed);
        changed != *options
    };
    let words = all.iter().filter(|(_, set)| !changes(options, set) && changes(&O::default(), set));
    words.fold(library.to_owned(), |name, (word, _)| name + "+" + word)
}

/// Names of every combination of options, but for instruction sets and levels.
fn combinations() -> Vec<String> {
    let plus = |names: Vec<String>, words: &&[&str]| {
        let more = names.iter().flat_map(|name| words.iter().map(move |word| format!("{name}+{word}")));
        more.chain(names.iter().cloned()).collect()
    };
    let embree = [&["low", "two-level", "high"][..], &["compact"], &["robust"], &["single", "x4", "x8", "x16"]];
    let obvhs = [&["bvh2"][..], &["fastest", "very-fast", "fast", "slow", "very-slow"], &["own-test"]];
    let obvhs = obvhs.iter().fold(vec!["obvhs+split".to_owned(), "obvhs+whole".to_owned()], plus);
    [embree.iter().fold(vec!["embree".to_owned()], plus), obvhs].concat()
}

/// Contenders of a default study: each option of each library alone.
const DEFAULT_LIST: &str = "embree+low,embree+two-level,embree+high,embree+compact,embree+robust,embree+high+robust,\
                     embree+single,embree+x4,embree+x8,embree+x16,embree+avx2,embree+sse2,embree+simd128,embree+simd256,obvhs+fastest,\
                     obvhs+very-fast,obvhs+fast,obvhs,obvhs+slow,obvhs+very-slow,obvhs+split,obvhs+slow+whole,\
                     obvhs+own-test,obvhs+bvh2+fastest,obvhs+bvh2,obvhs+bvh2+very-slow";
/// Contenders for millions of triangles, without builds that take minutes.
const LARGE_LIST: &str = "embree+low,embree+high,embree+single,obvhs+fastest,obvhs,obvhs+bvh2";
const QUICK_LIST: &str = "embree+low,embree+high,embree+single,obvhs+fastest,obvhs,obvhs+very-slow,obvhs+bvh2";

impl Contender {
    /// The baseline: the options of `--rays embree`.
    pub(crate) fn baseline() -> Self {
        Self::Embree(EmbreeOptions::default())
    }

    /// The options of `--rays obvhs`.
    pub fn other() -> Self {
        Self::Obvhs(ObvhsOptions::default())
    }

    /// The lists `usual`, `quick`, `large` and `all`, or names separated by commas.
    pub fn list(text: &str) -> std::result::Result<Vec<Self>, String> {
        let names = match text {
            "all" => combinations().join(","),
            "usual" => DEFAULT_LIST.to_owned(),
            "quick" => QUICK_LIST.to_owned(),
            "large" => LARGE_LIST.to_owned(),
            names => names.to_owned(),
        };
        names.split(',').map(|name| Self::named(name.trim())).collect()
    }

    fn named(name: &str) -> std::result::Result<Self, String> {
        let mut words = name.split('+');
        let named = match words.next() {
            Some("embree") => options(EMBREE, words).map(Self::Embree),
            Some("obvhs") => options(OBVHS, words).map(Self::Obvhs),
            _ => Err("there are embree and obvhs, followed by choices: embree+high+robust".to_owned()),
        };
        named.map_err(|why| format!("'{name}': {why}"))
    }

    /// Its name, without options that have their defaults.
    pub fn name(&self) -> String {
        match self {
            Self::Embree(options) => name("embree", EMBREE, options),
            Self::Obvhs(options) => name("obvhs", OBVHS, options),
        }
    }

    /// Limits Embree to an instruction set, unless it is limited to another one.
    pub(crate) fn held_to(mut self, isa: Option<&'static str>) -> Self {
        if let Self::Embree(options) = &mut self {
            options.isa = options.isa.or(isa);
        }
        self
    }

    /// Builds the scene on the current rayon pool, or on as many threads of Embree's.
    pub fn build(&self, scene: Arc<Scene>, watch: Watch) -> Result<Box<dyn RayQueries>> {
        Ok(match self {
            Self::Embree(options) => {
                let options = EmbreeOptions { threads: rayon::current_num_threads(), ..options.clone() };
                Box::new(EmbreeRays::build(scene, &options, watch)?)
            }
            Self::Obvhs(options) => Box::new(ObvhsRays::build(scene, options, watch)?),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_read_as_they_are_written() {
        assert_eq!(Contender::list("all").unwrap().len(), 128);
        for contender in ["all", "usual", "quick"].into_iter().flat_map(|list| Contender::list(list).unwrap()) {
            assert_eq!(Contender::list(&contender.name()).unwrap(), [contender]);
        }
        assert_eq!(Contender::list("embree+medium").unwrap(), [Contender::baseline()]);
        assert_eq!(Contender::other().name(), "obvhs");
        for wrong in ["", "embree+best", "obvhs+single", "optix"] {
            assert!(Contender::list(wrong).unwrap_err().contains("there are"), "{wrong}");
        }
    }

    #[test]
    fn only_embree_is_held_to_an_instruction_set() {
        let held = |name: &str| Contender::list(name).unwrap().remove(0).held_to(Some("avx")).name();
        assert_eq!(["embree", "embree+sse2", "obvhs"].map(held), ["embree+avx", "embree+sse2", "obvhs"]);
    }
}
