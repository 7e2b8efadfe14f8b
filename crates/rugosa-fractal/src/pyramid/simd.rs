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
    let ((a, rest_a), (b, rest_b)) = (a.as_chunks(), b.as_chunks());
    let blocks = a.iter().zip(b);
    let lanes = blocks.fold([0.0; LANES], |lanes, (x, y)| add(lanes, x, y));
    total(lanes, rest_a, rest_b)
}

/// x += a y.
#[inline(always)]
pub(crate) fn add_scaled(x: &mut [f32], a: f32, y: &[f32]) {
    let ((x, rest_x), (y, rest_y)) = (x.as_chunks_mut::<4>(), y.as_chunks::<4>());
    for (x, y) in x.iter_mut().zip(y) {
        *x = [
            x[0] + a * y[0],
            x[1] + a * y[1],
            x[2] + a * y[2],
            x[3] + a * y[3],
        ];
    }
    for (x, y) in rest_x.iter_mut().zip(rest_y) {
        *x += a * y;
    }
}

/// x = a x + y.
#[inline(always)]
pub(crate) fn scale_add(x: &mut [f32], a: f32, y: &[f32]) {
    let ((x, rest_x), (y, rest_y)) = (x.as_chunks_mut::<4>(), y.as_chunks::<4>());
    for (x, y) in x.iter_mut().zip(y) {
        *x = [
            a * x[0] + y[0],
            a * x[1] + y[1],
            a * x[2] + y[2],
            a * x[3] + y[3],
        ];
    }
    for (x, y) in rest_x.iter_mut().zip(rest_y) {
        *x = a * *x + y;
    }
}

/// z = z s + p; returns Σ p_i z_i as [`dot`] does.
#[inline(always)]
pub(crate) fn scale_add_dot(z: &mut [f32], s: &[f32], p: &[f32]) -> f32 {
    let ((z, rest_z), (s, rest_s)) = (z.as_chunks_mut::<LANES>(), s.as_chunks::<LANES>());
    let (p, rest_p) = p.as_chunks::<LANES>();
    let mut lanes = [0.0; LANES];
    for ((z, s), p) in z.iter_mut().zip(s).zip(p) {
        *z = [
            z[0] * s[0] + p[0],
            z[1] * s[1] + p[1],
            z[2] * s[2] + p[2],
            z[3] * s[3] + p[3],
            z[4] * s[4] + p[4],
            z[5] * s[5] + p[5],
            z[6] * s[6] + p[6],
            z[7] * s[7] + p[7],
        ];
        lanes = add(lanes, z, p);
    }
    for ((z, s), p) in rest_z.iter_mut().zip(rest_s).zip(rest_p) {
        *z = *z * s + p;
    }
    total(lanes, rest_z, rest_p)
}

/// Lanes and products: written out, as a loop would keep the lanes in memory where the
/// compiler saves space.
#[inline(always)]
fn add(l: [f32; LANES], x: &[f32; LANES], y: &[f32; LANES]) -> [f32; LANES] {
    [
        l[0] + x[0] * y[0],
        l[1] + x[1] * y[1],
        l[2] + x[2] * y[2],
        l[3] + x[3] * y[3],
        l[4] + x[4] * y[4],
        l[5] + x[5] * y[5],
        l[6] + x[6] * y[6],
        l[7] + x[7] * y[7],
    ]
}

/// The lanes' sum, with the products of fewer than a block.
#[inline(always)]
fn total(mut lanes: [f32; LANES], x: &[f32], y: &[f32]) -> f32 {
    for ((l, x), y) in lanes.iter_mut().zip(x).zip(y) {
        *l += x * y;
    }
    let [a, b, c, d, e, f, g, h] = lanes;
    ((a + e) + (c + g)) + ((b + f) + (d + h))
}
