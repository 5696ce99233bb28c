//! What obvhs lets its user choose.

use obvhs::BvhBuildParams;

/// Choices of a build and of its queries. The default is what `--rays obvhs` renders with.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct ObvhsOptions {
    /// Which tree.
    pub tree: TreeKind,
    /// How long to build.
    pub preset: Preset,
    /// Split the boxes of large triangles beforehand? `None` does as the preset says.
    pub split: Option<bool>,
    /// Which triangle test.
    pub test: TriangleTest,
}

/// obvhs' trees.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum TreeKind {
    /// Two children a node, boxes in single precision.
    Two,
    /// Eight children a node, boxes in eight bits: Ylitie et al. (2017), *Efficient Incoherent Ray Traversal on GPUs
    /// Through Compressed Wide BVHs*.
    #[default]
    Eight,
}

/// obvhs' build presets. The two slowest split beforehand.
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

/// The test of a ray with a triangle, both Möller and Trumbore's. (`intersect_embree` of obvhs 0.4 is none: the distance
/// that it returns is not divided by the determinant.)
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum TriangleTest {
    /// Embree's default: divides once it knows that it hits.
    #[default]
    Embree,
    /// obvhs' own: divides first, and takes a weight of −0 for a miss.
    Own,
}

impl Preset {
    /// From the fastest to the slowest.
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
