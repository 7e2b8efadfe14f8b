//! Smooth values for unknown cells, so that they cost the coder nothing.
//!
//! Upwards: on ever coarser lattices an unknown node becomes the mean of its known
//! neighbours. Downwards: what is still unknown becomes the mean of its neighbours on the
//! next coarser lattice. In place, without a copy. The values are never seen: the decoder
//! puts the unknown cells back.

use crate::surfaces::Shape;

/// Marks an unknown cell.
pub(super) const UNKNOWN: i32 = i32::MIN;

/// Replaces every [`UNKNOWN`]; all become 0 if nothing is known.
pub(super) fn fill(grid: &mut [i32], shape: Shape) {
    let mut step = 1;
    while step < shape.rows.max(shape.columns) {
        each(grid, shape, 2 * step, step);
        step *= 2;
    }
    let first = &mut grid[0];
    *first = if *first == UNKNOWN { 0 } else { *first };
    while step > 1 {
        step /= 2;
        // once for the nodes between two coarser ones, once for the centres
        each(grid, shape, step, step);
        each(grid, shape, step, step);
    }
    grid.iter_mut()
        .filter(|z| **z == UNKNOWN)
        .for_each(|z| *z = 0);
}

/// Every unknown node of the lattice `by` becomes the mean of its neighbours at `reach`.
fn each(grid: &mut [i32], shape: Shape, by: usize, reach: usize) {
    for row in (0..shape.rows).step_by(by) {
        for column in (0..shape.columns).step_by(by) {
            let index = row * shape.columns + column;
            if grid[index] == UNKNOWN
                && let Some(mean) = mean(grid, shape, (row, column), reach)
            {
                grid[index] = mean;
            }
        }
    }
}

fn mean(grid: &[i32], shape: Shape, (row, column): (usize, usize), reach: usize) -> Option<i32> {
    let (mut sum, mut count) = (0i64, 0);
    for down in [0, reach, 2 * reach] {
        for right in [0, reach, 2 * reach] {
            let (r, c) = (
                (row + down).wrapping_sub(reach),
                (column + right).wrapping_sub(reach),
            );
            if r < shape.rows && c < shape.columns && grid[r * shape.columns + c] != UNKNOWN {
                sum += i64::from(grid[r * shape.columns + c]);
                count += 1;
            }
        }
    }
    (count > 0).then(|| (sum / count) as i32)
}
