//! What the user of Embree may choose.

/// Choices of a build and of its queries. The default is what `--rays embree` renders with.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct EmbreeOptions {
    /// Threads of the build; 0 for all.
    pub threads: usize,
    /// An instruction set below the CPU's best, in Embree's words: `sse2`, `sse4.2`, `avx`, `avx2`.
    pub isa: Option<&'static str>,
    /// How long to build.
    pub quality: Quality,
    /// `RTC_SCENE_FLAG_COMPACT`: less memory before speed.
    pub compact: bool,
    /// `RTC_SCENE_FLAG_ROBUST`: box and triangle tests that lose no hit between two triangles.
    pub robust: bool,
    /// How rays are handed over.
    pub packets: Packets,
}

/// Embree's build qualities.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Quality {
    /// Two levels, a tree for each mesh, built by Morton codes.
    Low,
    /// Two levels, each mesh's tree as by `Medium`: Embree's low quality of the scene alone.
    TwoLevel,
    /// Binned surface area heuristic.
    #[default]
    Medium,
    /// The same with spatial splits.
    High,
}

/// How the rays of a batch are handed to Embree.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Packets {
    /// As wide as the CPU has them, kept together where that pays (see the module's text).
    #[default]
    Renderer,
    /// One by one.
    Single,
    /// In the batch's order, kept together through the tree.
    Four,
    /// As before.
    Eight,
    /// As before.
    Sixteen,
}
