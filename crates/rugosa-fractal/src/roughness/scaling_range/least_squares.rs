//! Least squares on a few columns by modified Gram–Schmidt, without a heap.
//!
//! Numerically as good as Householder for the residual, which is what the scaling range
//! compares; up to [`MOST_COLUMNS`] columns and [`MOST_LAGS`] rows.

use super::MOST_LAGS;

pub(super) const MOST_COLUMNS: usize = 5;

/// Coefficients and residual sum of squares.
pub(super) struct Solution {
    pub coefficients: [f64; MOST_COLUMNS],
    pub rss: f64,
}

/// Regression of `y` on the columns `basis(column, row)`.
pub(super) fn solve(columns: usize, y: &[f64], basis: impl Fn(usize, usize) -> f64) -> Solution {
    let mut q = [[0.0; MOST_LAGS]; MOST_COLUMNS];
    let mut r = [[0.0; MOST_COLUMNS]; MOST_COLUMNS];
    let mut residual = [0.0; MOST_LAGS];
    residual[..y.len()].copy_from_slice(y);
    let mut projections = [0.0; MOST_COLUMNS];
    for k in 0..columns {
        let (done, rest) = q.split_at_mut(k);
        let column = &mut rest[0][..y.len()];
        column
            .iter_mut()
            .enumerate()
            .for_each(|(row, v)| *v = basis(k, row));
        for (j, earlier) in done.iter().enumerate() {
            r[j][k] = dot(earlier, column);
            subtract(column, r[j][k], earlier);
        }
        r[k][k] = libm::sqrt(dot(column, column));
        let scale = if r[k][k] > 0.0 { 1.0 / r[k][k] } else { 0.0 };
        column.iter_mut().for_each(|v| *v *= scale);
        projections[k] = dot(column, &residual);
        subtract(&mut residual[..y.len()], projections[k], column);
    }
    Solution {
        coefficients: back_substitute(columns, &r, &projections),
        rss: dot(&residual[..y.len()], &residual),
    }
}

/// The line y = c₀ + c₁ x.
pub(super) fn line(x: &[f64], y: &[f64]) -> Solution {
    solve(2, y, |column, row| if column == 0 { 1.0 } else { x[row] })
}

/// Residual sum of squares of a polynomial of this degree, abscissae scaled to ±1.
pub(super) fn polynomial_rss(x: &[f64], y: &[f64], degree: usize) -> f64 {
    let mean = x.iter().sum::<f64>() / x.len() as f64;
    let half = (x[x.len() - 1] - x[0]).max(1e-12) / 2.0;
    solve(degree + 1, y, |column, row| {
        power((x[row] - mean) / half, column)
    })
    .rss
}

pub(super) fn power(base: f64, exponent: usize) -> f64 {
    (0..exponent).fold(1.0, |product, _| product * base)
}

fn back_substitute(
    columns: usize,
    r: &[[f64; MOST_COLUMNS]; MOST_COLUMNS],
    projections: &[f64; MOST_COLUMNS],
) -> [f64; MOST_COLUMNS] {
    let mut solution = [0.0; MOST_COLUMNS];
    for k in (0..columns).rev() {
        let known: f64 = (k + 1..columns).map(|j| r[k][j] * solution[j]).sum();
        solution[k] = if r[k][k] > 0.0 {
            (projections[k] - known) / r[k][k]
        } else {
            0.0
        };
    }
    solution
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn subtract(from: &mut [f64], factor: f64, column: &[f64]) {
    from.iter_mut()
        .zip(column)
        .for_each(|(v, c)| *v -= factor * c);
}
