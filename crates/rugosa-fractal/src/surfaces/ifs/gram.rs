//! JᵀJ and Jᵀr of a fit, without ever forming the Jacobian of the finest table.
//!
//! The finest table is one subdivision of a table with a ninth of the samples, and the
//! subdivision is the same in every patch. With Q the 16 rows of the coarser Jacobian in a
//! patch, T the 100 × 16 combination and O the points' own weight columns, J = T Q + O and
//!
//! ```text
//! JᵀJ = Σ Qᵀ (TᵀT) Q  +  X + Xᵀ  +  OᵀO
//! ```
//!
//! - TᵀT depends on the patch only through which of its border points it shares (each shared
//!   point counts ½ per patch): 16 matrices, factored once as L Lᵀ, so the first term is a
//!   product of 16 rows instead of 81;
//! - X and OᵀO need, per group of points with the same four sources, the sums of
//!   Q_source (z_c − z_0) and of products of differences; the weights enter once at the end;
//! - Q is nearly empty (a sample knows few weights), so each patch works on the columns it
//!   has;
//! - Jᵀr is the transposed subdivision applied to the residual, level by level: O(samples).
//!
//! Rejected: rows of J stored sparsely and multiplied pair by pair, which does the work of
//! 81 scattered rows per patch.
//!
//! Accuracy: `structured_products_are_those_of_the_dense_jacobian`.

use super::Ifs;
use super::stencil::{FINE, Point, Stencil};
use super::tabulate::{Patch, side_of, subdivide};
use alloc::{vec, vec::Vec};
use nalgebra::{DMatrix, SMatrix};

type Small = SMatrix<f64, 16, 16>;

/// JᵀJ of the table of depth p ≥ 2.
pub(super) fn normal_matrix(ifs: &Ifs, depth: u32) -> DMatrix<f64> {
    let stencil = Stencil::new(ifs.variant());
    let (grid, rows) = ifs.jacobian(depth - 1);
    let mut sums = Sums::new(&stencil, ifs.parameters(), side_of(depth - 1));
    for patch in Patch::all(ifs.variant(), sums.side) {
        sums.add(&patch, &grid, &rows);
    }
    sums.finish()
}

/// What is summed over patches.
struct Sums<'a> {
    stencil: &'a Stencil,
    parameters: &'a [f64],
    side: usize,
    /// Cholesky factors of TᵀT, transposed, by pattern of shared borders
    factors: Vec<Option<Small>>,
    product: DMatrix<f64>,
    /// per class, first source and difference: Σ Q_source (z_c − z_0)
    crossed: Vec<f64>,
    /// per class: Σ (z_c − z_0)(z_d − z_0)
    squared: Vec<[[f64; 3]; 3]>,
}

impl<'a> Sums<'a> {
    fn new(stencil: &'a Stencil, parameters: &'a [f64], side: usize) -> Self {
        let count = parameters.len();
        Sums {
            stencil,
            parameters,
            side,
            factors: vec![None; 16],
            product: DMatrix::zeros(count, count),
            crossed: vec![0.0; stencil.classes.len() * 12 * count],
            squared: vec![[[0.0; 3]; 3]; stencil.classes.len()],
        }
    }

    fn add(&mut self, patch: &Patch, grid: &[f64], rows: &[f64]) {
        let count = self.parameters.len();
        let row = |i: usize| &rows[patch.coarse(i, self.side) * count..][..count];
        let columns: Vec<usize> = (0..count)
            .filter(|&j| (0..16).any(|i| row(i)[j] != 0.0))
            .collect();
        let width = columns.len();
        let mut dense = vec![0.0; 16 * width];
        for i in 0..16 {
            let from = row(i);
            for (to, &j) in dense[i * width..][..width].iter_mut().zip(&columns) {
                *to = from[j];
            }
        }
        self.add_product(patch, &columns, &dense);
        let heights = patch.heights(grid, self.side);
        for group in 0..self.stencil.groups.len() {
            self.add_group(
                group,
                self.share_of(patch, group),
                (&heights, &columns, &dense),
            );
        }
    }

    /// Qᵀ L Lᵀ Q on the patch's columns, upper triangle.
    fn add_product(&mut self, patch: &Patch, columns: &[usize], dense: &[f64]) {
        let width = columns.len();
        let factor = *self.factor(patch);
        let mut y = vec![0.0; 16 * width];
        for i in 0..16 {
            for k in 0..16 {
                let l = factor[(i, k)];
                if l != 0.0 {
                    let (to, from) = (&mut y[i * width..][..width], &dense[k * width..][..width]);
                    to.iter_mut().zip(from).for_each(|(t, f)| *t += l * f);
                }
            }
        }
        let mut line = vec![0.0; width];
        for a in 0..width {
            let line = &mut line[a..];
            line.fill(0.0);
            for k in 0..16 {
                let y = &y[k * width + a..][..width - a];
                let first = y[0];
                if first != 0.0 {
                    line.iter_mut().zip(y).for_each(|(t, v)| *t += first * v);
                }
            }
            let mut column = self.product.column_mut(columns[a]);
            line.iter()
                .zip(&columns[a..])
                .for_each(|(value, &b)| column[b] += value);
        }
    }

    /// Lᵀ of this patch's TᵀT.
    fn factor(&mut self, patch: &Patch) -> &Small {
        let shared = |i: usize| usize::from(patch.share(i, self.side) < 1.0);
        // the middles of the four sides tell which of them are shared
        let middle = FINE / 2;
        let sides = [
            middle,
            middle * FINE,
            middle * FINE + FINE - 1,
            (FINE - 1) * FINE + middle,
        ];
        let pattern = sides.iter().fold(0, |p, &i| 2 * p + shared(i));
        let (stencil, parameters, side) = (self.stencil, self.parameters, self.side);
        self.factors[pattern].get_or_insert_with(|| {
            let mut sum = Small::zeros();
            for point in &stencil.points {
                accumulate(&mut sum, point, parameters, patch.share(point.target, side));
            }
            // the copies alone make it positive definite; only NaN weights could fail
            sum.cholesky()
                .map_or_else(Small::zeros, |c| c.l().transpose())
        })
    }

    /// Share of a group's points with neighbouring patches (all alike).
    fn share_of(&self, patch: &Patch, group: usize) -> f64 {
        let point = self.stencil.points.iter().find(|p| p.group == group);
        point.map_or(1.0, |p| patch.share(p.target, self.side))
    }

    fn add_group(
        &mut self,
        group: usize,
        share: f64,
        (heights, columns, dense): (&[f64; 16], &[usize], &[f64]),
    ) {
        let (count, width) = (self.parameters.len(), columns.len());
        let group = self.stencil.groups[group];
        let z = group.sources.map(|s| heights[s]);
        for c in 0..3 {
            let difference = share * (z[c + 1] - z[0]);
            for (d, sum) in self.squared[group.class][c].iter_mut().enumerate() {
                *sum += difference * (z[d + 1] - z[0]);
            }
            for (k, &source) in group.sources.iter().enumerate() {
                let to = &mut self.crossed[((group.class * 3 + c) * 4 + k) * count..][..count];
                let from = &dense[source * width..][..width];
                columns
                    .iter()
                    .zip(from)
                    .for_each(|(&j, q)| to[j] += difference * q);
            }
        }
    }

    /// Adds X + Xᵀ + OᵀO and mirrors the triangle.
    fn finish(mut self) -> DMatrix<f64> {
        let count = self.parameters.len();
        self.product.fill_upper_triangle_with_lower_triangle();
        for (class, members) in self.stencil.classes.iter().enumerate() {
            for &weight in members {
                let w = &self.parameters[weight..weight + 3];
                let w = [1.0 - w[0] - w[1] - w[2], w[0], w[1], w[2]];
                for c in 0..3 {
                    for (k, w) in w.iter().enumerate() {
                        let sum = &self.crossed[((class * 3 + c) * 4 + k) * count..][..count];
                        for (j, value) in sum.iter().enumerate() {
                            self.product[(j, weight + c)] += w * value;
                            self.product[(weight + c, j)] += w * value;
                        }
                    }
                    for d in 0..3 {
                        self.product[(weight + c, weight + d)] += self.squared[class][c][d];
                    }
                }
            }
        }
        self.product
    }
}

fn accumulate(sum: &mut Small, point: &Point, parameters: &[f64], share: f64) {
    let w = Stencil::weights(point, parameters);
    for (a, &i) in point.sources.iter().enumerate() {
        for (b, &j) in point.sources.iter().enumerate() {
            sum[(i, j)] += share * w[a] * w[b];
        }
    }
}

/// Jᵀr for a residual on the table of depth p; `tables` are those of depth 1 … p.
pub(super) fn gradient(ifs: &Ifs, tables: &[Vec<f64>], residual: &[f64]) -> Vec<f64> {
    let stencil = Stencil::new(ifs.variant());
    let mut gradient = vec![0.0; ifs.parameters().len()];
    let mut adjoint = residual.to_vec();
    for grid in tables[..tables.len() - 1].iter().rev() {
        let side = integer_root(grid.len());
        let fine = 3 * side - 2;
        let mut coarse = vec![0.0; grid.len()];
        for patch in Patch::all(ifs.variant(), side) {
            let z = patch.heights(grid, side);
            for point in &stencil.points {
                let value =
                    adjoint[patch.fine(point.target, fine)] * patch.share(point.target, side);
                let weights = Stencil::weights(point, ifs.parameters());
                for (w, &source) in weights.iter().zip(&point.sources) {
                    coarse[patch.coarse(source, side)] += w * value;
                }
                if point.weight > 0 {
                    for c in 1..4 {
                        gradient[point.weight + c - 1] +=
                            value * (z[point.sources[c]] - z[point.sources[0]]);
                    }
                }
            }
        }
        adjoint = coarse;
    }
    gradient.iter_mut().zip(&adjoint).for_each(|(g, a)| *g += a);
    gradient
}

/// The tables of depth 1 … p.
pub(super) fn tables(ifs: &Ifs, depth: u32) -> Vec<Vec<f64>> {
    let stencil = Stencil::new(ifs.variant());
    let mut tables = vec![ifs.parameters()[..16].to_vec()];
    for level in 1..depth {
        let next = subdivide(
            &stencil,
            ifs.parameters(),
            &tables[level as usize - 1],
            side_of(level),
        );
        tables.push(next);
    }
    tables
}

fn integer_root(n: usize) -> usize {
    (1..).find(|k| k * k >= n).unwrap_or(n)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::surfaces::ifs::Variant;
    use nalgebra::DVector;

    #[test]
    fn structured_products_are_those_of_the_dense_jacobian() {
        for variant in [Variant::Tied, Variant::Mirrored] {
            let z = core::array::from_fn(|i| libm::sin(1.0 + i as f64));
            let mut ifs = Ifs::bilinear(variant, &z);
            for (q, p) in ifs.parameters.iter_mut().enumerate().skip(16) {
                *p += 0.1 * libm::sin(0.7 * q as f64);
            }
            for depth in [2, 3, 4] {
                let (grid, rows) = ifs.jacobian(depth);
                let j = DMatrix::from_row_slice(grid.len(), ifs.parameters.len(), &rows);
                let dense = j.tr_mul(&j);
                let error = (normal_matrix(&ifs, depth) - &dense).abs().max();
                assert!(
                    error < 1e-11 * dense.abs().max(),
                    "{variant:?} {depth}: {error}"
                );
                let r = DVector::from_fn(grid.len(), |i, _| libm::cos(1.3 * i as f64));
                let found = DVector::from_vec(gradient(&ifs, &tables(&ifs, depth), r.as_slice()));
                let error = (found - j.tr_mul(&r)).abs().max();
                assert!(error < 1e-10, "{variant:?} {depth}: gradient {error}");
            }
        }
    }
}
