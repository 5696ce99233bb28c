//! Ray backends with options, by names such as `embree+high+robust`.

use std::sync::Arc;

use bismar::Result;
use bismar::rays::cwbvh::{ObvhsOptions, ObvhsRays, Preset, TreeKind, TriangleTest};
use bismar::rays::embree::{EmbreeOptions, EmbreeRays, Packets, Quality};
use bismar::rays::{RayQueries, Watch};
use bismar::scene::Scene;

/// A backend with its options.
#[derive(Debug, Clone, PartialEq)]
pub struct Contender {
    what: What,
}

#[derive(Debug, Clone, PartialEq)]
enum What {
    Embree(EmbreeOptions),
    Obvhs(ObvhsOptions),
}

/// Names of options and their values. A list's first name is the default, which names of contenders omit.
const QUALITIES: [(&str, Quality); 4] =
    [("medium", Quality::Medium), ("low", Quality::Low), ("two-level", Quality::TwoLevel), ("high", Quality::High)];
const PACKETS: [(&str, Packets); 5] = [
    ("as-rendered", Packets::Renderer),
    ("single", Packets::Single),
    ("x4", Packets::Four),
    ("x8", Packets::Eight),
    ("x16", Packets::Sixteen),
];
/// Instruction sets that Embree can be held to.
pub const ISAS: [&str; 4] = ["sse2", "sse4.2", "avx", "avx2"];
/// Widths of vectors that Embree can be held to.
const LEVELS: [&str; 2] = ["simd128", "simd256"];
const PRESETS: [(&str, Preset); 6] = [
    ("medium", Preset::Medium),
    ("fastest", Preset::Fastest),
    ("very-fast", Preset::VeryFast),
    ("fast", Preset::Fast),
    ("slow", Preset::Slow),
    ("very-slow", Preset::VerySlow),
];
const TREES: [(&str, TreeKind); 2] = [("cwbvh", TreeKind::EightWide), ("bvh2", TreeKind::Binary)];
const TESTS: [(&str, TriangleTest); 2] = [("embree-test", TriangleTest::Embree), ("own-test", TriangleTest::Obvhs)];

/// Sets a field by an option's name, if the list has it.
fn set<T: Copy>(list: &[(&str, T)], word: &str, field: &mut T) -> bool {
    let value = list.iter().find(|(name, _)| *name == word).map(|(_, value)| *value);
    value.inspect(|value| *field = *value).is_some()
}

fn word<T: Copy + PartialEq>(list: &[(&'static str, T)], value: T) -> Option<&'static str> {
    list.iter().skip(1).find(|(_, v)| *v == value).map(|(name, _)| *name)
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
    pub fn baseline() -> Self {
        Self { what: What::Embree(EmbreeOptions::default()) }
    }

    /// The options of `--rays obvhs`.
    pub fn other() -> Self {
        Self { what: What::Obvhs(ObvhsOptions::default()) }
    }

    /// The lists `usual`, `quick`, `large` and `all`, or names separated by commas.
    pub fn list(text: &str) -> std::result::Result<Vec<Self>, String> {
        let text = match text {
            "all" => return Ok(Self::all()),
            "usual" => DEFAULT_LIST,
            "quick" => QUICK_LIST,
            "large" => LARGE_LIST,
            names => names,
        };
        text.split(',').map(|name| Self::named(name.trim())).collect()
    }

    fn all() -> Vec<Self> {
        let mut all = Vec::new();
        for (_, quality) in QUALITIES {
            for (_, packets) in PACKETS {
                for (compact, robust) in [(false, false), (true, false), (false, true), (true, true)] {
                    let options = EmbreeOptions { quality, packets, compact, robust, ..Default::default() };
                    all.push(Self { what: What::Embree(options) });
                }
            }
        }
        for (_, tree) in TREES {
            for (_, preset) in PRESETS {
                for split in [false, true] {
                    for (_, test) in TESTS {
                        let split = Some(split);
                        all.push(Self { what: What::Obvhs(ObvhsOptions { tree, preset, split, test }) });
                    }
                }
            }
        }
        all
    }

    fn named(name: &str) -> std::result::Result<Self, String> {
        let mut words = name.split('+');
        let unknown = |word: &str, there: &str| Err(format!("'{name}': there is no '{word}'; there are {there}"));
        match words.next() {
            Some("embree") => {
                let mut options = EmbreeOptions::default();
                for word in words {
                    let isa = ISAS.into_iter().find(|isa| *isa == word);
                    options.isa = isa.or(options.isa);
                    let level = LEVELS.into_iter().find(|level| *level == word);
                    options.frequency_level = level.or(options.frequency_level);
                    options.compact |= word == "compact";
                    options.robust |= word == "robust";
                    let known = isa.is_some() || level.is_some() || ["compact", "robust"].contains(&word);
                    if !(known
                        || set(&QUALITIES, word, &mut options.quality)
                        || set(&PACKETS, word, &mut options.packets))
                    {
                        return unknown(
                            word,
                            "low, two-level, medium, high, compact, robust, single, x4, x8, x16, sse2, sse4.2, avx, avx2, simd128, simd256",
                        );
                    }
                }
                Ok(Self { what: What::Embree(options) })
            }
            Some("obvhs") => {
                let mut options = ObvhsOptions::default();
                for word in words {
                    if word == "split" || word == "whole" {
                        options.split = Some(word == "split");
                    } else if !(set(&PRESETS, word, &mut options.preset)
                        || set(&TREES, word, &mut options.tree)
                        || set(&TESTS, word, &mut options.test))
                    {
                        return unknown(
                            word,
                            "bvh2, cwbvh, fastest, very-fast, fast, medium, slow, very-slow, split, whole, own-test",
                        );
                    }
                }
                Ok(Self { what: What::Obvhs(options) })
            }
            other => unknown(other.unwrap_or(""), "embree and obvhs, followed by choices: embree+high+robust"),
        }
    }

    /// Its name, without options that have their defaults.
    pub fn name(&self) -> String {
        let (library, words) = match &self.what {
            What::Embree(o) => (
                "embree",
                vec![
                    word(&QUALITIES, o.quality),
                    o.compact.then_some("compact"),
                    o.robust.then_some("robust"),
                    word(&PACKETS, o.packets),
                    o.isa,
                    o.frequency_level,
                ],
            ),
            What::Obvhs(o) => {
                let split = o.split.map(|split| if split { "split" } else { "whole" });
                ("obvhs", vec![word(&TREES, o.tree), word(&PRESETS, o.preset), split, word(&TESTS, o.test)])
            }
        };
        words.into_iter().flatten().fold(library.to_owned(), |name, word| name + "+" + word)
    }

    /// Limits Embree to an instruction set, unless it is limited to another one.
    pub fn held_to(mut self, isa: Option<&'static str>) -> Self {
        if let What::Embree(options) = &mut self.what {
            options.isa = options.isa.or(isa);
        }
        self
    }

    /// Builds the scene on the current rayon pool, or on as many threads of Embree's.
    pub fn build(&self, scene: Arc<Scene>, watch: Watch) -> Result<Box<dyn RayQueries>> {
        Ok(match &self.what {
            What::Embree(options) => {
                let options = EmbreeOptions { threads: rayon::current_num_threads(), ..options.clone() };
                Box::new(EmbreeRays::build(scene, &options, watch)?)
            }
            What::Obvhs(options) => Box::new(ObvhsRays::build(scene, options, watch)?),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_read_as_they_are_written() {
        let mut all = Contender::all();
        all.extend(Contender::list("usual").unwrap());
        all.extend(Contender::list("quick").unwrap());
        for contender in all {
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
