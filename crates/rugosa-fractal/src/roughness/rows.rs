//! The sums of one tile in one go, row by row.
//!
//! The samples of the tile and of the margin that its pairs reach into are unpacked into
//! a block of separate planes; then each offset is a shifted difference of the tile's
//! rows with the block's, eight cells at a time, in plain integer arithmetic that a
//! compiler turns into vector instructions. Cells without a sample are zero in every
//! plane and masked. The results are the same integers as those of single pairs
//! (test `rows_equal_single_pairs`): integer sums do not depend on their order.
//!
//! Elevations are taken relative to the block's lowest one. Where the relief of the block
//! exceeds [`RELIEF_LIMIT`] height steps the 32-bit partial sums might overflow and the
//! pairs are summed one by one instead, to the same integers.
//!
//! Cost: 64 × [`OFFSETS`] masked pairs whatever is measured; see `docs/roughness.md`.

use super::offsets::{LAGS, REACH, offsets};
use super::sums::LagSums;
use rugosa_grid::{Cell, Sample, TILE, Tile, Window, sample::PARTS};

const LANES: usize = TILE as usize;
const WIDTH: usize = LANES + 2 * REACH as usize;
const HEIGHT: usize = LANES + REACH as usize;
const CELLS: usize = WIDTH * HEIGHT;

/// Largest relief of a block for 32-bit partial sums, in height steps: over the 18 offsets
/// of a lag and 8 rows, 18 · 8 · 13 000 · 1088 < 2³¹, and 8 · 13 000² < 2³².
const RELIEF_LIMIT: i32 = 13_000;

/// Scratch memory: the samples of a tile and its margin, plane by plane; 7 680 bytes.
#[derive(Clone, Debug)]
pub struct Block {
    height: [i16; CELLS],
    variance: [u16; CELLS],
    east: [i8; CELLS],
    north: [i8; CELLS],
    /// −1 where a sample is, else 0
    mask: [i16; CELLS],
}

impl Default for Block {
    fn default() -> Self {
        Block::new()
    }
}

impl Block {
    /// An empty block.
    pub const fn new() -> Self {
        Block {
            height: [0; CELLS],
            variance: [0; CELLS],
            east: [0; CELLS],
            north: [0; CELLS],
            mask: [0; CELLS],
        }
    }

    /// The sums of `tile` over all measured samples.
    pub(super) fn sums(
        &mut self,
        window: &Window,
        samples: &[Sample],
        tile: Tile,
    ) -> [LagSums; LAGS] {
        self.fill(window, samples, tile);
        if self.level() {
            self.by_rows()
        } else {
            self.by_pairs()
        }
    }

    fn fill(&mut self, window: &Window, samples: &[Sample], tile: Tile) {
        let corner = tile.origin().offset(-REACH, 0);
        for y in 0..HEIGHT {
            for x in 0..WIDTH {
                let cell = Cell::offset(corner, x as i32, y as i32);
                let sample = window.slot(cell).map(|slot| samples[slot]);
                self.put(y * WIDTH + x, sample.filter(Sample::is_measured));
            }
        }
    }

    #[inline(always)]
    fn put(&mut self, at: usize, sample: Option<Sample>) {
        self.mask[at] = -i16::from(sample.is_some());
        let sample = sample.unwrap_or_default();
        self.height[at] = sample.height;
        self.variance[at] = sample.variance;
        self.east[at] = sample.east;
        self.north[at] = sample.north;
    }

    /// Makes the heights relative to the lowest one; false, and nothing done, where the
    /// relief is too large for that.
    fn level(&mut self) -> bool {
        let (mut low, mut high) = (i16::MAX, i16::MIN);
        for (&height, &mask) in self.height.iter().zip(&self.mask) {
            low = low.min(if mask != 0 { height } else { i16::MAX });
            high = high.max(if mask != 0 { height } else { i16::MIN });
        }
        if i32::from(high) - i32::from(low) > RELIEF_LIMIT {
            return false;
        }
        for (height, &mask) in self.height.iter_mut().zip(&self.mask) {
            *height = height.wrapping_sub(low) & mask;
        }
        true
    }

    fn by_pairs(&self) -> [LagSums; LAGS] {
        core::array::from_fn(|lag| {
            let mut sums = LagSums::default();
            for &offset in offsets(lag) {
                for row in 0..LANES {
                    self.add_row_by_pairs(&mut sums, row, offset);
                }
            }
            sums
        })
    }

    fn add_row_by_pairs(&self, sums: &mut LagSums, row: usize, (x, y): (i8, i8)) {
        let (lower, upper) = places(row, (x, y));
        for lane in 0..LANES {
            if self.mask[lower + lane] & self.mask[upper + lane] != 0 {
                let pair = (self.sample(lower + lane), self.sample(upper + lane));
                *sums += &LagSums::of_pair(&pair.0, &pair.1, (x.into(), y.into()));
            }
        }
    }

    fn sample(&self, at: usize) -> Sample {
        Sample::measured(
            self.height[at],
            self.variance[at],
            self.east[at],
            self.north[at],
            0,
        )
    }

    #[inline(always)]
    fn by_rows(&self) -> [LagSums; LAGS] {
        core::array::from_fn(|lag| {
            let mut lanes = LaneSums::default();
            for &offset in offsets(lag) {
                let mut square = [0; LANES];
                for row in 0..LANES {
                    let (lower, upper) = places(row, offset);
                    lanes.add(&mut square, &self.row(lower), &self.row(upper), offset);
                }
                lanes.square += square.iter().map(|&s| u64::from(s)).sum::<u64>();
            }
            lanes.total()
        })
    }

    #[inline(always)]
    fn row(&self, at: usize) -> Row {
        Row {
            height: lanes_of(&self.height, at),
            variance: lanes_of(&self.variance, at),
            east: lanes_of(&self.east, at),
            north: lanes_of(&self.north, at),
            mask: lanes_of(&self.mask, at),
        }
    }
}

/// First places of a row of the tile and of its partner at `offset`.
#[inline(always)]
fn places(row: usize, (x, y): (i8, i8)) -> (usize, usize) {
    let lower = row * WIDTH + REACH as usize;
    let upper = (lower + y as usize * WIDTH).wrapping_add_signed(isize::from(x));
    (lower, upper)
}

#[inline(always)]
fn lanes_of<T: Copy>(plane: &[T; CELLS], at: usize) -> [T; LANES] {
    core::array::from_fn(|lane| plane[at..at + LANES][lane])
}

/// Eight neighbouring cells of a block.
struct Row {
    height: [i16; LANES],
    variance: [u16; LANES],
    east: [i8; LANES],
    north: [i8; LANES],
    mask: [i16; LANES],
}

/// Partial sums, one per lane.
#[derive(Default)]
struct LaneSums {
    square: u64,
    absolute: [u32; LANES],
    pairs: [i32; LANES],
    noise: [u32; LANES],
    trend: [[i32; LANES]; 2],
    spread: [[i32; LANES]; 3],
}

impl LaneSums {
    #[inline(always)]
    #[allow(clippy::needless_range_loop)] // one lane of many arrays
    fn add(&mut self, square: &mut [u32; LANES], lower: &Row, upper: &Row, (x, y): (i8, i8)) {
        for k in 0..LANES {
            let mask = i32::from(lower.mask[k] & upper.mask[k]);
            let dz = (i32::from(upper.height[k]) - i32::from(lower.height[k])) & mask;
            let dx = PARTS * i32::from(x) + i32::from(upper.east[k]) - i32::from(lower.east[k]);
            let dy = PARTS * i32::from(y) + i32::from(upper.north[k]) - i32::from(lower.north[k]);
            square[k] += (dz * dz) as u32;
            self.absolute[k] += dz.unsigned_abs();
            self.pairs[k] -= mask;
            let noise = u32::from(lower.variance[k]) + u32::from(upper.variance[k]);
            self.noise[k] += noise & mask as u32;
            self.trend[0][k] += dz * dx;
            self.trend[1][k] += dz * dy;
            self.spread[0][k] += (dx & mask) * dx;
            self.spread[1][k] += (dx & mask) * dy;
            self.spread[2][k] += (dy & mask) * dy;
        }
    }

    #[inline(always)]
    fn total(&self) -> LagSums {
        LagSums {
            square: self.square,
            trend: self.trend.map(|t| t.iter().map(|&s| i64::from(s)).sum()),
            absolute: self.absolute.iter().sum(),
            pairs: self.pairs.iter().sum::<i32>() as u32,
            noise: self.noise.iter().sum(),
            spread: self.spread.map(|g| g.iter().sum()),
        }
    }
}
