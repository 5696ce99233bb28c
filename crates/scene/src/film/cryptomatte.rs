//! Cryptomatte: the coverage of pixels by objects and materials, for compositors. After Friedman and Jones, "Fully Automatic ID
//! Mattes with Support for Motion Blur and Transparency" (SIGGRAPH 2015 posters), specification 1.2.0.

use serde::{Deserialize, Serialize};

use super::header::{Header, HeaderValue};

/// Number of names per pixel in the file: three layers of two.
pub(crate) const RANKS: usize = 6;
/// Number of names per pixel whose paths are counted exactly.
pub const NAMES: usize = 64;

/// The names that the paths of a pixel hit, with their numbers of paths. Exact for up to [`NAMES`] names. A further name takes
/// the place of the one with the fewest paths, and its count: then counts are too high by at most one path in [`NAMES`], and no
/// name with more paths than that is missing (Metwally, Agrawal and El Abbadi, "Efficient Computation of Frequent and Top-k
/// Elements in Data Streams", ICDT 2005).
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Matte {
    /// Hash of a name and number of paths that hit it, in the order of first hits; 0 paths for a free entry.
    first: [(u32, u32); RANKS],
    /// Those of further names.
    more: Vec<(u32, u32)>,
}

impl Matte {
    /// Adds `paths` paths that hit the name with hash `id`.
    #[inline]
    pub fn add(&mut self, id: u32, paths: u32) {
        match self.first.iter_mut().find(|(own, n)| *own == id || *n == 0) {
            Some(entry) => *entry = (id, entry.1 + paths),
            None => self.add_further(id, paths),
        }
    }

    #[inline(never)]
    fn add_further(&mut self, id: u32, paths: u32) {
        if let Some(entry) = self.more.iter_mut().find(|(own, _)| *own == id) {
            entry.1 += paths;
        } else if RANKS + self.more.len() < NAMES {
            self.more.push((id, paths));
        } else if let Some(fewest) = self.first.iter_mut().chain(&mut self.more).min_by_key(|(_, n)| *n) {
            *fewest = (id, fewest.1 + paths);
        }
    }

    fn entries(&self) -> impl Iterator<Item = (u32, u32)> {
        self.first.iter().chain(&self.more).copied().filter(|(_, n)| *n > 0)
    }

    /// Adds the paths of another matte.
    pub fn join(&mut self, other: &Self) {
        other.entries().for_each(|(id, n)| self.add(id, n));
    }

    /// Hash and number of paths of the name with this rank, by descending number of paths; zeros if there is none. Of equal names
    /// the one that was hit first comes first, so that mattes of objects and of their materials agree.
    pub fn rank(&self, rank: usize) -> (u32, u32) {
        let mut ranks = [(0, 0); RANKS];
        for mut entry in self.entries() {
            let behind = ranks.iter().take_while(|other| other.1 >= entry.1).count();
            ranks[behind..].iter_mut().for_each(|other| std::mem::swap(other, &mut entry));
        }
        ranks[rank]
    }
}

/// The hash of a name by the specification: MurmurHash3_32, changed so that its bits form a float that is neither denormal,
/// infinite nor NaN.
pub fn id(name: &str) -> u32 {
    let hash = hash(name);
    match hash >> 23 & 0xff {
        0 | 0xff => hash ^ (1 << 23),
        _ => hash,
    }
}

fn hash(name: &str) -> u32 {
    murmur3::murmur3_32(&mut name.as_bytes(), 0).unwrap_or_default()
}

/// The header attributes of a Cryptomatte layer (for example `CryptoObject`) with its manifest of names, by the
/// specification.
pub fn header<'a>(layer: &str, names: impl Iterator<Item = &'a str>) -> Header {
    let manifest: serde_json::Map<_, _> =
        names.map(|name| (name.to_owned(), format!("{:08x}", id(name)).into())).collect();
    let key = &format!("{:08x}", hash(layer))[..7];
    let entry = |what: &str, value: String| (format!("{PREFIX}{key}/{what}").into(), HeaderValue::Text(value));
    vec![
        entry("name", layer.to_owned()),
        entry("hash", "MurmurHash3_32".into()),
        entry("conversion", "uint32_to_float32".into()),
        entry("manifest", serde_json::Value::Object(manifest).to_string()),
    ]
}

/// Prefix of Cryptomatte's header attributes.
pub const PREFIX: &str = "cryptomatte/";

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hashes_are_those_of_the_reference_and_floats() {
        // Of A. Appleby's MurmurHash3_x86_32 with seed 0.
        for (name, value) in [("", 0), ("hello", 0x248b_fa47), ("hello, world", 0x149b_bb7f)] {
            assert_eq!(hash(name), value, "{name}");
        }
        for i in 0..100_000 {
            assert!(f32::from_bits(id(&i.to_string())).is_normal());
        }
    }

    #[test]
    fn ranks_are_by_coverage_whenever_a_name_is_met() {
        // A large name among small ones, met last; of equal names the first is first.
        let small = || (1..=40).map(|id| (id, 2));
        let of = |all: &mut dyn Iterator<Item = (u32, u32)>| {
            let mut matte = Matte::default();
            all.for_each(|(id, paths)| matte.add(id, paths));
            matte
        };
        let matte = of(&mut small().chain([(99, 20), (7, 3)]));
        assert_eq!([0, 1, 2, 5].map(|rank| matte.rank(rank)), [(99, 20), (7, 5), (1, 2), (4, 2)]);
        let mut joined = of(&mut [(70, 1), (40, 9)].into_iter());
        joined.join(&matte);
        assert_eq!([0, 1, 2].map(|rank| joined.rank(rank)), [(99, 20), (40, 11), (7, 5)]);
        assert_eq!(of(&mut small().take(2)).rank(2), (0, 0));
        // Beyond the names that are counted exactly, to the bound; `n` names of one path each, three larger ones spread among them.
        let large = |i: u32| [(9001, 3), (9002, 5), (9003, 9)].into_iter().filter(move |(_, of)| i % 40 < *of);
        let matte = of(&mut (0..4000).flat_map(|i| large(i).map(|(id, _)| (id, 1)).chain([(i, 1)])));
        let all = 4000 + 300 + 500 + 900;
        for (rank, right) in [(9003, 900), (9002, 500), (9001, 300)].into_iter().enumerate() {
            let found = matte.rank(rank);
            assert!(found.0 == right.0 && (right.1..=right.1 + all / NAMES as u32).contains(&found.1), "{found:?}");
        }
    }

    #[test]
    fn a_header_says_what_the_specification_asks_for() {
        let header = header("CryptoObject", ["hello", "a \"b\""].into_iter());
        let text = |name: &str| match header.iter().find(|(n, _)| n.ends_with(name)) {
            Some((_, HeaderValue::Text(text))) => text.clone(),
            _ => panic!("no {name}"),
        };
        assert_eq!(text("/name"), "CryptoObject");
        assert_eq!(text("/conversion"), "uint32_to_float32");
        let manifest: serde_json::Value = serde_json::from_str(&text("/manifest")).unwrap();
        assert_eq!(manifest["hello"], "248bfa47");
        assert!(
            header.iter().all(|(name, _)| name.len() < 32
                && name.starts_with(&format!("cryptomatte/{:07x}/", hash("CryptoObject") >> 4)))
        );
    }
}
