//! How coefficients are told: by level from the coarsest, with what is known around them.
//!
//! The expected magnitude E of a coefficient is a weighted mean of the magnitudes of its
//! neighbours already told (west, north, north-west, north-east), of its parent (the
//! coefficient of the same kind one level coarser) and of its siblings (the other kinds at
//! the same place). It selects the chances of `chances.rs`. Roughness thus adapts from place
//! to place by itself; a table of local H and σ would tell the same later.
//!
//! Squares of 8 × 8 coefficients that are all zero are told as such. A lossy encoder weighs
//! the squared error against the bits at every coefficient: 1 is told instead of 0 only if
//! (2 u − 1) step² exceeds λ · bits, with λ = 0.1155 step², the slope of a fine uniform
//! quantiser.

use super::LONGEST_SIDE;
use super::band::{Area, Band, Occupied};
use super::chances::{Chances, class};
use super::lifting;
use super::range::Coder;
use crate::surfaces::Shape;
use rugosa_grid::math;

/// Coefficients per side of a square that can be told empty at once.
const SQUARE: usize = 8;

/// Nominal step in units of the quantum, where coefficients are quantised at all.
pub(super) const LOSSY_STEP: u64 = 64;

/// Words of flags of the longest row of squares.
const SQUARES: usize = LONGEST_SIDE / (2 * SQUARE * 32);

/// λ: squared error that a bit is worth, in step².
const BIT_PRICE: f32 = 0.1155;

/// Rounding threshold of magnitudes from the second step on.
const THRESHOLD: f32 = 0.55;

/// Step of a band in units of the quantum.
fn step(band: &Band, lossy: bool) -> i32 {
    if !lossy {
        return 1;
    }
    let weight = lifting::weight(band.level, band.rows_high, band.columns_high);
    ((LOSSY_STEP * 4096 + weight / 2) / weight).max(1) as i32
}

/// From which |coefficient| / step on 1 is told instead of 0, by the chance (32 steps) that
/// it is not zero.
fn thresholds() -> [f32; 32] {
    core::array::from_fn(|i| {
        let p = (i as f32 + 0.5) / 32.0;
        let bits = math::log2((1.0 - p) / p) + 1.6;
        (0.5 + 0.5 * BIT_PRICE * bits).clamp(0.5, 1.2)
    })
}

/// A band while it is walked, and what is known beside it.
struct Place {
    band: Band,
    step: i32,
    parent: Option<Band>,
    /// details along columns at the same place
    vertical: Option<Band>,
    /// details along rows at the same place
    horizontal: Option<Band>,
}

/// Where the parent and the siblings of a row of coefficients begin in the grid.
struct Beside {
    parent: Option<(usize, Band)>,
    vertical: Option<(usize, u32)>,
    horizontal: Option<usize>,
}

impl Place {
    fn beside(&self, i: usize) -> Beside {
        let weight = if self.band.rows_high { 1 } else { 2 };
        Beside {
            parent: self.parent.map(|p| (p.at((i / 2).min(p.rows - 1), 0), p)),
            vertical: self
                .vertical
                .filter(|v| i < v.rows)
                .map(|v| (v.at(i, 0), weight)),
            horizontal: self.horizontal.map(|h| h.at(i, 0)),
        }
    }
}

/// Walks a map in the order of the stream; encoder and decoder differ in the coder only.
pub(super) struct Walk<'a, C: Coder> {
    pub coder: C,
    pub grid: &'a mut [i32],
    shape: Shape,
    chances: Chances,
    thresholds: [f32; 32],
    lossy: bool,
    levels: u32,
    pub occupied: Occupied,
}

impl<'a, C: Coder> Walk<'a, C> {
    pub fn new(coder: C, grid: &'a mut [i32], shape: Shape, lossy: bool) -> Self {
        Walk {
            coder,
            grid,
            shape,
            chances: Chances::new(),
            thresholds: if C::ENCODES { thresholds() } else { [0.0; 32] },
            lossy,
            levels: lifting::levels(shape),
            occupied: Occupied::default(),
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
                let actual = C::ENCODES && is_unknown(index);
                let chance = &mut self.chances.unknown[context as usize];
                let bit = self.coder.bit(chance, actual);
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
            let mut west = 0;
            for column in (0..self.shape.columns).step_by(stride) {
                let index = row * self.shape.columns + column;
                west = self.coefficient(index, 16 * west, 1);
            }
        }
    }

    /// The details of one level, 1 is the finest.
    pub fn level(&mut self, level: u32) {
        for band in Band::of_level(self.shape, level) {
            if !band.is_empty() {
                self.band(band);
            }
        }
    }

    fn band(&mut self, band: Band) {
        let step = step(&band, self.lossy);
        let wanted = C::ENCODES && self.is_worth_telling(band.indices(band.all()), step);
        if !self.coder.bit(&mut self.chances.band, wanted) {
            self.clear(band, band.all());
            return;
        }
        self.occupied.add(&band);
        let place = self.place(band, step);
        let mut above = [0u32; SQUARES];
        for top in (0..band.rows).step_by(SQUARE) {
            let bottom = (top + SQUARE).min(band.rows);
            let flags = self.squares(&place, (top, bottom), &above);
            for i in top..bottom {
                let beside = place.beside(i);
                for (square, left) in (0..band.columns).step_by(SQUARE).enumerate() {
                    if flags[square / 32] >> (square % 32) & 1 == 1 {
                        self.run(&place, &beside, (i, left));
                    }
                }
            }
            above = flags;
        }
    }

    fn place(&self, band: Band, step: i32) -> Place {
        let sibling = |rows_high, columns_high| {
            Some(Band::new(self.shape, band.level, rows_high, columns_high))
                .filter(|b| band.columns_high && !b.is_empty())
        };
        Place {
            band,
            step,
            parent: (band.level < self.levels)
                .then(|| {
                    Band::new(
                        self.shape,
                        band.level + 1,
                        band.rows_high,
                        band.columns_high,
                    )
                })
                .filter(|p| !p.is_empty()),
            vertical: sibling(true, false),
            horizontal: sibling(false, true).filter(|_| band.rows_high),
        }
    }

    /// Which squares of a row of squares hold anything.
    fn squares(
        &mut self,
        place: &Place,
        (top, bottom): (usize, usize),
        above: &[u32; SQUARES],
    ) -> [u32; SQUARES] {
        let band = place.band;
        let mut flags = [0u32; SQUARES];
        let mut west = 0;
        for (square, left) in (0..band.columns).step_by(SQUARE).enumerate() {
            let area = Area {
                top,
                bottom,
                left,
                right: (left + SQUARE).min(band.columns),
            };
            let north = above[square / 32] >> (square % 32) & 1;
            let parent = place
                .parent
                .as_ref()
                .is_none_or(|p| p.indices(area.of_parents(p)).any(|at| self.grid[at] != 0));
            let context = (west | north << 1 | u32::from(parent) << 2) as usize;
            let wanted = C::ENCODES && self.is_worth_telling(band.indices(area), place.step);
            let bit = self.coder.bit(&mut self.chances.square[context], wanted);
            if !bit {
                self.clear(band, area);
            }
            west = u32::from(bit);
            flags[square / 32] |= west << (square % 32);
        }
        flags
    }

    /// Encoder: does any coefficient exceed a step?
    fn is_worth_telling(&self, mut indices: impl Iterator<Item = usize>, step: i32) -> bool {
        let limit = if self.lossy { step as u32 } else { 0 };
        indices.any(|at| self.grid[at].unsigned_abs() > limit)
    }

    fn clear(&mut self, band: Band, area: Area) {
        if C::ENCODES {
            band.indices(area).for_each(|at| self.grid[at] = 0);
        }
    }

    /// The coefficients of row i of one square, from column `left` on.
    #[inline]
    fn run(&mut self, place: &Place, beside: &Beside, (i, left): (usize, usize)) {
        let band = &place.band;
        let above = |grid: &[i32], j: usize| match i {
            0 => 0,
            _ => grid[band.at(i - 1, j)].unsigned_abs(),
        };
        let (mut west, mut north_west) = (0, 0);
        if left > 0 {
            west = self.grid[band.at(i, left - 1)].unsigned_abs();
            north_west = above(self.grid, left - 1);
        }
        let mut north = above(self.grid, left);
        for j in left..(left + SQUARE).min(band.columns) {
            let north_east = if j + 1 < band.columns {
                above(self.grid, j + 1)
            } else {
                0
            };
            let near = 4 * (west + north) + 2 * (north_west + north_east);
            let expected = near + self.beside(beside, band.right, j);
            west = self.coefficient(band.at(i, j), expected, place.step);
            (north_west, north) = (north, north_east);
        }
    }

    /// What parent and siblings add to 16 × the expected magnitude.
    #[inline]
    fn beside(&self, beside: &Beside, right: usize, j: usize) -> u32 {
        let magnitude = |at: usize| self.grid[at].unsigned_abs();
        let mut sum = 0;
        if let Some((start, parent)) = &beside.parent {
            sum += 2 * magnitude(start + (j / 2).min(parent.columns - 1) * parent.right);
        }
        if let Some((start, weight)) = beside.vertical {
            sum += weight * magnitude(start + j * right);
        }
        if let Some(start) = beside.horizontal {
            sum += magnitude(start + j * right);
        }
        sum
    }

    /// Tells one coefficient; the grid then holds the quantised value. Returns its magnitude.
    #[inline(always)]
    fn coefficient(&mut self, index: usize, expected: u32, step: i32) -> u32 {
        let class = class(expected);
        let value = if C::ENCODES {
            self.quantised(self.grid[index], class, step)
        } else {
            0
        };
        let told = self.chances.code(&mut self.coder, class, value);
        self.grid[index] = told;
        told.unsigned_abs()
    }

    /// Encoder: the value to tell for a coefficient.
    #[inline]
    fn quantised(&self, coefficient: i32, (class, shift): (usize, u32), step: i32) -> i32 {
        if !self.lossy || step == 1 {
            return coefficient;
        }
        let u = coefficient.unsigned_abs() as f32 / step as f32;
        let magnitude = if u < 1.5 && shift == 0 {
            let chance = self.chances.not_zero[class].of_true() as usize;
            i32::from(u > self.thresholds[chance >> 11])
        } else {
            (u + (1.0 - THRESHOLD)) as i32
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
        let levels = (last + 1..=self.levels).rev();
        for band in levels.flat_map(|level| Band::of_level(self.shape, level)) {
            let step = step(&band, true);
            if !self.occupied.holds(&band) || step == 1 {
                continue;
            }
            for i in 0..band.rows {
                let row = &mut self.grid[band.at(i, 0)..];
                let values = row.iter_mut().step_by(band.right).take(band.columns);
                values.for_each(|z| *z = z.wrapping_mul(step));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::codec::range::{Decoder, Encoder};

    /// What the documentation promises: less than 4 kB besides the lent memory.
    #[test]
    fn the_state_is_below_4_kb() {
        let walk = size_of::<Walk<Encoder>>().max(size_of::<Walk<Decoder>>());
        let flags = 2 * size_of::<[u32; SQUARES]>();
        let unknown = size_of::<[u32; LONGEST_SIDE / 32 + 1]>();
        let state = walk + size_of::<Place>() + size_of::<Beside>() + flags.max(unknown);
        std::println!(
            "state of the codec: {state} bytes, of them the chances {}",
            size_of::<Chances>()
        );
        assert!(state < 4096, "{state}");
    }
}
