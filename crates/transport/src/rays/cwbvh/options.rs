//! Options of the obvhs backend.

use obvhs::BvhBuildParams;

/// Options of builds and queries. The default is that of `--rays obvhs`.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct ObvhsOptions {
    pub tree: TreeKind,
    pub preset: Preset,
    /// Split the boxes of large triangles before the build? `None` for the default of the preset.
    pub split: Option<bool>,
    pub test: TriangleTest,
}

#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum TreeKind {
    /// Binary, boxes in single precision.
    Binary,
    /// Eight-wide, boxes quantized to eight bits (Ylitie et al. 2017, *Efficient Incoherent Ray Traversal on GPUs Through
    /// Compressed Wide BVHs*).
    #[default]
    EightWide,
}

/// Build presets of obvhs. The two slowest split large triangles.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
#[allow(missing_docs, reason = "their names say it")]
pub enum Preset {
    Fastest,
    VeryFast,
    Fast,
    #[default]
    Medium,
    Slow,
    VerySlow,
}

/// Ray-triangle tests, both by Möller and Trumbore. (`intersect_embree` of obvhs 0.4 is not usable: the distance that it
/// returns is not divided by the determinant.)
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum TriangleTest {
    /// Embree's default test: divides after the hit is certain.
    #[default]
    Embree,
    /// obvhs' own test: divides first, and treats a barycentric weight of −0 as a miss.
    Obvhs,
}

impl Preset {
    /// All presets, from the fastest to the slowest build.
    pub const ALL: [Self; 6] = [Self::Fastest, Self::VeryFast, Self::Fast, Self::Medium, Self::Slow, Self::VerySlow];
}

impl ObvhsOptions {
    pub(super) fn parameters(&self) -> BvhBuildParams {
        match self.preset {
            Preset::Fastest => BvhBuildParams::fastest_build(),
            Preset::VeryFast => BvhBuildParams::very_fast_build(),
            Preset::Fast => BvhBuildParams::fast_build(),
            Preset::Medium => BvhBuildParams::medium_build(),
            Preset::Slow => BvhBuildParams::slow_build(),
            Preset::VerySlow => BvhBuildParams::very_slow_build(),
        }
    }

    pub(super) fn splits(&self) -> bool {
        self.split.unwrap_or(self.parameters().pre_split)
    }
}
