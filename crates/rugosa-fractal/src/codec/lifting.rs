//! The wavelet: interpolating, four taps each way, in integers.
//!
//! Predict: an odd sample minus the cubic interpolation (−1 9 9 −1)/16 of its even
//! neighbours; update: an even sample plus (−1 9 9 −1)/32 of the new details, which makes it
//! a local mean (the 13/7 or "(4, 4)" filter of Calderbank, Daubechies, Sweldens & Yeo 1998).
//! Both round to integers, so the inverse gives back every bit, on any machine.
//! Rows, then columns; borders are mirrored. Level l works on every 2^(l−1)-th sample, in
//! place: what remains on every 2^l-th is the coarser map.
//!
//! Cost: 4 additions, 2 shifts and 2 multiplications by 9 per sample and direction.
//!
//! Chosen by measurement (257², ideal adaptive coder; Jacksboro / fBm D 2.3 at 2186 bytes):
//! (2, 2) "5/3" 36.0 / 39.7 dB, this one 37.0 / 40.1, CDF 9/7 36.8 / 40.1, which has
//! irrational taps.

use crate::surfaces::Shape;

/// Synthesis norm of a low-pass and of a high-pass coefficient of levels 1, 2, …, along one
/// axis; each further level has √2 times the norms. Rounded to 1/64.
const NORMS: [(u32, u32); 12] = [
    (82, 52),
    (115, 62),
    (162, 86),
    (229, 121),
    (324, 171),
    (458, 242),
    (648, 342),
    (916, 484),
    (1296, 685),
    (1833, 968),
    (2592, 1369),
    (3666, 1936),
];

/// Most levels.
pub(super) const MOST_LEVELS: u32 = NORMS.len() as u32;

/// Levels until the shorter side has two or three samples left.
pub(super) fn levels(shape: Shape) -> u32 {
    let side = shape.rows.min(shape.columns).max(2) - 1;
    side.ilog2().min(MOST_LEVELS)
}

/// 4096 × the norm of a coefficient of `level`: how much a unit of it weighs in the map.
pub(super) fn weight(level: u32, rows_high: bool, columns_high: bool) -> u64 {
    let (low, high) = NORMS[level as usize - 1];
    let of = |is_high| u64::from(if is_high { high } else { low });
    of(rows_high) * of(columns_high)
}

/// Heights → coefficients, in place.
pub(super) fn forward(grid: &mut [i32], shape: Shape, levels: u32) {
    for level in 0..levels {
        let step = 1 << level;
        for row in (0..shape.rows).step_by(step) {
            let line = Line {
                start: row * shape.columns,
                stride: step,
                count: on(shape.columns, step),
            };
            line.predict(grid, -1);
            line.update(grid, 1);
        }
        Columns::new(shape, step).lift(grid, [(1, 4, -1), (0, 5, 1)]);
    }
}

/// Coefficients → heights, in place, from level `levels` down to just above `last`.
pub(super) fn inverse(grid: &mut [i32], shape: Shape, levels: u32, last: u32) {
    for level in (last..levels).rev() {
        let step = 1 << level;
        Columns::new(shape, step).lift(grid, [(0, 5, -1), (1, 4, 1)]);
        for row in (0..shape.rows).step_by(step) {
            let line = Line {
                start: row * shape.columns,
                stride: step,
                count: on(shape.columns, step),
            };
            line.update(grid, -1);
            line.predict(grid, 1);
        }
    }
}

/// Samples on a lattice of spacing `step`.
pub(super) fn on(side: usize, step: usize) -> usize {
    (side - 1) / step + 1
}

/// (9 (b + c) − (a + d) + half) / 2^shift. Wrapping: only damaged data come near the ends.
#[inline]
fn interpolate(a: i32, b: i32, c: i32, d: i32, shift: u32) -> i32 {
    let inner = b.wrapping_add(c).wrapping_mul(9);
    inner
        .wrapping_sub(a.wrapping_add(d))
        .wrapping_add(1 << (shift - 1))
        >> shift
}

/// Index i − 3 … i + 3 mirrored into 0 … count − 1 (more than once if it must be).
#[inline]
fn mirrored(i: isize, count: usize) -> usize {
    let last = count as isize - 1;
    let mut i = i.abs();
    while i > last {
        i = (2 * last - i).abs();
    }
    i as usize
}

/// Samples of one row at a level.
struct Line {
    start: usize,
    stride: usize,
    count: usize,
}

impl Line {
    fn predict(&self, grid: &mut [i32], sign: i32) {
        self.lift(grid, (1, 4, sign));
    }

    fn update(&self, grid: &mut [i32], sign: i32) {
        self.lift(grid, (0, 5, sign));
    }

    /// Adds ± the interpolation to every second sample, from `first`.
    #[inline]
    fn lift(&self, grid: &mut [i32], (first, shift, sign): (usize, u32, i32)) {
        if self.count < 2 {
            return;
        }
        let grid = &mut grid[self.start..];
        let (stride, last) = (self.stride, self.count - 1);
        for i in (first..self.count).step_by(2) {
            let value = if i < 3 || i + 3 > last {
                let at = |d: isize| grid[mirrored(i as isize + d, self.count) * stride];
                interpolate(at(-3), at(-1), at(1), at(3), shift)
            } else if let (1, Some(&[a, _, b, _, c, _, d])) = (stride, grid[i - 3..].first_chunk())
            {
                // neighbours in memory: one check of bounds for all four
                interpolate(a, b, c, d, shift)
            } else {
                let at = |d: usize| grid[(i + d - 3) * stride];
                interpolate(at(0), at(2), at(4), at(6), shift)
            };
            grid[i * stride] = grid[i * stride].wrapping_add(sign * value);
        }
    }
}

/// Whole rows combined at once: the vertical direction without jumping through memory.
struct Columns {
    shape: Shape,
    step: usize,
    count: usize,
}

impl Columns {
    fn new(shape: Shape, step: usize) -> Self {
        Columns {
            shape,
            step,
            count: on(shape.rows, step),
        }
    }

    fn lift(&self, grid: &mut [i32], passes: [(usize, u32, i32); 2]) {
        if self.count < 2 {
            return;
        }
        for (first, shift, sign) in passes {
            for i in (first..self.count).step_by(2) {
                let row = |d: isize| {
                    mirrored(i as isize + d, self.count) * self.step * self.shape.columns
                };
                self.row(
                    grid,
                    [row(-3), row(-1), row(1), row(3)],
                    (row(0), shift, sign),
                );
            }
        }
    }

    #[inline]
    fn row(&self, grid: &mut [i32], from: [usize; 4], (to, shift, sign): (usize, u32, i32)) {
        let width = self.shape.columns;
        let (before, rest) = grid.split_at_mut(to);
        let (target, after) = rest.split_at_mut(width);
        let source = |at: usize| {
            if at < to {
                &before[at..at + width]
            } else {
                &after[at - to - width..][..width]
            }
        };
        let [a, b, c, d] = from.map(source);
        let mut x = 0;
        while x < width {
            target[x] = target[x].wrapping_add(sign * interpolate(a[x], b[x], c[x], d[x], shift));
            x += self.step;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::vec::Vec;

    proptest! {
        #[test]
        fn the_inverse_gives_back_every_bit(rows in 1usize..40, columns in 1usize..40, seed in 0u32..1000) {
            let shape = Shape::new(rows, columns);
            let value = |i: usize| (i as u32).wrapping_mul(2654435761).wrapping_add(seed).wrapping_mul(40503) as i32 >> 12;
            let data: Vec<i32> = (0..shape.len()).map(value).collect();
            let mut grid = data.clone();
            forward(&mut grid, shape, levels(shape));
            inverse(&mut grid, shape, levels(shape), 0);
            prop_assert_eq!(grid, data);
        }
    }

    #[test]
    fn cubics_have_no_details_inside() {
        let shape = Shape::new(33, 33);
        let mut grid: Vec<i32> = (0..shape.len())
            .map(|i| {
                let (y, x) = ((i / 33) as i32, (i % 33) as i32);
                16 * (y * y * y - 3 * x * x * y + 40 * x)
            })
            .collect();
        forward(&mut grid, shape, 1);
        for y in (4..28).step_by(1) {
            for x in (5..28).step_by(2) {
                assert_eq!(grid[y * 33 + x], 0, "({y}, {x})");
            }
        }
    }
}
