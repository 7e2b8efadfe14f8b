//! Tables of the surface, and their derivative by the parameters.
//!
//! A table of depth p has (3^p + 1)² samples; depth p + 1 is one subdivision of it and
//! contains it: decimating by three gives back the coarser table exactly. O(samples).
//!
//! The Jacobian is propagated with the table: a row is the same combination of its sources'
//! rows, plus (source − first source) in the columns of the point's own weights.

use super::stencil::{COARSE, FINE, Stencil, turned};
use super::{Ifs, Variant};
use alloc::{vec, vec::Vec};

/// Samples per side at depth p: 3^p + 1.
///
/// ```
/// use rugosa_fractal::surfaces::ifs::side_of;
/// assert_eq!([1, 2, 3, 4].map(side_of), [4, 10, 28, 82]);
/// ```
pub fn side_of(depth: u32) -> usize {
    3usize.pow(depth) + 1
}

/// The depth whose tables have this side; `None` if there is none.
///
/// ```
/// use rugosa_fractal::surfaces::ifs::depth_of;
/// assert_eq!([28, 82, 64].map(depth_of), [Some(3), Some(4), None]);
/// ```
pub fn depth_of(side: usize) -> Option<u32> {
    (1..12).find(|&depth| side_of(depth) == side)
}

/// Where the points of a patch lie in the whole grid.
pub(super) struct Patch {
    variant: Variant,
    u: usize,
    v: usize,
}

impl Patch {
    /// All patches of a grid of this side.
    pub fn all(variant: Variant, side: usize) -> impl Iterator<Item = Patch> {
        let count = (side - 1) / 3;
        (0..count * count).map(move |i| Patch {
            variant,
            u: i / count,
            v: i % count,
        })
    }

    /// Index of point i of the 4 × 4 patch in a grid of this side.
    #[inline]
    pub fn coarse(&self, i: usize, side: usize) -> usize {
        let row = 3 * self.u + turned(self.variant, self.u, i / COARSE, 3);
        row * side + 3 * self.v + turned(self.variant, self.v, i % COARSE, 3)
    }

    /// Index of point i of the 10 × 10 patch in the grid of the next depth.
    #[inline]
    pub fn fine(&self, i: usize, side: usize) -> usize {
        let row = 9 * self.u + turned(self.variant, self.u, i / FINE, 9);
        row * side + 9 * self.v + turned(self.variant, self.v, i % FINE, 9)
    }

    /// Is point i of the 10 × 10 patch shared with how many patches: 1, ½ or ¼.
    pub fn share(&self, i: usize, side: usize) -> f64 {
        let last = 3 * (side - 1);
        let half = |at: usize| {
            if at.is_multiple_of(9) && at != 0 && at != last {
                0.5
            } else {
                1.0
            }
        };
        let row = 9 * self.u + turned(self.variant, self.u, i / FINE, 9);
        half(row) * half(9 * self.v + turned(self.variant, self.v, i % FINE, 9))
    }

    /// The heights of its 16 points.
    pub fn heights(&self, grid: &[f64], side: usize) -> [f64; 16] {
        core::array::from_fn(|i| grid[self.coarse(i, side)])
    }
}

impl Ifs {
    /// The table of depth p ≥ 1, (3^p + 1)² heights, row by row.
    ///
    /// ```
    /// use rugosa_fractal::surfaces::ifs::{Ifs, Variant, side_of};
    /// let ifs = Ifs::bilinear(Variant::Tied, &core::array::from_fn(|i| (i * i % 11) as f64));
    /// let (coarse, fine) = (ifs.tabulate(2), ifs.tabulate(3));
    /// assert_eq!((coarse.len(), fine.len()), (side_of(2).pow(2), side_of(3).pow(2)));
    /// // every third height of the finer table is the coarser one
    /// assert!((0..100).all(|i| coarse[i] == fine[i / 10 * 3 * 28 + i % 10 * 3]));
    /// ```
    pub fn tabulate(&self, depth: u32) -> Vec<f64> {
        let stencil = Stencil::new(self.variant);
        let mut grid = self.parameters[..16].to_vec();
        for level in 1..depth {
            grid = subdivide(&stencil, &self.parameters, &grid, side_of(level));
        }
        grid
    }

    /// The table of depth p and its Jacobian, one row of `parameters` per sample.
    ///
    /// ```
    /// use rugosa_fractal::surfaces::ifs::{Ifs, Variant};
    /// let ifs = Ifs::bilinear(Variant::Tied, &core::array::from_fn(|i| (i * i % 11) as f64));
    /// let (table, rows) = ifs.jacobian(2);
    /// assert_eq!(table, ifs.tabulate(2));
    /// // sample 1 lies a third of the way from the first control height to the second
    /// let row = &rows[232..2 * 232];
    /// assert!((row[0] - 2.0 / 3.0).abs() < 1e-12 && (row[1] - 1.0 / 3.0).abs() < 1e-12);
    /// ```
    pub fn jacobian(&self, depth: u32) -> (Vec<f64>, Vec<f64>) {
        let stencil = Stencil::new(self.variant);
        let count = self.parameters.len();
        let mut grid = self.parameters[..16].to_vec();
        let mut rows = vec![0.0; 16 * count];
        (0..16).for_each(|i| rows[i * count + i] = 1.0);
        for level in 1..depth {
            let side = side_of(level);
            rows = subdivide_rows(&stencil, &self.parameters, (&grid, &rows), side);
            grid = subdivide(&stencil, &self.parameters, &grid, side);
        }
        (grid, rows)
    }
}

/// One subdivision of a table of this side.
pub(super) fn subdivide(
    stencil: &Stencil,
    parameters: &[f64],
    grid: &[f64],
    side: usize,
) -> Vec<f64> {
    let fine = 3 * side - 2;
    let mut out = vec![0.0; fine * fine];
    for patch in Patch::all(stencil.variant, side) {
        let z = patch.heights(grid, side);
        for point in &stencil.points {
            let first = z[point.sources[0]];
            let mut height = first;
            if point.weight > 0 {
                for c in 1..4 {
                    height += parameters[point.weight + c - 1] * (z[point.sources[c]] - first);
                }
            }
            out[patch.fine(point.target, fine)] = height;
        }
    }
    out
}

/// One subdivision of the Jacobian's rows.
fn subdivide_rows(
    stencil: &Stencil,
    parameters: &[f64],
    (grid, rows): (&[f64], &[f64]),
    side: usize,
) -> Vec<f64> {
    let (fine, count) = (3 * side - 2, parameters.len());
    let mut out = vec![0.0; fine * fine * count];
    for patch in Patch::all(stencil.variant, side) {
        let z = patch.heights(grid, side);
        let row = |i: usize| &rows[patch.coarse(i, side) * count..][..count];
        for point in &stencil.points {
            let target = &mut out[patch.fine(point.target, fine) * count..][..count];
            combine(
                target,
                point.sources.map(row),
                Stencil::weights(point, parameters),
            );
            if point.weight > 0 {
                for c in 1..4 {
                    target[point.weight + c - 1] += z[point.sources[c]] - z[point.sources[0]];
                }
            }
        }
    }
    out
}

fn combine(target: &mut [f64], rows: [&[f64]; 4], weights: [f64; 4]) {
    if weights[1..] == [0.0; 3] {
        target.copy_from_slice(rows[0]);
        return;
    }
    for (i, t) in target.iter_mut().enumerate() {
        *t = weights[0] * rows[0][i]
            + weights[1] * rows[1][i]
            + weights[2] * rows[2][i]
            + weights[3] * rows[3][i];
    }
}
