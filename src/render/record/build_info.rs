//! The build that wrote a file.

use std::sync::LazyLock;

use serde::{Deserialize, Serialize};

use crate::rays::cwbvh::{ISA_BASELINE, VERSION as OBVHS};
use crate::rays::embree;

/// Identifies a build. Another build may round differently, so that bits are reproducible within one build only.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct BuildInfo {
    /// Version of bismar.
    pub version: String,
    /// Commit of the source, with `-dirty` if it was changed; `development` for unoptimised builds, `unknown` without git.
    pub commit: String,
    /// Output of `rustc --version`.
    pub compiler: String,
    /// Architecture and instruction sets that the compiler used.
    pub isa: String,
}

impl BuildInfo {
    /// The text of `--version`: the version, and what the program was built from.
    pub fn text() -> &'static str {
        static TEXT: LazyLock<String> = LazyLock::new(|| {
            let BuildInfo { version, commit, isa, .. } = BuildInfo::here();
            let embree = embree::HEADER_VERSION;
            format!("{version}\ncommit {commit}\nEmbree {embree}, obvhs {OBVHS}\ncompiled for {isa}")
        });
        &TEXT
    }

    /// This build.
    pub fn here() -> Self {
        Self {
            version: env!("CARGO_PKG_VERSION").into(),
            commit: env!("BISMAR_COMMIT").into(),
            compiler: env!("BISMAR_COMPILER").into(),
            isa: ISA_BASELINE.into(),
        }
    }

    /// The differences from another build, for people; empty if there are none.
    pub fn differences(&self, theirs: &Self) -> String {
        let pairs = [
            ("version", &theirs.version, &self.version),
            ("commit", &theirs.commit, &self.commit),
            ("compiler", &theirs.compiler, &self.compiler),
            ("instruction sets", &theirs.isa, &self.isa),
        ];
        let differing = pairs.iter().filter(|(_, theirs, ours)| theirs != ours);
        differing.map(|(name, theirs, ours)| format!("{name} ({theirs}, {ours})")).collect::<Vec<_>>().join(", ")
    }
}
