//! Scaling range of Fang et al. 2004, equations 6–9: line, then polynomial.
//!
//! For each order m = 1, 2, 3: n*_m = argmin over k of δ₁ (line on the points 1 … k) + δ₂
//! (polynomial of order m on k … n), residual sums of squares; n* = the largest of the
//! three. The line and the polynomial are fitted apart.
//!
//! Literally, δ₁ = 0 for k = 2 and δ₂ = 0 where the tail has no more than m + 1 points,
//! so on short noisy curves a third of the choices are degenerate; `guarded` demands four
//! points on the line and m + 2 in the tail (or none). On an exact line every δ is
//! rounding, so values within 1e-9 (relative) of the least, or 1e-24, count as equal and
//! the largest k is taken.

use super::least_squares::{line, polynomial_rss};

/// The choice for each order of the polynomial and the largest of them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Fang {
    /// n*
    pub points: usize,
    /// n*_m for m = 1, 2, 3
    pub by_order: [usize; 3],
}

/// Fang's range of a curve of at least two points.
///
/// ```
/// use rugosa_fractal::roughness::scaling_range::fang;
/// // a line of eight points that ends in a level one
/// let x: Vec<f64> = (0..16).map(f64::from).collect();
/// let y: Vec<f64> = x.iter().map(|&x| 0.6 * x.min(7.0)).collect();
/// assert_eq!(fang(&x, &y, true).by_order[0], 8);
/// ```
pub fn fang(x: &[f64], y: &[f64], guarded: bool) -> Fang {
    let by_order = [1, 2, 3].map(|order| best(x, y, order, guarded));
    Fang {
        points: by_order.into_iter().max().unwrap_or(x.len()),
        by_order,
    }
}

fn best(x: &[f64], y: &[f64], order: usize, guarded: bool) -> usize {
    let n = x.len();
    let allowed = |k: usize| !guarded || (k >= 4 && (n - k + 1 >= order + 2 || k == n));
    let costs = || {
        (2..=n)
            .filter(|&k| allowed(k))
            .map(|k| (k, cost(x, y, k, order)))
    };
    let least = costs().fold(f64::INFINITY, |least, (_, cost)| least.min(cost));
    let tied = |cost: f64| cost <= least * (1.0 + 1e-9) + 1e-24;
    costs()
        .filter(|&(_, cost)| tied(cost))
        .map(|(k, _)| k)
        .next_back()
        .unwrap_or(n)
}

fn cost(x: &[f64], y: &[f64], k: usize, order: usize) -> f64 {
    let head = line(&x[..k], &y[..k]).rss;
    let tail = x.len() - k + 1;
    head + if tail > order + 1 {
        polynomial_rss(&x[k - 1..], &y[k - 1..], order)
    } else {
        0.0
    }
}
