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

use super::band::Occupied;
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

/// Heights → coefficients, in place; without `means` the coarser samples stay heights.
pub(super) fn forward(grid: &mut [i32], shape: Shape, levels: u32, means: bool) {
    for level in 0..levels {
        let step = 1 << level;
        for row in (0..shape.rows).step_by(step) {
            let line = &mut grid[row * shape.columns..][..shape.columns];
            PREDICT.undo().along(line, step);
            if means {
                UPDATE.along(line, step);
            }
        }
        PREDICT.undo().across(grid, shape, step);
        if means {
            UPDATE.across(grid, shape, step);
        }
    }
}

/// Coefficients → heights, in place, from level `levels` down to just above `last`. Details
/// that are all zero change no mean: their update is left out.
pub(super) fn inverse(
    grid: &mut [i32],
    shape: Shape,
    (levels, last): (u32, u32),
    occupied: Occupied,
) {
    for level in (last..levels).rev() {
        let step = 1 << level;
        let (along_columns, along_rows) = occupied.directions(level + 1);
        if along_columns {
            UPDATE.undo().across(grid, shape, step);
        }
        PREDICT.across(grid, shape, step);
        for row in (0..shape.rows).step_by(step) {
            let line = &mut grid[row * shape.columns..][..shape.columns];
            if along_rows {
                UPDATE.undo().along(line, step);
            }
            PREDICT.along(line, step);
        }
    }
}

/// Samples on a lattice of spacing `step`.
pub(super) fn on(side: usize, step: usize) -> usize {
    (side - 1) / step + 1
}

/// One lifting step: every second sample, from `first` on, gains or loses an interpolation of
/// the others.
#[derive(Clone, Copy)]
struct Step {
    first: usize,
    shift: u32,
    /// 0 to add, −1 to subtract
    sign: i32,
}

/// Odd samples gain the cubic interpolation of even ones.
const PREDICT: Step = Step {
    first: 1,
    shift: 4,
    sign: 0,
};

/// Even samples gain a blend of the details beside them.
const UPDATE: Step = Step {
    first: 0,
    shift: 5,
    sign: 0,
};

/// Samples of a line that are computed side by side.
const BLOCK: usize = 8;

impl Step {
    const fn undo(self) -> Step {
        Step { sign: -1, ..self }
    }

    /// ± (9 (b + c) − (a + d) + half) / 2^shift added to `to`. Wrapping: only damaged data come
    /// near the ends.
    #[inline(always)]
    fn lifted(&self, to: i32, [a, b, c, d]: [i32; 4]) -> i32 {
        let inner = b.wrapping_add(c).wrapping_mul(9);
        let value = inner
            .wrapping_sub(a.wrapping_add(d))
            .wrapping_add(1 << (self.shift - 1))
            >> self.shift;
        to.wrapping_add((value ^ self.sign).wrapping_sub(self.sign))
    }

    /// Along a line whose samples are `stride` apart.
    #[inline(always)]
    fn along(&self, line: &mut [i32], stride: usize) {
        let count = on(line.len(), stride);
        if count < 2 {
            return;
        }
        let start = 4 - self.first; // the first sample with three on its left
        for i in (self.first..start.min(count)).step_by(2) {
            self.at_border(line, stride, i);
        }
        let mut i = start;
        if stride == 1 {
            while i + 2 * BLOCK + 2 < count {
                self.block(&mut line[i - 3..]);
                i += 2 * BLOCK;
            }
        }
        if i + 3 < count {
            let [mut a, mut b, mut c] = [i - 3, i - 1, i + 1].map(|k| line[k * stride]);
            let (mut at, mut ahead) = (i * stride, (i + 3) * stride);
            while ahead < line.len() {
                let d = line[ahead];
                line[at] = self.lifted(line[at], [a, b, c, d]);
                (a, b, c) = (b, c, d);
                (at, ahead) = (at + 2 * stride, ahead + 2 * stride);
            }
            i = at / stride;
        }
        (i..count)
            .step_by(2)
            .for_each(|i| self.at_border(line, stride, i));
    }

    /// The samples 3, 5, … of the line, [`BLOCK`] of them, gathered so that they can be
    /// computed side by side.
    #[inline(always)]
    fn block(&self, line: &mut [i32]) {
        let pairs = &line.as_chunks::<2>().0[..BLOCK + 3];
        let others: [i32; BLOCK + 3] = core::array::from_fn(|k| pairs[k][0]);
        let pairs = &mut line[2..].as_chunks_mut::<2>().0[..BLOCK];
        for (k, pair) in pairs.iter_mut().enumerate() {
            let taps = [others[k], others[k + 1], others[k + 2], others[k + 3]];
            *pair = [pair[0], self.lifted(pair[1], taps)];
        }
    }

    fn at_border(&self, line: &mut [i32], stride: usize, i: usize) {
        let taps = neighbours(i, on(line.len(), stride)).map(|k| line[k * stride]);
        line[i * stride] = self.lifted(line[i * stride], taps);
    }

    /// Across rows that are `step` apart: whole rows at once, not jumping through memory.
    #[inline(always)]
    fn across(&self, grid: &mut [i32], shape: Shape, step: usize) {
        let (count, width) = (on(shape.rows, step), shape.columns);
        if count < 2 {
            return;
        }
        for i in (self.first..count).step_by(2) {
            let (before, rest) = grid.split_at_mut(i * step * width);
            let (target, after) = rest.split_at_mut(width);
            let sources = neighbours(i, count).map(|k| {
                if k < i {
                    &before[k * step * width..][..width]
                } else {
                    &after[(k - i) * step * width - width..][..width]
                }
            });
            self.row(target, sources, step);
        }
    }

    #[inline(always)]
    fn row(&self, target: &mut [i32], [a, b, c, d]: [&[i32]; 4], step: usize) {
        let width = target.len();
        let (a, b, c, d) = (&a[..width], &b[..width], &c[..width], &d[..width]);
        if step == 1 {
            for x in 0..width {
                target[x] = self.lifted(target[x], [a[x], b[x], c[x], d[x]]);
            }
        } else {
            for x in (0..width).step_by(step) {
                target[x] = self.lifted(target[x], [a[x], b[x], c[x], d[x]]);
            }
        }
    }
}

/// Index mirrored into 0 … count − 1 (more than once if it must be).
#[inline]
fn mirrored(i: isize, count: usize) -> usize {
    let last = count as isize - 1;
    let mut i = i.abs();
    while i > last {
        i = (2 * last - i).abs();
    }
    i as usize
}

/// The neighbours of sample i at ∓3 and ∓1.
#[inline]
fn neighbours(i: usize, count: usize) -> [usize; 4] {
    [-3, -1, 1, 3].map(|d| mirrored(i as isize + d, count))
}

#[cfg(test)]
mod tests {
    use super::super::band::Band;
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
            forward(&mut grid, shape, levels(shape), true);
            let mut occupied = Occupied::default();
            (1..=levels(shape)).flat_map(|l| Band::of_level(shape, l)).for_each(|b| occupied.add(&b));
            inverse(&mut grid, shape, (levels(shape), 0), occupied);
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
        forward(&mut grid, shape, 1, true);
        for y in (4..28).step_by(1) {
            for x in (5..28).step_by(2) {
                assert_eq!(grid[y * 33 + x], 0, "({y}, {x})");
            }
        }
    }
}
