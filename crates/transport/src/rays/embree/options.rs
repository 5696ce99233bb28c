//! Options of the Embree backend.

/// Options of builds and queries. The default is that of `--rays embree`.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct EmbreeOptions {
    /// Number of build threads; 0 for one per core.
    pub threads: usize,
    /// Instruction set: `sse2`, `sse4.2`, `avx` or `avx2`; `None` for the best of the CPU.
    pub isa: Option<&'static str>,
    /// The widest vectors that do not lower the clock too much, `simd128` or `simd256`; `None`: as Embree decides by the processor.
    /// It takes four-wide trees with the first (the Xeons of 2017 to 2020), eight-wide ones with the second.
    pub frequency_level: Option<&'static str>,
    pub quality: Quality,
    /// `RTC_SCENE_FLAG_COMPACT`: less memory at lower speed.
    pub compact: bool,
    /// `RTC_SCENE_FLAG_ROBUST`: watertight box and triangle tests.
    pub robust: bool,
    pub packets: Packets,
}

#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Quality {
    /// Two levels, with a tree per mesh built from Morton codes.
    Low,
    /// Two levels, with a tree per mesh as by `Medium`: low quality of the scene only.
    TwoLevel,
    /// Binned surface area heuristic.
    #[default]
    Medium,
    /// Surface area heuristic with spatial splits.
    High,
}

/// How the rays of a batch are passed to Embree.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Packets {
    /// The native width, coherent where that is faster (see the module's documentation).
    #[default]
    Renderer,
    /// Single rays.
    Single,
    /// Coherent packets of 4, in the order of the batch.
    Four,
    /// Coherent packets of 8, in the order of the batch.
    Eight,
    /// Coherent packets of 16, in the order of the batch.
    Sixteen,
}
