//! The sums of one tile in one go.
//!
//! The samples of the tile and of the margin that its pairs reach into are unpacked into a
//! block of separate planes, with a bit for each that is measured. The pairs of an offset are
//! then the bits that the tile has in common with the eight by eight cells at that offset.
//! Where they are few they are taken one by one. Where they are many, the eight differences of
//! a row are taken at once, in 16 bits, and summed as dot products in 32 bits. The results are
//! the same integers either way (test `blocks_equal_single_pairs`): integer sums do not depend
//! on their order.
//!
//! Where the relief of the block exceeds `RELIEF_LIMIT` height steps the partial sums of rows
//! might overflow, and a processor without vectors gains nothing from them: there all pairs
//! are taken one by one.
//!
//! Tiles are recomputed from west to east, so a block keeps what it shares with the next one.
//!
//! Cost on x86-64: 45 instructions for a pair, 600 for the rows of an offset, 20 for each offset
//! ([`OFFSETS`](super::OFFSETS)), 5,000 for the block. See `docs/results-roughness.md`.
//!
//! Rejected: each row of each offset as a vector, if it has a pair (the sweep of a scanner is
//! mostly gaps: 18.6 instead of 14 million instructions for a first one); samples as records,
//! four pairs of the list at a time (21 instructions for a pair, but 58 for four neighbours of
//! a row, which have to be transposed); all 64 cells at each offset with 256-bit vectors chosen
//! at run time, masked; 32-bit lanes (twice the instructions); one cell's neighbours as a
//! vector (gathers).

use super::offsets::{LAGS, REACH, offsets};
use super::sums::LagSums;
use core::array::from_fn;
use rugosa_grid::tile::{TileSlots, places_of};
use rugosa_grid::{Cell, Sample, TILE, Tile, TileBits, Window, sample::PARTS};
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
/// are carried over after each offset, 16 · 6500² < 2³¹.
const RELIEF_LIMIT: i32 = 6_500;

/// From so many pairs of an offset on, of 64, rows are the cheaper way.
const MANY: u32 = 8;

/// Is this a processor whose 16-bit vectors are worth their masks?
const HAS_VECTORS: bool = !cfg!(target_arch = "arm");

/// Scratch memory: the samples of a tile and its margin, plane by plane; 7.9 kB. Places
/// that hold no sample hold anything.
#[derive(Clone, Debug)]
pub struct Block {
    /// \[height steps\]
    height: [i16; CELLS],
    /// from the map's origin, but for multiples of 1024 cells \[1/64 cell\]
    east: [i16; CELLS],
    north: [i16; CELLS],
    /// less [`HALF`], so that it has a sign
    variance: [i16; CELLS],
    /// bit x: is there a sample?
    rows: [u64; HEIGHT],
    /// lowest and highest height, of each column of tiles
    extents: [[i16; 2]; ACROSS],
    /// whose sums it was filled for
    held: Option<Tile>,
}

const HALF: u16 = 1 << 15;

/// Lowest and highest of no heights.
const NO_HEIGHTS: [i16; 2] = [i16::MAX, i16::MIN];

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
            rows: [0; HEIGHT],
            extents: [[0; 2]; ACROSS],
            held: None,
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
        let known = self.fill(window, samples, tile, measured);
        let many = if HAS_VECTORS && self.is_level() {
            MANY
        } else {
            u32::MAX
        };
        from_fn(|lag| self.lag(lag, &known, many))
    }

    /// Do 32 bits hold the sums of rows?
    fn is_level(&self) -> bool {
        let low = self.extents.iter().map(|extent| extent[0]).min();
        let high = self.extents.iter().map(|extent| extent[1]).max();
        let [low, high] = [low, high].map(|height| height.map_or(0, i32::from));
        high - low <= RELIEF_LIMIT
    }

    /// The samples have changed: nothing that it holds is true any more.
    pub(super) fn forget(&mut self) {
        self.held = None;
    }

    /// Unpacks the samples that it does not hold from the tile to the west; tells which
    /// there are.
    fn fill(
        &mut self,
        window: &Window,
        samples: &[Sample],
        tile: Tile,
        measured: impl Fn(Tile) -> TileBits,
    ) -> Known {
        let mut first = 0;
        if self.held.replace(tile) == Some(Tile::new(tile.x.wrapping_sub(1), tile.y)) {
            self.move_east();
            first = ACROSS - 1;
        } else {
            self.rows = [0; HEIGHT];
        }
        for across in first..ACROSS {
            self.extents[across] = NO_HEIGHTS;
            for up in 0..UP {
                let x = tile.x.wrapping_add(across as i32 - REACH / TILE);
                let near = Tile::new(x, tile.y.wrapping_add(up as i32));
                let bits = measured(near);
                if bits != 0 {
                    self.put_tile(
                        [across, up],
                        near,
                        &TileSlots::of(window, near),
                        samples,
                        bits,
                    );
                }
            }
        }
        Known::of(&self.rows)
    }

    /// Makes room for the tiles to the east.
    fn move_east(&mut self) {
        for plane in [
            &mut self.height,
            &mut self.east,
            &mut self.north,
            &mut self.variance,
        ] {
            plane.copy_within(LANES.., 0);
        }
        self.rows = self.rows.map(|row| row >> LANES);
        self.extents.copy_within(1.., 0);
    }

    fn put_tile(
        &mut self,
        [across, up]: [usize; 2],
        tile: Tile,
        slots: &TileSlots,
        samples: &[Sample],
        bits: TileBits,
    ) {
        for (row, bits) in bits.to_le_bytes().into_iter().enumerate() {
            self.rows[LANES * up + row] |= u64::from(bits) << (LANES * across);
        }
        let [mut low, mut high] = self.extents[across];
        let corner = (LANES * up) * WIDTH + LANES * across;
        for place in places_of(bits) {
            if let Some(sample) = samples.get(slots.slot(place)) {
                self.put(corner + within(place), tile.cell(place), sample);
                (low, high) = (low.min(sample.height), high.max(sample.height));
            }
        }
        self.extents[across] = [low, high];
    }

    #[inline(always)]
    fn put(&mut self, at: usize, cell: Cell, sample: &Sample) {
        let position = |cell: i32, part: i8| {
            (PARTS as i16)
                .wrapping_mul(cell as i16)
                .wrapping_add(i16::from(part))
        };
        self.height[at] = sample.height;
        self.east[at] = position(cell.x, sample.east);
        self.north[at] = position(cell.y, sample.north);
        self.variance[at] = (sample.variance ^ HALF) as i16;
    }

    /// The sums of a lag, by rows where an offset has `many` pairs or more.
    #[inline(never)] // eight times would be too much flash
    fn lag(&self, lag: usize, known: &Known, many: u32) -> LagSums {
        let (own, lower) = (known.at((0, 0)), self.partners((0, 0)));
        let (mut sums, mut lanes) = (LagSums::EMPTY, Lanes::default());
        for &offset in offsets(lag) {
            let pairs = own & known.at(offset);
            if pairs == 0 {
                continue;
            }
            if pairs.count_ones() >= many {
                lanes.add_rows(&lower, &self.partners(offset), pairs);
            } else {
                add_pairs(&mut sums, &lower, &self.partners(offset), pairs);
            }
        }
        lanes.add_to(&mut sums);
        sums
    }

    /// The cells at an offset from those of the tile.
    #[inline(always)]
    fn partners(&self, (x, y): (i8, i8)) -> Partners<'_> {
        let start = (y as usize * WIDTH + REACH as usize).wrapping_add_signed(isize::from(x));
        Partners {
            height: span(&self.height, start),
            east: span(&self.east, start),
            north: span(&self.north, start),
            variance: span(&self.variance, start),
        }
    }
}

/// From the first cell of a tile to its last, in a plane.
const SPAN: usize = (LANES - 1) * WIDTH + LANES;

#[inline(always)]
fn span(plane: &[i16; CELLS], start: usize) -> &[i16; SPAN] {
    let span = plane.get(start..).and_then(<[i16]>::first_chunk);
    span.unwrap_or(const { &[0; SPAN] })
}

/// Where a place of a tile lies there.
#[inline(always)]
fn within(place: usize) -> usize {
    place + (place & (LANES * (LANES - 1))) * (WIDTH / LANES - 1)
}

/// The cells that lie at an offset from those of a tile.
struct Partners<'b> {
    height: &'b [i16; SPAN],
    east: &'b [i16; SPAN],
    north: &'b [i16; SPAN],
    variance: &'b [i16; SPAN],
}

impl Partners<'_> {
    #[inline(always)]
    fn row(&self, row: usize) -> Eight {
        let eight = |plane: &[i16; SPAN]| i16x8::new(from_fn(|x| plane[row * WIDTH + x]));
        Eight {
            height: eight(self.height),
            east: eight(self.east),
            north: eight(self.north),
            variance: eight(self.variance),
        }
    }
}

/// Adds pairs one by one.
#[inline(always)]
fn add_pairs(sums: &mut LagSums, lower: &Partners, upper: &Partners, pairs: TileBits) {
    for at in places_of(pairs).map(within) {
        let height = |of: &Partners| i32::from(of.height[at]);
        let variance = |of: &Partners| u32::from(of.variance[at] as u16 ^ HALF);
        let east = upper.east[at].wrapping_sub(lower.east[at]);
        let north = upper.north[at].wrapping_sub(lower.north[at]);
        *sums += &LagSums::of_differences(
            height(upper) - height(lower),
            [east, north].map(i32::from),
            variance(lower) + variance(upper),
        );
    }
}

/// Which places of a block hold a sample: for each column, and each row, those of the next
/// eight columns.
struct Known([u8; (WIDTH - LANES + 1) * HEIGHT]);

impl Known {
    fn of(rows: &[u64; HEIGHT]) -> Self {
        let mut known = Known([0; (WIDTH - LANES + 1) * HEIGHT]);
        for (y, &row) in rows.iter().enumerate().filter(|(_, row)| **row != 0) {
            let mut row = row;
            for column in known.0.chunks_exact_mut(HEIGHT) {
                column[y] = row as u8;
                row >>= 1;
            }
        }
        known
    }

    /// The cells of the tile that have a sample at an offset.
    #[inline(always)]
    fn at(&self, (x, y): (i8, i8)) -> TileBits {
        let start = (i32::from(x) + REACH) as usize * HEIGHT + y as usize;
        let rows = self.0.get(start..).and_then(<[u8]>::first_chunk);
        rows.map_or(0, |rows| TileBits::from_le_bytes(*rows))
    }
}

/// Eight cells of a row.
struct Eight {
    height: i16x8,
    east: i16x8,
    north: i16x8,
    variance: i16x8,
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
    pairs: u32,
}

/// One bit for each lane.
const BITS: [i16; LANES] = [1, 2, 4, 8, 16, 32, 64, 128];

impl Lanes {
    /// Adds the pairs of an offset, row by row.
    #[inline(always)]
    fn add_rows(&mut self, lower: &Partners, upper: &Partners, pairs: TileBits) {
        for (row, bits) in pairs.to_le_bytes().into_iter().enumerate() {
            self.add(&lower.row(row), &upper.row(row), bits);
        }
        self.carry();
        self.pairs += pairs.count_ones();
    }

    /// Adds the pairs of two rows that `bits` names.
    #[inline(always)]
    fn add(&mut self, lower: &Eight, upper: &Eight, bits: u8) {
        let bit = i16x8::from(BITS);
        let mask = (i16x8::splat(i16::from(bits)) & bit).simd_eq(bit);
        let dz = (upper.height - lower.height) & mask;
        let dx = (upper.east - lower.east) & mask;
        let dy = (upper.north - lower.north) & mask;
        self.square += dz.dot(dz);
        self.absolute += dz.abs().dot(i16x8::splat(1));
        self.trend[0] += dz.dot(dx);
        self.trend[1] += dz.dot(dy);
        self.spread[0] += dx.dot(dx);
        self.spread[1] += dx.dot(dy);
        self.spread[2] += dy.dot(dy);
        // a mask is −1
        self.noise -= lower.variance.dot(mask) + upper.variance.dot(mask);
    }

    /// Makes room for the squares of another offset.
    #[inline(always)]
    fn carry(&mut self) {
        self.carried += total(core::mem::take(&mut self.square)) as u64;
    }

    fn add_to(&self, sums: &mut LagSums) {
        let noise = total(self.noise) + i64::from(self.pairs) * 2 * i64::from(HALF);
        *sums += &LagSums {
            square: self.carried,
            absolute: total(self.absolute) as u32,
            pairs: self.pairs,
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
