//! Packed vectors ↔ surfaces: the model u = Σ P_l (s_l ∘ w_l) + plane and its transpose.

use super::{
    refine::{refine, restrict},
    shape::{PLANE, Shape},
};

/// The coarser levels' surface on the nodes of `level`, without that level's own noise,
/// left in `u`'s level. `s` holds the levels' deviations, `w` the numbers.
#[cfg_attr(feature = "simd", inline(always))]
pub(super) fn expand(shape: &Shape, s: &[f32], w: &[f32], u: &mut [f32], level: usize) {
    plane(shape, s, w, &mut u[Shape::level(0)]);
    add_noise(s, w, u, 0);
    for l in 1..=level {
        rise(u, l);
        if l < level {
            add_noise(s, w, u, l);
        }
    }
}

/// The plane on the nodes of level 0; refinement reproduces it exactly.
#[inline(always)]
fn plane(shape: &Shape, s: &[f32], w: &[f32], u: &mut [f32]) {
    let (sx, sy, mean) = (s[0] * w[0], s[1] * w[1], s[2] * w[2]);
    let (first, step) = coordinates(shape);
    for (y, row) in u.chunks_exact_mut(Shape::size(0)).enumerate() {
        let height = mean + sy * (first + step * y as f32);
        for (x, v) in row.iter_mut().enumerate() {
            *v = height + sx * (first + step * x as f32);
        }
    }
}

/// Refines level `l` − 1 of a packed vector into level `l`.
#[cfg_attr(feature = "simd", inline(always))]
pub(super) fn rise(u: &mut [f32], l: usize) {
    let (low, high) = u.split_at_mut(Shape::start(l));
    let n = Shape::size(l);
    refine(
        &low[Shape::start(l - 1)..],
        Shape::size(l - 1),
        &mut high[..n * n],
    );
}

/// u += s ∘ w on level `l`.
#[inline(always)]
pub(super) fn add_noise(s: &[f32], w: &[f32], u: &mut [f32], l: usize) {
    let at = Shape::level(l);
    for ((u, s), w) in u[at.clone()].iter_mut().zip(&s[at.clone()]).zip(&w[at]) {
        *u += s * w;
    }
}

/// Transpose of [`expand`] followed by noise on its levels: `g` holds a gradient on the
/// nodes of `level` and becomes, in place, the gradient of the packed numbers up to and
/// including that level. `rows` lends three rows.
#[cfg_attr(feature = "simd", inline(always))]
pub(super) fn gather(shape: &Shape, s: &[f32], g: &mut [f32], level: usize, rows: &mut [f32]) {
    descend(shape, g, level, rows);
    for (g, s) in g.iter_mut().zip(&s[..Shape::start(level + 1)]) {
        *g *= s;
    }
}

/// The same before the deviations are multiplied in.
#[cfg_attr(feature = "simd", inline(always))]
pub(super) fn descend(shape: &Shape, g: &mut [f32], level: usize, rows: &mut [f32]) {
    for l in (1..=level).rev() {
        fall(g, l, rows);
    }
    let (x, y, sum) = moments(shape, &g[Shape::level(0)]);
    g[..PLANE].copy_from_slice(&[x, y, sum]);
}

/// Restricts level `l` of a packed vector into level `l` − 1.
#[cfg_attr(feature = "simd", inline(always))]
pub(super) fn fall(g: &mut [f32], l: usize, rows: &mut [f32]) {
    let (low, high) = g.split_at_mut(Shape::start(l));
    let (n, m) = (Shape::size(l - 1), Shape::size(l));
    restrict(&high[..m * m], n, rows, &mut low[Shape::start(l - 1)..]);
}

/// Σ g x, Σ g y, Σ g over the nodes of level 0, coordinates in cells from the middle.
#[inline(always)]
fn moments(shape: &Shape, g: &[f32]) -> (f32, f32, f32) {
    let (first, step) = coordinates(shape);
    let (mut gx, mut gy, mut sum) = (0.0, 0.0, 0.0);
    for (y, row) in g.chunks_exact(Shape::size(0)).enumerate() {
        let mut whole = 0.0;
        for (x, g) in row.iter().enumerate() {
            whole += g;
            gx += g * (first + step * x as f32);
        }
        gy += whole * (first + step * y as f32);
        sum += whole;
    }
    (gx, gy, sum)
}

/// Coordinate of level 0's first (ghost) node and the spacing, in cells from the middle.
#[inline(always)]
fn coordinates(shape: &Shape) -> (f32, f32) {
    let half = (shape.side - 1) as f32 * 0.5;
    (-2.0 * half, half)
}
