//! Run-time choice of vector instructions.
//!
//! With the feature `simd` the loops of the solver are compiled a second time for wider
//! registers and chosen when run. They contain no fused and no reordered operation, so
//! the bits do not depend on the choice; `the_same_bits_for_ever` in
//! `synthesis::pyramid` is to be run with and without the feature.

/// Runs `f` with the widest vectors the processor has.
#[inline(always)]
pub(crate) fn widest<R>(f: impl FnOnce() -> R) -> R {
    #[cfg(feature = "simd")]
    return pulp::Arch::new().dispatch(f);
    #[cfg(not(feature = "simd"))]
    f()
}

/// Partial sums of a dot product.
const LANES: usize = 8;

/// Σ a_i b_i in a fixed order: eight interleaved partial sums, then their sum in pairs.
#[inline(always)]
pub(crate) fn dot(a: &[f32], b: &[f32]) -> f32 {
    let mut lane = [0f32; LANES];
    let (mut x, mut y) = (a.chunks_exact(LANES), b.chunks_exact(LANES));
    for (x, y) in (&mut x).zip(&mut y) {
        for ((l, x), y) in lane.iter_mut().zip(x).zip(y) {
            *l += x * y;
        }
    }
    for ((l, x), y) in lane.iter_mut().zip(x.remainder()).zip(y.remainder()) {
        *l += x * y;
    }
    let [a, b, c, d, e, f, g, h] = lane;
    ((a + e) + (c + g)) + ((b + f) + (d + h))
}
