//! Which build wrote a file.

use serde::{Deserialize, Serialize};

/// What tells builds apart. Another one may round otherwise, so that bits hold within one build.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct BuildInfo {
    /// Of bismar.
    pub version: String,
    /// Of its source, `-dirty` if it was changed; `development` for builds that are not optimised, `unknown` without git.
    pub commit: String,
    /// As `rustc --version` says.
    pub compiler: String,
    /// Architecture and instruction sets that the compiler was told to use.
    pub isa: String,
}

impl BuildInfo {
    /// This build.
    pub fn here() -> Self {
        Self {
            version: env!("CARGO_PKG_VERSION").into(),
            commit: env!("BISMAR_COMMIT").into(),
            compiler: env!("BISMAR_COMPILER").into(),
            isa: env!("BISMAR_ISA_BASELINE").into(),
        }
    }

    /// In what another build differs, for people; empty when in nothing.
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
