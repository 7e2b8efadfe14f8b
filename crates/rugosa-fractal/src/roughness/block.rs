//! The sums of one tile in one go, with vectors.
//!
//! The samples of the tile and of the margin that its pairs reach into are unpacked into a
//! block of separate planes. The partners of a row of the tile at an offset are then eight
//! neighbours in each plane. Their eight differences are taken at once and summed in 16 bits,
//! squares in 32. A height that is none tells that there is no pair. The results are the integers
//! of single pairs (test `blocks_equal_single_pairs`): integer sums do not depend on their order.
//!
//! Where the relief of the block exceeds `RELIEF_LIMIT` height steps the sums might overflow; a
//! tile with few samples is mostly gaps; and a processor without vectors gains nothing from
//! rows. There the tile's pairs are taken one by one (`nearby.rs`).
//!
//! Tiles are recomputed from west to east, so a block keeps what it shares with the next one.
//!
//! Cost on x86-64: 30,000 instructions for all rows of a tile at all offsets, 4,000 for the block.
//!
//! Rejected: sums of a lag kept over all its offsets (they fall out of the registers: half the
//! speed); eight samples of a sparse tile gathered from each plane (three instructions for each
//! number); an offset's pairs one by one where they are few (each end of a run of bits is a
//! branch that the processor cannot foresee); samples as records, four pairs of a list at a time;
//! all 64 cells at each offset with 256-bit vectors chosen at run time; 32-bit lanes; an offset and
//! its mirror image in the same pass over the rows (too few registers).

use super::nearby::Nearby;
use super::offsets::{LAGS, NEAR_LAGS, REACH, offsets};
use super::sums::LagSums;
use core::array::from_fn;
use rugosa_grid::tile::{TileSlots, places_of};
use rugosa_grid::{Sample, TILE, Tile, TileBits, Window, sample::PARTS};
use wide::{i16x8, i32x4};

const LANES: usize = TILE as usize;
const WIDTH: usize = LANES + 2 * REACH as usize;
const HEIGHT: usize = LANES + REACH as usize;

/// Tiles across a block, and from its own upwards.
const ACROSS: usize = WIDTH / LANES;
const UP: usize = HEIGHT / LANES;

/// No memory where it is not used.
const CELLS: usize = if HAS_VECTORS { WIDTH * HEIGHT } else { 0 };

/// From the first cell of a tile to its last, in a plane.
const SPAN: usize = (LANES - 1) * WIDTH + LANES;

/// Largest relief of a block, in height steps: what eight rows add up to in 16 bits,
/// 8 · 4095 < 2¹⁵, and in 32 bits, 16 · 4095² < 2³¹.
const RELIEF_LIMIT: i32 = 4_095;

/// Is this a processor whose 16-bit vectors are worth a block?
pub(super) const HAS_VECTORS: bool = !cfg!(target_arch = "arm");

/// Scratch memory: the samples of a tile and its margin, plane by plane, where there are
/// vectors (7.7 kB), and which of them are measured (2 kB).
#[derive(Clone, Debug)]
pub struct Block {
    /// \[height steps\]; `NONE` where there is no sample, and other planes hold anything
    height: [i16; CELLS],
    /// from the cell's centre \[1/64 cell\]
    east: [i16; CELLS],
    north: [i16; CELLS],
    /// less [`HALF`], so that it has a sign
    variance: [i16; CELLS],
    /// lowest and highest height, of each column of tiles
    extents: [[i16; 2]; ACROSS],
    /// whose sums it was filled for
    held: Option<Tile>,
    pub(super) nearby: Nearby,
}

const HALF: u16 = 1 << 15;

/// No height.
const NONE: i16 = i16::MIN;

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
            height: [NONE; CELLS],
            east: [0; CELLS],
            north: [0; CELLS],
            variance: [0; CELLS],
            extents: [[0; 2]; ACROSS],
            held: None,
            nearby: Nearby::new(),
        }
    }

    /// The sums of `tile` over all samples that `measured` tells of its tiles; `None` where the
    /// relief is too large.
    pub(super) fn sums(
        &mut self,
        window: &Window,
        samples: &[Sample],
        tile: Tile,
        measured: impl Fn(Tile) -> TileBits,
    ) -> Option<[LagSums; LAGS]> {
        let own = measured(tile);
        self.fill(window, samples, tile, measured);
        if !self.is_level() {
            return None;
        }
        Some(from_fn(|lag| self.lag(lag, own)))
    }

    /// Do 16 bits hold the sums?
    fn is_level(&self) -> bool {
        let low = self.extents.iter().map(|extent| extent[0]).min();
        let high = self.extents.iter().map(|extent| extent[1]).max();
        let [low, high] = [low, high].map(|height| height.map_or(0, i32::from));
        high - low <= RELIEF_LIMIT && low != i32::from(NONE)
    }

    /// The samples have changed: nothing that it holds is true any more.
    pub(super) fn forget(&mut self) {
        self.held = None;
        self.nearby.forget();
    }

    /// Unpacks the samples that it does not hold from the tile to the west.
    fn fill(
        &mut self,
        window: &Window,
        samples: &[Sample],
        tile: Tile,
        measured: impl Fn(Tile) -> TileBits,
    ) {
        let mut first = 0;
        if self.held.replace(tile) == Some(Tile::new(tile.x.wrapping_sub(1), tile.y)) {
            self.move_east();
            first = ACROSS - 1;
        }
        for across in first..ACROSS {
            self.extents[across] = NO_HEIGHTS;
            for up in 0..UP {
                let x = tile.x.wrapping_add(across as i32 - REACH / TILE);
                let near = Tile::new(x, tile.y.wrapping_add(up as i32));
                self.clear_tile([across, up]);
                let bits = measured(near);
                if bits != 0 {
                    let slots = TileSlots::of(window, near);
                    self.put_tile([across, up], &slots, samples, bits);
                }
            }
        }
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
        self.extents.copy_within(1.., 0);
    }

    fn clear_tile(&mut self, [across, up]: [usize; 2]) {
        let corner = (LANES * up) * WIDTH + LANES * across;
        for row in self.height[corner..].chunks_mut(WIDTH).take(LANES) {
            row[..LANES].fill(NONE);
        }
    }

    fn put_tile(
        &mut self,
        [across, up]: [usize; 2],
        slots: &TileSlots,
        samples: &[Sample],
        bits: TileBits,
    ) {
        let [mut low, mut high] = self.extents[across];
        let corner = (LANES * up) * WIDTH + LANES * across;
        for place in places_of(bits) {
            if let Some(sample) = samples.get(slots.slot(place)) {
                self.put(corner + within(place), sample);
                (low, high) = (low.min(sample.height), high.max(sample.height));
            }
        }
        self.extents[across] = [low, high];
    }

    #[inline(always)]
    fn put(&mut self, at: usize, sample: &Sample) {
        self.height[at] = sample.height;
        self.east[at] = sample.east.into();
        self.north[at] = sample.north.into();
        self.variance[at] = (sample.variance ^ HALF) as i16;
    }

    fn lag(&self, lag: usize, own: TileBits) -> LagSums {
        match lag < NEAR_LAGS {
            true => self.by_rows::<true>(lag, own),
            false => self.by_rows::<false>(lag, own),
        }
    }

    fn by_rows<const NEAR: bool>(&self, lag: usize, own: TileBits) -> LagSums {
        let mut totals = Totals::default();
        let lower = self.at_offset((0, 0));
        for &(x, y) in offsets(lag) {
            let upper = self.at_offset((x, y));
            let twice = [x, y].map(|o| i16x8::splat(2 * PARTS as i16 * i16::from(o)));
            let mut pairs = Pairs::default();
            for (row, bits) in own.to_le_bytes().into_iter().enumerate() {
                if bits != 0 {
                    pairs.add::<NEAR>(&lower.row(row), &upper.row(row), twice);
                }
            }
            totals.add(&pairs, (x.into(), y.into()));
        }
        totals.sums()
    }

    /// The cells at an offset from those of the tile.
    #[inline(always)]
    fn at_offset(&self, (x, y): (i8, i8)) -> Planes<'_> {
        let start = (y as usize * WIDTH + REACH as usize).wrapping_add_signed(isize::from(x));
        Planes {
            height: span(&self.height, start),
            east: span(&self.east, start),
            north: span(&self.north, start),
            variance: span(&self.variance, start),
        }
    }
}

#[inline(always)]
fn span(plane: &[i16; CELLS], start: usize) -> &[i16; SPAN] {
    let span = plane.get(start..).and_then(<[i16]>::first_chunk);
    span.unwrap_or(const { &[NONE; SPAN] })
}

/// Where a place of a tile lies there.
#[inline(always)]
fn within(place: usize) -> usize {
    place + (place & (LANES * (LANES - 1))) * (WIDTH / LANES - 1)
}

/// The cells that lie at an offset from those of a tile.
struct Planes<'b> {
    height: &'b [i16; SPAN],
    east: &'b [i16; SPAN],
    north: &'b [i16; SPAN],
    variance: &'b [i16; SPAN],
}

impl Planes<'_> {
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

/// Eight cells of a row.
struct Eight {
    height: i16x8,
    east: i16x8,
    north: i16x8,
    variance: i16x8,
}

/// The sums over the pairs of an offset, in lanes.
#[derive(Default)]
struct Pairs {
    count: i16x8,
    rise: i16x8,
    /// of those that rise
    upward: i16x8,
    square: i32x4,
    noise: i32x4,
    excess: i32x4,
}

impl Pairs {
    /// Adds the pairs of eight samples with their partners.
    #[inline(always)]
    fn add<const NEAR: bool>(&mut self, lower: &Eight, upper: &Eight, twice: [i16x8; 2]) {
        let none = i16x8::splat(NONE);
        // a mask is −1
        let mask = lower.height.simd_gt(none) & upper.height.simd_gt(none);
        let dz = (upper.height - lower.height) & mask;
        self.count -= mask;
        self.rise += dz;
        self.upward += dz.max(i16x8::ZERO);
        self.square += dz.dot(dz);
        self.noise -= lower.variance.dot(mask) + upper.variance.dot(mask);
        if NEAR {
            let east = (upper.east - lower.east) & mask;
            let north = (upper.north - lower.north) & mask;
            self.excess += east.dot(east + twice[0]) + north.dot(north + twice[1]);
        }
    }
}

/// The sums over the pairs of a lag; in lanes what needs no offset.
#[derive(Default)]
struct Totals {
    /// pairs, Σ Δz and what they give with the offsets
    sums: LagSums,
    rise: i32,
    upward: i32x4,
    square: [u64; 4],
    noise: i32x4,
    excess: i32x4,
}

impl Totals {
    /// Adds the pairs of an offset.
    #[inline(always)]
    fn add(&mut self, pairs: &Pairs, offset: (i32, i32)) {
        let one = i16x8::splat(1);
        let [count, rise] = [pairs.count, pairs.rise].map(|lanes| lanes.dot(one).reduce_add());
        self.sums.add_offset(rise, count as u32, offset);
        self.rise += rise;
        self.upward += pairs.upward.dot(one);
        for (total, square) in self.square.iter_mut().zip(pairs.square.to_array()) {
            *total += u64::from(square as u32);
        }
        self.noise += pairs.noise;
        self.excess += pairs.excess;
    }

    #[inline(always)]
    fn sums(self) -> LagSums {
        let noise = self.noise.reduce_add() as u32;
        LagSums {
            square: self.square.iter().sum(),
            absolute: (2 * self.upward.reduce_add() - self.rise) as u32,
            noise: noise.wrapping_add(self.sums.pairs * 2 * u32::from(HALF)),
            excess: self.excess.reduce_add(),
            ..self.sums
        }
    }
}
