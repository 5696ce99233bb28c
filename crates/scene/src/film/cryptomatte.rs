//! Cryptomatte: the coverage of pixels by objects and materials, for compositors. After Friedman and Jones, "Fully Automatic ID
//! Mattes with Support for Motion Blur and Transparency" (SIGGRAPH 2015 posters), specification 1.2.0.

use serde::{Deserialize, Serialize};

use super::header::{Header, HeaderValue};

/// Number of names per pixel: three layers of two.
pub const RANKS: usize = 6;

/// The names that the paths of a pixel hit, with their numbers of paths.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Matte {
    /// Hash of a name and number of paths that hit it, in the order of first hits; 0 paths for a free entry.
    entries: [(u32, u32); RANKS],
}

impl Matte {
    /// Adds `paths` paths that hit the name with hash `id`. Names beyond [`RANKS`] are left out.
    #[inline]
    pub fn add(&mut self, id: u32, paths: u32) {
        if let Some(entry) = self.entries.iter_mut().find(|(own, n)| *own == id || *n == 0) {
            *entry = (id, entry.1 + paths);
        }
    }

    /// Adds the paths of another matte.
    pub fn join(&mut self, other: &Self) {
        other.entries.iter().filter(|(_, n)| *n > 0).for_each(|(id, n)| self.add(*id, *n));
    }

    /// Hash and number of paths of the name with this rank, by descending number of paths; zeros if there is none.
    pub fn rank(&self, rank: usize) -> (u32, u32) {
        let mut sorted = self.entries;
        sorted.sort_unstable_by(|a, b| b.1.cmp(&a.1).then(a.0.cmp(&b.0)));
        sorted[rank]
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
    fn ranks_are_by_coverage_and_a_seventh_name_is_left_out() {
        let mut matte = Matte::default();
        for (id, paths) in [(5, 1), (9, 3), (5, 1), (7, 2), (1, 1), (2, 1), (3, 1), (4, 1)] {
            matte.add(id, paths);
        }
        assert_eq!([0, 1, 2].map(|rank| matte.rank(rank)), [(9, 3), (5, 2), (7, 2)]);
        assert_eq!(matte.rank(5), (3, 1));
        let mut joined = Matte::default();
        joined.add(7, 5);
        joined.join(&matte);
        assert_eq!([0, 1].map(|rank| joined.rank(rank)), [(7, 7), (9, 3)]);
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
