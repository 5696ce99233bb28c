//! Flush-to-zero and denormals-are-zero, as Embree wants them on every thread that traces.

/// MXCSR's flush-to-zero and denormals-are-zero.
const FLUSH: u32 = 1 << 15 | 1 << 6;

fn mxcsr() -> u32 {
    let mut value = 0;
    // SAFETY: stores a register of every x86-64 into a local variable.
    unsafe { std::arch::asm!("stmxcsr [{}]", in(reg) &raw mut value, options(nostack, preserves_flags)) };
    value
}

fn set_mxcsr(value: u32) {
    // SAFETY: `value` is what was read, but for the two flush bits: no exception gets unmasked, the rounding stays.
    unsafe { std::arch::asm!("ldmxcsr [{}]", in(reg) &raw const value, options(nostack, preserves_flags, readonly)) };
}

/// Makes arithmetic of the calling thread flush denormals to zero from now on, as Embree wants it on every thread
/// that traces. To be called where threads start; queries on a thread without it set and reset it for each batch.
pub fn set_flush_to_zero() {
    set_mxcsr(mxcsr() | FLUSH);
}

/// Flush-to-zero until dropped.
pub(super) struct FlushToZero {
    before: u32,
}

impl FlushToZero {
    pub(super) fn new() -> Self {
        let before = mxcsr();
        if before & FLUSH != FLUSH {
            set_mxcsr(before | FLUSH);
        }
        Self { before }
    }
}

impl Drop for FlushToZero {
    fn drop(&mut self) {
        if self.before & FLUSH != FLUSH {
            set_mxcsr(self.before);
        }
    }
}
