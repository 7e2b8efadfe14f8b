//! Non-negative least squares for a handful of unknowns.
//!
//! Minimises ½ xᵀ G x − bᵀ x over x ≥ 0, G = MᵀM, b = Mᵀt: the active set method of
//! Lawson & Hanson (1974, chapter 23) on the normal equations. Generic over the number
//! type because the tables are fitted in double precision when the crate is built and
//! measured structure functions in single precision on board.
//!
//! Cost: at most 3 n rounds of a Cholesky factorisation of order n ≤ [`MAX`].
//! A library's solver would bring a heap and a matrix crate for 13 unknowns.

use core::ops::{Add, Div, Mul, Sub};

/// Most unknowns.
pub const MAX: usize = 13;

/// What the solver asks of a number.
pub trait Real:
    Copy
    + PartialOrd
    + From<u8>
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
{
}
impl Real for f32 {}
impl Real for f64 {}

/// The minimiser over the first `n` unknowns; the others are 0.
pub fn solve<T: Real>(gram: &[[T; MAX]; MAX], right: &[T; MAX], n: usize) -> [T; MAX] {
    let zero = T::from(0);
    let mut x = [zero; MAX];
    let mut free = [false; MAX];
    for _ in 0..3 * n {
        let Some(best) = steepest(gram, right, &x, &free, n) else {
            break;
        };
        free[best] = true;
        let mut trial = unconstrained(gram, right, &free, n);
        while (0..n).any(|i| free[i] && trial[i] <= zero) {
            retreat(&mut x, &trial, &mut free, n);
            trial = unconstrained(gram, right, &free, n);
        }
        x = trial;
    }
    x
}

/// The unknown at 0 whose release gains most, relative to its column's length.
fn steepest<T: Real>(
    gram: &[[T; MAX]; MAX],
    right: &[T; MAX],
    x: &[T; MAX],
    free: &[bool; MAX],
    n: usize,
) -> Option<usize> {
    let zero = T::from(0);
    let tolerance = T::from(1) / (T::from(100) * T::from(100) * T::from(100));
    let mut best = None;
    let mut most = zero;
    for i in (0..n).filter(|&i| !free[i] && gram[i][i] > zero) {
        let push = (0..n).fold(right[i], |sum, j| sum - gram[i][j] * x[j]);
        if push > tolerance * right[i] && push * push > most * gram[i][i] {
            most = push * push / gram[i][i];
            best = Some(i);
        }
    }
    best
}

/// Least squares over the free unknowns (Cholesky, then two triangular solves).
fn unconstrained<T: Real>(
    gram: &[[T; MAX]; MAX],
    right: &[T; MAX],
    free: &[bool; MAX],
    n: usize,
) -> [T; MAX] {
    let zero = T::from(0);
    let (mut low, mut x) = ([[zero; MAX]; MAX], [zero; MAX]);
    // LDLᵀ needs no square root
    for i in (0..n).filter(|&i| free[i]) {
        for j in (0..=i).filter(|&j| free[j]) {
            let sum = (0..j)
                .filter(|&k| free[k])
                .fold(gram[i][j], |sum, k| sum - low[i][k] * low[j][k] * low[k][k]);
            low[i][j] = if i == j { sum } else { sum / low[j][j] };
        }
        x[i] = (0..i).fold(right[i], |sum, k| sum - low[i][k] * x[k]);
    }
    for i in (0..n).rev().filter(|&i| free[i]) {
        x[i] = x[i] / low[i][i];
        x[i] = (i + 1..n).fold(x[i], |sum, k| sum - low[k][i] * x[k]);
    }
    x
}

/// Goes from `x` towards `trial` until the first free unknown reaches 0, and fixes it.
fn retreat<T: Real>(x: &mut [T; MAX], trial: &[T; MAX], free: &mut [bool; MAX], n: usize) {
    let zero = T::from(0);
    let (mut step, mut first) = (T::from(1), 0);
    for i in (0..n).filter(|&i| free[i] && trial[i] <= zero) {
        let here = x[i] / (x[i] - trial[i]);
        // x = trial = 0 gives NaN: the step is 0
        let here = if here >= zero { here } else { zero };
        if here <= step {
            (step, first) = (here, i);
        }
    }
    for i in (0..n).filter(|&i| free[i]) {
        x[i] = x[i] + step * (trial[i] - x[i]);
    }
    x[first] = zero;
    free[first] = false;
}
