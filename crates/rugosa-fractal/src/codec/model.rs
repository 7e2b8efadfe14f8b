//! How coefficients are told: by level from the coarsest, with what is known around them.
//!
//! The expected magnitude E of a coefficient is a weighted mean of the magnitudes of its
//! neighbours already told (west, north, north-west, north-east), of its parent (the
//! coefficient of the same kind one level coarser) and of its siblings (the other kinds at
//! the same place). It selects the chances of the decisions "is it zero?", "how many bits?",
//! and, where values are large, how many low bits are not worth modelling. Roughness thus
//! adapts from place to place by itself; a table of local H and σ would tell the same later.
//!
//! Squares of 8 × 8 coefficients that are all zero are told as such. A lossy encoder weighs
//! the squared error against the bits at every coefficient: 1 is told instead of 0 only if
//! (2 u − 1) step² exceeds λ · bits, with λ = 0.1155 step², the slope of a fine uniform
//! quantiser.

use super::LONGEST_SIDE;
use super::lifting;
use super::range::{Chance, Coder};
use crate::surfaces::Shape;
use rugosa_grid::math;

/// Coefficients per side of a square that can be told empty at once.
const SQUARE: usize = 8;

/// Classes of the expected magnitude.
const CLASSES: usize = 16;

/// Nominal step in units of the quantum, where coefficients are quantised at all.
pub(super) const LOSSY_STEP: u64 = 64;

/// Words of flags of the longest row of squares.
const SQUARES: usize = LONGEST_SIDE / (2 * SQUARE * 32);

/// No coefficient is larger.
const MOST: u32 = (1 << 27) - 1;

/// λ: squared error that a bit is worth, in step².
const BIT_PRICE: f32 = 0.1155;

/// Above this a coefficient keeps its square from being told empty.
const LONELY: f32 = 1.0;

/// First guesses, in 65536ths, from fBm of H 0.5 … 0.8 and the DEM: a coefficient of this
/// class is not zero.
const NOT_ZERO: [u16; CLASSES] = [
    3276, 2621, 7208, 3276, 13107, 5898, 19660, 9830, 22937, 31457, 39321, 48496, 53739, 57016,
    60293, 61603,
];

/// First guesses: yet another bit, by class and bits so far.
const LONGER: [[u16; 6]; CLASSES] = {
    let first = [6, 6, 6, 6, 8, 8, 8, 9, 13, 19, 28, 40, 55, 68, 78, 84];
    let second = [
        10, 10, 10, 10, 10, 10, 10, 10, 10, 11, 13, 15, 24, 35, 55, 65,
    ];
    let third = [8, 8, 8, 8, 8, 8, 8, 8, 8, 8, 8, 8, 12, 20, 35, 44];
    let mut table = [[0; 6]; CLASSES];
    let mut class = 0;
    while class < CLASSES {
        let percent = [first[class], second[class], third[class], 20, 33, 40];
        let mut i = 0;
        while i < 6 {
            table[class][i] = (percent[i] as u32 * 655) as u16;
            i += 1;
        }
        class += 1;
    }
    table[0] = [10_000, 40_000, 50_000, 55_000, 55_000, 45_000];
    table
};

/// The chances of all decisions.
struct Chances {
    not_zero: [Chance; CLASSES],
    longer: [[Chance; 6]; CLASSES],
    second_bit: [Chance; 6],
    band: Chance,
    square: [Chance; 8],
    unknown: [Chance; 16],
}

impl Chances {
    fn new() -> Self {
        Chances {
            not_zero: NOT_ZERO.map(Chance::new),
            longer: LONGER.map(|l| l.map(Chance::new)),
            second_bit: [21_000, 21_500, 18_000, 16_000, 20_000, 24_000].map(Chance::new),
            band: Chance::new(50_000),
            square: [
                2_000, 12_000, 12_000, 40_000, 25_000, 50_000, 50_000, 63_000,
            ]
            .map(Chance::new),
            unknown: [Chance::new(8_000); 16],
        }
    }
}

/// One kind of detail at one level.
#[derive(Clone, Copy)]
struct Band {
    level: u32,
    rows_high: bool,
    columns_high: bool,
}

impl Band {
    fn size(&self, shape: Shape) -> (usize, usize) {
        let count = |side: usize, high: bool| {
            let all = lifting::on(side, 1 << (self.level - 1));
            if high { all / 2 } else { all.div_ceil(2) }
        };
        (
            count(shape.rows, self.rows_high),
            count(shape.columns, self.columns_high),
        )
    }

    /// Index in the grid of coefficient (i, j).
    #[inline]
    fn at(&self, columns: usize, i: usize, j: usize) -> usize {
        let half = 1usize << (self.level - 1);
        let row = (2 * i + usize::from(self.rows_high)) * half;
        row * columns + (2 * j + usize::from(self.columns_high)) * half
    }

    fn bit(&self) -> u64 {
        1 << (4 * self.level + 2 * u32::from(self.rows_high) + u32::from(self.columns_high))
    }

    fn with(&self, rows_high: bool, columns_high: bool) -> Band {
        Band {
            rows_high,
            columns_high,
            ..*self
        }
    }
}

/// Step of a band in units of the quantum.
pub(super) fn step(level: u32, rows_high: bool, columns_high: bool, lossy: bool) -> i32 {
    if !lossy {
        return 1;
    }
    let weight = lifting::weight(level, rows_high, columns_high);
    ((LOSSY_STEP * 4096 + weight / 2) / weight).max(1) as i32
}

/// Walks a map in the order of the stream; encoder and decoder differ in the coder only.
pub(super) struct Walk<'a, C: Coder> {
    pub coder: C,
    pub grid: &'a mut [i32],
    shape: Shape,
    chances: Chances,
    lossy: bool,
    encode: bool,
    levels: u32,
    /// one bit per band that holds anything
    occupied: u64,
}

impl<'a, C: Coder> Walk<'a, C> {
    pub fn new(coder: C, grid: &'a mut [i32], shape: Shape, lossy: bool, encode: bool) -> Self {
        let levels = lifting::levels(shape);
        Walk {
            coder,
            grid,
            shape,
            chances: Chances::new(),
            lossy,
            encode,
            levels,
            occupied: 0,
        }
    }

    /// Which cells are unknown, row by row; `told` sees every cell.
    pub fn unknown(
        &mut self,
        is_unknown: impl Fn(usize) -> bool,
        mut told: impl FnMut(usize, bool),
    ) {
        let width = self.shape.columns;
        let mut above = [0u32; LONGEST_SIDE / 32 + 1];
        for row in 0..self.shape.rows {
            let (mut west, mut north_west) = (0, above[0] & 1);
            for column in 0..width {
                let north = above[column / 32] >> (column % 32) & 1;
                let next = column + 1;
                let north_east = if next < width {
                    above[next / 32] >> (next % 32) & 1
                } else {
                    north
                };
                let context = west | north << 1 | north_west << 2 | north_east << 3;
                let index = row * width + column;
                let actual = self.encode && is_unknown(index);
                let bit = self
                    .coder
                    .bit(&mut self.chances.unknown[context as usize], actual);
                told(index, bit);
                north_west = north;
                west = u32::from(bit);
                above[column / 32] =
                    above[column / 32] & !(1 << (column % 32)) | west << (column % 32);
            }
        }
    }

    /// The few samples that remain after the last level.
    pub fn coarsest(&mut self) {
        let stride = 1 << self.levels;
        for row in (0..self.shape.rows).step_by(stride) {
            for column in (0..self.shape.columns).step_by(stride) {
                let index = row * self.shape.columns + column;
                let west = if column > 0 {
                    self.grid[index - stride].unsigned_abs()
                } else {
                    0
                };
                self.coefficient(index, 16 * west, 1);
            }
        }
    }

    /// The details of one level, 1 is the finest.
    pub fn level(&mut self, level: u32) {
        for (rows_high, columns_high) in [(true, false), (false, true), (true, true)] {
            self.band(Band {
                level,
                rows_high,
                columns_high,
            });
        }
    }

    fn band(&mut self, band: Band) {
        let (rows, columns) = band.size(self.shape);
        if rows == 0 || columns == 0 {
            return;
        }
        let step = step(band.level, band.rows_high, band.columns_high, self.lossy);
        let all = (0, rows, 0, columns);
        let wanted = self.encode && !self.is_empty(band, all, step);
        if !self.coder.bit(&mut self.chances.band, wanted) {
            self.clear(band, all);
            return;
        }
        self.occupied |= band.bit();
        let mut above = [0u32; SQUARES];
        for first in (0..rows).step_by(SQUARE) {
            let last = (first + SQUARE).min(rows);
            let flags = self.squares(band, (first, last, columns), &above, step);
            for i in first..last {
                for j in 0..columns {
                    if flags[j / SQUARE / 32] >> (j / SQUARE % 32) & 1 == 1 {
                        let expected = self.expected(band, (i, j), columns);
                        self.coefficient(band.at(self.shape.columns, i, j), expected, step);
                    }
                }
            }
            above = flags;
        }
    }

    /// Which squares of a row of squares hold anything.
    fn squares(
        &mut self,
        band: Band,
        (first, last, columns): (usize, usize, usize),
        above: &[u32; SQUARES],
        step: i32,
    ) -> [u32; SQUARES] {
        let mut flags = [0u32; SQUARES];
        let mut west = 0;
        for (square, from) in (0..columns).step_by(SQUARE).enumerate() {
            let area = (first, last, from, (from + SQUARE).min(columns));
            let north = above[square / 32] >> (square % 32) & 1;
            let parent = u32::from(self.parents_hold_any(band, area));
            let context = (west | north << 1 | parent << 2) as usize;
            let wanted = self.encode && !self.is_empty(band, area, step);
            let bit = self.coder.bit(&mut self.chances.square[context], wanted);
            if !bit {
                self.clear(band, area);
            }
            west = u32::from(bit);
            flags[square / 32] |= west << (square % 32);
        }
        flags
    }

    /// Rows first..last, columns from..to.
    fn indices(
        &self,
        band: Band,
        (first, last, from, to): (usize, usize, usize, usize),
    ) -> impl Iterator<Item = usize> + use<'a, C> {
        let columns = self.shape.columns;
        (first..last).flat_map(move |i| (from..to).map(move |j| band.at(columns, i, j)))
    }

    /// Encoder: is nothing here worth telling?
    fn is_empty(&self, band: Band, area: (usize, usize, usize, usize), step: i32) -> bool {
        let limit = if self.lossy {
            (step as f32 * LONELY) as u32
        } else {
            0
        };
        self.indices(band, area)
            .all(|at| self.grid[at].unsigned_abs() <= limit)
    }

    fn clear(&mut self, band: Band, area: (usize, usize, usize, usize)) {
        if self.encode {
            self.indices(band, area).for_each(|at| self.grid[at] = 0);
        }
    }

    fn parents_hold_any(
        &self,
        band: Band,
        (first, last, from, to): (usize, usize, usize, usize),
    ) -> bool {
        if band.level >= self.levels {
            return true;
        }
        let parent = Band {
            level: band.level + 1,
            ..band
        };
        let (rows, columns) = parent.size(self.shape);
        let area = (
            first / 2,
            last.div_ceil(2).min(rows),
            from / 2,
            to.div_ceil(2).min(columns),
        );
        self.indices(parent, area).any(|at| self.grid[at] != 0)
    }

    /// 16 × the expected magnitude of coefficient (i, j).
    #[inline]
    fn expected(&self, band: Band, (i, j): (usize, usize), columns: usize) -> u32 {
        let width = self.shape.columns;
        let magnitude =
            |band: Band, i: usize, j: usize| self.grid[band.at(width, i, j)].unsigned_abs();
        let (mut near, mut diagonal) = (0u32, 0u32);
        if j > 0 {
            near += magnitude(band, i, j - 1);
        }
        if i > 0 {
            near += magnitude(band, i - 1, j);
            if j > 0 {
                diagonal += magnitude(band, i - 1, j - 1);
            }
            if j + 1 < columns {
                diagonal += magnitude(band, i - 1, j + 1);
            }
        }
        let mut expected = 4 * near + 2 * diagonal;
        if band.level < self.levels {
            let parent = Band {
                level: band.level + 1,
                ..band
            };
            let (rows, columns) = parent.size(self.shape);
            if rows > 0 && columns > 0 {
                expected += 2 * magnitude(parent, (i / 2).min(rows - 1), (j / 2).min(columns - 1));
            }
        }
        expected + self.siblings(band, (i, j), &magnitude)
    }

    #[inline]
    fn siblings(
        &self,
        band: Band,
        (i, j): (usize, usize),
        magnitude: &impl Fn(Band, usize, usize) -> u32,
    ) -> u32 {
        if !band.columns_high {
            return 0;
        }
        let of = |sibling: Band| {
            let (rows, columns) = sibling.size(self.shape);
            if i < rows && j < columns {
                magnitude(sibling, i, j)
            } else {
                0
            }
        };
        let vertical = of(band.with(true, false));
        if band.rows_high {
            vertical + of(band.with(false, true))
        } else {
            2 * vertical
        }
    }

    /// Tells one coefficient; the grid then holds the quantised value.
    fn coefficient(&mut self, index: usize, expected: u32, step: i32) {
        let (class, shift) = class(expected);
        let value = if self.encode {
            self.quantised(index, class, shift, step)
        } else {
            0
        };
        let magnitude = value.unsigned_abs();
        let mut told = 0;
        if self
            .coder
            .bit(&mut self.chances.not_zero[class], magnitude >> shift != 0)
        {
            told = 1 + self.excess(class, (magnitude >> shift).wrapping_sub(1));
        }
        told = told << shift | self.coder.raw(magnitude & ((1 << shift) - 1), shift);
        told &= MOST; // damaged data only
        let negative = told != 0 && self.coder.raw(u32::from(value < 0), 1) == 1;
        self.grid[index] = if negative {
            -(told as i32)
        } else {
            told as i32
        };
    }

    /// A number ≥ 0 as its length in bits, then its bits (Elias gamma of excess + 1).
    fn excess(&mut self, class: usize, excess: u32) -> u32 {
        let length = if self.encode { (excess + 1).ilog2() } else { 0 };
        let mut count = 0;
        while count < 25 {
            let slot = (count as usize).min(5);
            if !self
                .coder
                .bit(&mut self.chances.longer[class][slot], count < length)
            {
                break;
            }
            count += 1;
        }
        if count == 0 {
            return 0;
        }
        let bits = if self.encode {
            (excess + 1) & ((1 << count) - 1)
        } else {
            0
        };
        let slot = (count as usize).min(6) - 1;
        let top = self
            .coder
            .bit(&mut self.chances.second_bit[slot], bits >> (count - 1) == 1);
        let rest = self.coder.raw(bits & ((1 << (count - 1)) - 1), count - 1);
        (1 << count | u32::from(top) << (count - 1) | rest) - 1
    }

    /// Encoder: the value to tell for this coefficient.
    fn quantised(&self, index: usize, class: usize, shift: u32, step: i32) -> i32 {
        let coefficient = self.grid[index];
        if !self.lossy || step == 1 {
            return coefficient;
        }
        let u = coefficient.unsigned_abs() as f32 / step as f32;
        let threshold = if u < 1.5 && shift == 0 {
            let p = self.chances.not_zero[class].of_true() as f32 / 65_536.0;
            let bits = math::log2((1.0 - p) / p) + 1.6;
            (0.5 + 0.5 * BIT_PRICE * bits).clamp(0.5, 1.2)
        } else {
            0.55
        };
        let whole = u as i32;
        let magnitude = if u < 1.5 && shift == 0 {
            i32::from(u > threshold)
        } else {
            whole + i32::from(u - whole as f32 > threshold)
        };
        if coefficient < 0 {
            -magnitude
        } else {
            magnitude
        }
    }

    /// Quantised values → coefficients, from the coarsest level down to `last` + 1.
    pub fn dequantise(&mut self, last: u32) {
        if !self.lossy {
            return;
        }
        for level in (last + 1..=self.levels).rev() {
            for (rows_high, columns_high) in [(true, false), (false, true), (true, true)] {
                let step = step(level, rows_high, columns_high, true);
                let band = Band {
                    level,
                    rows_high,
                    columns_high,
                };
                if self.occupied & band.bit() == 0 {
                    continue;
                }
                let (rows, columns) = band.size(self.shape);
                for i in 0..rows {
                    for j in 0..columns {
                        let at = band.at(self.shape.columns, i, j);
                        self.grid[at] = self.grid[at].wrapping_mul(step);
                    }
                }
            }
        }
    }
}

/// (class, low bits that are told raw) for 16 × the expected magnitude.
#[inline]
fn class(expected: u32) -> (usize, u32) {
    if expected < 8 {
        return (expected as usize, 0);
    }
    let log = expected.ilog2();
    let half = (expected >> (log - 1) & 1) as usize;
    if log <= 6 {
        (8 + 2 * (log as usize - 3) + half, 0)
    } else {
        (14 + half, (log - 6).min(24))
    }
}
