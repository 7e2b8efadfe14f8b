//! Robust scaling range: a line that is continued by a polynomial, or not.
//!
//! Models: a line on all n points; or a line on the points 1 … k joined continuously to a
//! polynomial of degree m = 1, 2, 3 on k … n (basis 1, min(x, x_k) − x_k, (x − x_k)₊^q),
//! with k from 4 to n − m − 2 so that the tail keeps two surplus points. For each m the k
//! of least residual is taken (ties: the largest); among the models the one of least
//!
//!   BIC = n ln max(rss / n, tolerance²) + p ln n,   p = 2 or 3 + m.
//!
//! The tolerance makes this a practical, not a statistical, significance: errors of
//! neighbouring lags are correlated, and a bend of less than 2 % is of no interest. For a
//! smooth crossover the range *is* a matter of the tolerance. Fewer than seven points: all.
//!
//! The join and the BIC are what keeps this from inventing a break on a noisy line, as
//! [`fang`](super::fang()) does. Cost: 3 n regressions on at most 5 columns.

use super::least_squares::{line, power, solve};

const LEAST_LINE: usize = 4;
const SURPLUS: usize = 2;

/// One line of the BIC table.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Candidate {
    /// degree of the continuation; 0: line only
    pub degree: usize,
    /// points on the line
    pub points: usize,
    /// residual sum of squares
    pub rss: f64,
    /// Bayesian information criterion, least is best
    pub bic: f64,
}

/// The chosen model and all that were compared.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Robust {
    /// points on the line, from the first on
    pub points: usize,
    /// degree of the continuation; 0: line only
    pub degree: usize,
    /// BIC table by degree; `None` where the curve is too short for it
    pub table: [Option<Candidate>; 4],
}

/// The robust range of a curve of at least two points.
///
/// ```
/// use rugosa_fractal::roughness::scaling_range::robust;
/// let x: Vec<f64> = (0..16).map(f64::from).collect();
/// let broken: Vec<f64> = x.iter().map(|&x| 0.6 * x.min(7.0)).collect();
/// let found = robust(&x, &broken, 0.02);
/// assert_eq!((found.points, found.degree), (8, 1)); // then a line of another slope
/// // a line that zigzags by 0.1 is still one line
/// let zigzag = |x: f64| 0.6 * x + 0.1 * (std::f64::consts::PI * x).cos();
/// let line: Vec<f64> = x.iter().copied().map(zigzag).collect();
/// let found = robust(&x, &line, 0.02);
/// assert_eq!((found.points, found.degree), (16, 0));
/// ```
pub fn robust(x: &[f64], y: &[f64], tolerance: f64) -> Robust {
    let n = x.len();
    let bic = |rss: f64, parameters: f64| {
        let n = n as f64;
        n * libm::log((rss / n).max(tolerance * tolerance)) + parameters * libm::log(n)
    };
    let rss = line(x, y).rss;
    let whole = Candidate {
        degree: 0,
        points: n,
        rss,
        bic: bic(rss, 2.0),
    };
    let mut table = [Some(whole), None, None, None];
    for (degree, entry) in table.iter_mut().enumerate().skip(1) {
        *entry = best_join(x, y, degree).map(|(points, rss)| Candidate {
            degree,
            points,
            rss,
            bic: bic(rss, 3.0 + degree as f64),
        });
    }
    let least = |a: Candidate, b: Candidate| if b.bic < a.bic { b } else { a };
    let best = table.iter().flatten().copied().fold(whole, least);
    Robust {
        points: best.points,
        degree: best.degree,
        table,
    }
}

/// The number of points on the line and the residual of the best joined model.
fn best_join(x: &[f64], y: &[f64], degree: usize) -> Option<(usize, f64)> {
    let n = x.len();
    if n < LEAST_LINE + 1 + SURPLUS {
        return None;
    }
    let mut best: Option<(usize, f64)> = None;
    for k in LEAST_LINE..=n.saturating_sub(degree + SURPLUS) {
        let rss = joined_rss(x, y, x[k - 1], degree);
        if best.is_none_or(|(_, least)| rss <= least * (1.0 + 1e-12)) {
            best = Some((k, rss));
        }
    }
    best
}

fn joined_rss(x: &[f64], y: &[f64], join: f64, degree: usize) -> f64 {
    let basis = |column, row: usize| match column {
        0 => 1.0,
        1 => x[row].min(join) - join,
        _ => power((x[row] - join).max(0.0), column - 1),
    };
    solve(degree + 2, y, basis).rss
}
