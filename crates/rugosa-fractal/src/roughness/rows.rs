//! The sums of one tile in one go, row by row.
//!
//! The samples of the tile and of the margin that its pairs reach into are unpacked into a
//! block of separate planes, with a bit for each that is measured. A row of the tile and the
//! row at one offset then have in common the bits of the one and the shifted bits of the
//! other; where none is left there is nothing to do, and where some are, the eight
//! differences are taken at once, in 16 bits, and summed as dot products in 32 bits. The
//! results are the same integers as those of single pairs (test `rows_equal_single_pairs`):
//! integer sums do not depend on their order.
//!
//! Where the relief of the block exceeds `RELIEF_LIMIT` height steps the partial sums might
//! overflow, and a processor without vectors gains nothing from them: there the pairs are
//! visited bit by bit, to the same integers.
//!
//! Cost: 5 instructions for each row and offset ([`OFFSETS`](super::OFFSETS)), 45 more for
//! each of those that has a pair, whether one or eight; bit by bit 30 for each pair. See
//! `docs/results-roughness.md`.
//!
//! Rejected: all 64 cells at each offset with 256-bit vectors chosen at run time, masked (as
//! fast where everything is measured, four times as slow on a sweep of rings); 32-bit lanes
//! (twice the instructions; the multiplication of 16-bit pairs that x86 and Arm have is then
//! not used); one cell's neighbours as a vector (gathers).

use super::offsets::{LAGS, REACH, offsets};
use super::sums::LagSums;
use core::array::from_fn;
use rugosa_grid::tile::places_of;
use rugosa_grid::{Sample, TILE, Tile, TileBits, Window, sample::PARTS};
use wide::{i16x8, i32x4};

const LANES: usize = TILE as usize;
const WIDTH: usize = LANES + 2 * REACH as usize;
const HEIGHT: usize = LANES + REACH as usize;
const CELLS: usize = WIDTH * HEIGHT;

/// Tiles across a block, and from its own upwards.
const ACROSS: usize = WIDTH / LANES;
const UP: usize = HEIGHT / LANES;

/// Largest relief of a block for 32-bit sums, in height steps: the most products in a lane
/// are two for each of 8 rows and 18 offsets, 288 · 6500 · 1088 < 2³¹; squares of heights
/// are carried over after each row, 36 · 6500² < 2³¹.
const RELIEF_LIMIT: i32 = 6_500;

/// Is this a processor whose 16-bit vectors are worth their masks?
const HAS_VECTORS: bool = !cfg!(target_arch = "arm");

/// Scratch memory: the samples of a tile and its margin, plane by plane; 7.9 kB. Places
/// that hold no sample hold anything.
#[derive(Clone, Debug)]
pub struct Block {
    /// \[height steps\]
    height: [i16; CELLS],
    /// from the block's corner \[1/64 cell\]
    east: [i16; CELLS],
    north: [i16; CELLS],
    /// less [`HALF`], so that it has a sign
    variance: [i16; CELLS],
    /// bit x: is there a sample?
    measured: [u64; HEIGHT],
    /// lowest and highest height
    extent: [i16; 2],
}

const HALF: u16 = 1 << 15;

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
            east: [0; CELLS],
            north: [0; CELLS],
            variance: [0; CELLS],
            measured: [0; HEIGHT],
            extent: [0; 2],
        }
    }

    /// The sums of `tile` over all samples that `measured` tells of its tiles.
    pub(super) fn sums(
        &mut self,
        window: &Window,
        samples: &[Sample],
        tile: Tile,
        measured: impl Fn(Tile) -> TileBits,
    ) -> [LagSums; LAGS] {
        self.fill(window, samples, tile, measured);
        let [low, high] = self.extent.map(i32::from);
        if HAS_VECTORS && high - low <= RELIEF_LIMIT {
            self.by_rows()
        } else {
            self.by_pairs()
        }
    }

    fn fill(
        &mut self,
        window: &Window,
        samples: &[Sample],
        tile: Tile,
        measured: impl Fn(Tile) -> TileBits,
    ) {
        let corner = tile.origin().offset(-REACH, 0);
        let columns: [usize; WIDTH] =
            from_fn(|x| part(window.column_part(corner.offset(x as i32, 0).x)));
        self.measured = [0; HEIGHT];
        self.extent = [i16::MAX, i16::MIN];
        for i in 0..ACROSS * UP {
            let (x, y) = (i % ACROSS, i / ACROSS);
            let near = measured(Tile::new(
                tile.x.wrapping_add(x as i32 - REACH / TILE),
                tile.y.wrapping_add(y as i32),
            ));
            for row in 0..LANES {
                let bits = near >> (LANES * row) & ALL;
                if bits == 0 {
                    continue;
                }
                let (x, y) = (LANES * x, LANES * y + row);
                let start = part(window.row_part(corner.offset(0, y as i32).y));
                self.measured[y] |= bits << x;
                for x in places_of(bits << x) {
                    if let Some(sample) = samples.get(start + columns[x]) {
                        self.put([x, y], sample);
                    }
                }
            }
        }
    }

    #[inline(always)]
    fn put(&mut self, [x, y]: [usize; 2], sample: &Sample) {
        let at = y * WIDTH + x;
        self.height[at] = sample.height;
        self.east[at] = PARTS as i16 * x as i16 + i16::from(sample.east);
        self.north[at] = PARTS as i16 * y as i16 + i16::from(sample.north);
        self.variance[at] = (sample.variance ^ HALF) as i16;
        let [low, high] = self.extent;
        self.extent = [low.min(sample.height), high.max(sample.height)];
    }

    /// The cells of a row of the tile that have a sample where the cell at an offset has
    /// one too; bit x.
    #[inline(always)]
    fn pairs(&self, row: usize, own: u64, (x, y): (i8, i8)) -> u64 {
        own & self.measured[row + y as usize] >> (REACH + i32::from(x))
    }

    fn by_pairs(&self) -> [LagSums; LAGS] {
        let mut all = [LagSums::default(); LAGS];
        for row in 0..LANES {
            let own = self.measured[row] >> REACH & ALL;
            if own == 0 {
                continue;
            }
            for (lag, sums) in all.iter_mut().enumerate() {
                for &offset in offsets(lag) {
                    let (lower, upper) = places(row, offset);
                    for lane in places_of(self.pairs(row, own, offset)) {
                        self.add_pair(sums, lower + lane, upper + lane);
                    }
                }
            }
        }
        all
    }

    #[inline(always)]
    fn add_pair(&self, sums: &mut LagSums, lower: usize, upper: usize) {
        let difference = |plane: &[i16; CELLS]| i32::from(plane[upper]) - i32::from(plane[lower]);
        let variance = |at: usize| u32::from(self.variance[at] as u16 ^ HALF);
        *sums += &LagSums::of_differences(
            difference(&self.height),
            [difference(&self.east), difference(&self.north)],
            variance(lower) + variance(upper),
        );
    }

    fn by_rows(&self) -> [LagSums; LAGS] {
        let mut all = [LagSums::default(); LAGS];
        for (lag, sums) in all.iter_mut().enumerate() {
            let mut lanes = Lanes::default();
            for row in 0..LANES {
                let own = self.measured[row] >> REACH & ALL;
                if own == 0 {
                    continue;
                }
                let lower = self.eight(places(row, (0, 0)).0);
                for &offset in offsets(lag) {
                    let pairs = self.pairs(row, own, offset);
                    if pairs != 0 {
                        lanes.add(&lower, &self.eight(places(row, offset).1), pairs);
                    }
                }
                lanes.carry();
            }
            lanes.add_to(sums);
        }
        all
    }

    #[inline(always)]
    fn eight(&self, at: usize) -> Eight {
        Eight {
            height: eight(&self.height, at),
            east: eight(&self.east, at),
            north: eight(&self.north, at),
            variance: eight(&self.variance, at),
        }
    }
}

/// The bits of a row of a tile.
const ALL: u64 = (1 << LANES) - 1;

/// A part of a slot; beyond all planes outside the window.
fn part(part: Option<usize>) -> usize {
    part.unwrap_or(usize::MAX / 2)
}

/// First places of a row of the tile and of its partner at `offset`.
#[inline(always)]
fn places(row: usize, (x, y): (i8, i8)) -> (usize, usize) {
    let lower = row * WIDTH + REACH as usize;
    let upper = (lower + y as usize * WIDTH).wrapping_add_signed(isize::from(x));
    (lower, upper)
}

/// Eight cells of a row.
struct Eight {
    height: i16x8,
    east: i16x8,
    north: i16x8,
    variance: i16x8,
}

#[inline(always)]
fn eight(plane: &[i16; CELLS], at: usize) -> i16x8 {
    // one check of the bounds for all
    let eight = plane[at..].first_chunk::<LANES>();
    i16x8::from(eight.copied().unwrap_or_default())
}

/// The sums of a lag, in lanes.
#[derive(Default)]
struct Lanes {
    square: i32x4,
    carried: u64,
    absolute: i32x4,
    trend: [i32x4; 2],
    spread: [i32x4; 3],
    noise: i32x4,
    pairs: i16x8,
}

/// One bit for each lane.
const BITS: [i16; LANES] = [1, 2, 4, 8, 16, 32, 64, 128];

impl Lanes {
    /// Adds the pairs of two rows that `pairs` tells.
    #[inline(always)]
    fn add(&mut self, lower: &Eight, upper: &Eight, pairs: u64) {
        let (bits, ones) = (i16x8::from(BITS), i16x8::splat(1));
        let mask = (i16x8::splat(pairs as i16) & bits).simd_eq(bits);
        let dz = (upper.height - lower.height) & mask;
        let dx = (upper.east - lower.east) & mask;
        let dy = (upper.north - lower.north) & mask;
        let one = ones & mask;
        self.square += dz.dot(dz);
        self.absolute += dz.abs().dot(ones);
        self.trend[0] += dz.dot(dx);
        self.trend[1] += dz.dot(dy);
        self.spread[0] += dx.dot(dx);
        self.spread[1] += dx.dot(dy);
        self.spread[2] += dy.dot(dy);
        self.noise += lower.variance.dot(one) + upper.variance.dot(one);
        self.pairs += one;
    }

    /// Makes room for the squares of another row.
    #[inline(always)]
    fn carry(&mut self) {
        self.carried += total(core::mem::take(&mut self.square)) as u64;
    }

    fn add_to(&self, sums: &mut LagSums) {
        let pairs = total(self.pairs.dot(i16x8::splat(1)));
        let noise = total(self.noise) + pairs * 2 * i64::from(HALF);
        *sums += &LagSums {
            square: self.carried,
            absolute: total(self.absolute) as u32,
            pairs: pairs as u32,
            noise: noise as u32,
            trend: self.trend.map(total),
            spread: self.spread.map(|lanes| total(lanes) as i32),
        };
    }
}

/// Sum of four; each is below 2³¹.
#[inline(always)]
fn total(lanes: i32x4) -> i64 {
    lanes.to_array().iter().map(|&lane| i64::from(lane)).sum()
}
