//! The sums of one tile in one go, row by row.
//!
//! The samples of the tile and of the margin that its pairs reach into are unpacked into
//! a block of separate planes; then each offset is a shifted difference of the tile's
//! 64 cells with the block's, in plain 16-bit arithmetic that a compiler turns into vector
//! instructions, and dot products of those differences. Cells without a sample are masked. The results are the same integers as those of single pairs
//! (test `rows_equal_single_pairs`): integer sums do not depend on their order.
//!
//! Elevations are taken relative to the block's lowest one. Where the relief of the block
//! exceeds `RELIEF_LIMIT` height steps the 32-bit partial sums might overflow and the
//! pairs are summed one by one instead, to the same integers.
//!
//! With the feature `simd` the same code is compiled twice and the wider vectors are
//! chosen at run time.
//!
//! Cost: 64 × [`OFFSETS`](super::OFFSETS) masked pairs whatever is measured, about 7
//! instructions each with 256-bit vectors; see `docs/roughness.md`.
//!
//! Rejected: 32-bit lanes (twice the instructions; the multiplication of 16-bit pairs
//! that x86 and Arm have is then not used), one cell's neighbours as a vector (gathers).

use super::offsets::{LAGS, REACH, offsets};
use super::sums::LagSums;
use rugosa_grid::{Sample, TILE, Tile, Window, sample::PARTS};

const LANES: usize = TILE as usize;
const WIDTH: usize = LANES + 2 * REACH as usize;
const HEIGHT: usize = LANES + REACH as usize;
const CELLS: usize = WIDTH * HEIGHT;
const PLACES: usize = LANES * LANES;

/// Largest relief of a block for 32-bit sums over 64 pairs, in height steps:
/// 64 · 8000² < 2³² and 64 · 8000 · 1088 < 2³¹.
const RELIEF_LIMIT: i32 = 8_000;

/// Scratch memory: the samples of a tile and its margin, plane by plane; 9 600 bytes.
#[derive(Clone, Debug)]
pub struct Block {
    height: [i16; CELLS],
    variance: [u16; CELLS],
    east: [i16; CELLS],
    north: [i16; CELLS],
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
        let columns: [usize; WIDTH] =
            core::array::from_fn(|x| part(window.column_part(corner.offset(x as i32, 0).x)));
        for y in 0..HEIGHT {
            let row = part(window.row_part(corner.offset(0, y as i32).y));
            for (x, &column) in columns.iter().enumerate() {
                let sample = samples.get(row + column).copied().unwrap_or_default();
                self.put(y * WIDTH + x, sample);
            }
        }
    }

    #[inline(always)]
    fn put(&mut self, at: usize, sample: Sample) {
        self.mask[at] = -i16::from(sample.is_measured());
        self.height[at] = sample.height;
        self.variance[at] = sample.variance;
        self.east[at] = sample.east.into();
        self.north[at] = sample.north.into();
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
        let (east, north) = (self.east[at] as i8, self.north[at] as i8);
        Sample::measured(self.height[at], self.variance[at], east, north, 0)
    }

    #[cfg(not(feature = "simd"))]
    fn by_rows(&self) -> [LagSums; LAGS] {
        self.by_dot_products()
    }

    #[cfg(feature = "simd")]
    fn by_rows(&self) -> [LagSums; LAGS] {
        pulp::Arch::new().dispatch(
            #[inline(always)]
            || self.by_dot_products(),
        )
    }

    #[inline(always)]
    fn by_dot_products(&self) -> [LagSums; LAGS] {
        let tile = Shifted::new(self, (0, 0));
        let mut all = [LagSums::default(); LAGS];
        for (lag, sums) in all.iter_mut().enumerate() {
            let mut partners = Partners::default();
            for &offset in offsets(lag) {
                let upper = Shifted::new(self, offset);
                Differences::new(&tile, &upper, offset, &mut partners).add_to(sums);
            }
            partners.add_to(sums, &tile.variance);
        }
        all
    }
}

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

/// The cells that lie at one offset from those of the tile.
struct Shifted {
    height: [i16; PLACES],
    variance: [u16; PLACES],
    east: [i16; PLACES],
    north: [i16; PLACES],
    mask: [i16; PLACES],
}

impl Shifted {
    #[inline(always)]
    fn new(block: &Block, offset: (i8, i8)) -> Self {
        Shifted {
            height: shifted(&block.height, offset),
            variance: shifted(&block.variance, offset),
            east: shifted(&block.east, offset),
            north: shifted(&block.north, offset),
            mask: shifted(&block.mask, offset),
        }
    }
}

#[inline(always)]
fn shifted<T: Copy + Default>(plane: &[T; CELLS], offset: (i8, i8)) -> [T; PLACES] {
    let mut out = [T::default(); PLACES];
    for (row, out) in out.chunks_exact_mut(LANES).enumerate() {
        let upper = places(row, offset).1;
        out.copy_from_slice(&plane[upper..upper + LANES]);
    }
    out
}

/// For each cell of the tile: its partners so far and the sum of their variances.
struct Partners {
    count: [i16; PLACES],
    noise: [u32; PLACES],
}

impl Default for Partners {
    fn default() -> Self {
        Partners {
            count: [0; PLACES],
            noise: [0; PLACES],
        }
    }
}

impl Partners {
    #[inline(always)]
    fn add_to(&self, sums: &mut LagSums, own: &[u16; PLACES]) {
        for ((&count, &noise), &own) in self.count.iter().zip(&self.noise).zip(own) {
            let count = u32::from(count as u16);
            sums.pairs += count;
            sums.noise += noise + count * u32::from(own);
        }
    }
}

/// Differences of a tile with the cells at one offset; zero where there is no pair.
struct Differences {
    dz: [i16; PLACES],
    dx: [i16; PLACES],
    dy: [i16; PLACES],
}

impl Differences {
    #[inline(always)]
    fn new(tile: &Shifted, upper: &Shifted, (x, y): (i8, i8), partners: &mut Partners) -> Self {
        let (x, y) = (PARTS as i16 * i16::from(x), PARTS as i16 * i16::from(y));
        let mut out = Differences {
            dz: [0; PLACES],
            dx: [0; PLACES],
            dy: [0; PLACES],
        };
        for k in 0..PLACES {
            let mask = upper.mask[k] & tile.mask[k];
            out.dz[k] = upper.height[k].wrapping_sub(tile.height[k]) & mask;
            out.dx[k] = upper.east[k].wrapping_sub(tile.east[k]).wrapping_add(x) & mask;
            out.dy[k] = upper.north[k].wrapping_sub(tile.north[k]).wrapping_add(y) & mask;
            partners.count[k] = partners.count[k].wrapping_sub(mask);
            let noise = u32::from(upper.variance[k] & mask as u16);
            partners.noise[k] = partners.noise[k].wrapping_add(noise);
        }
        out
    }

    #[inline(always)]
    fn add_to(&self, sums: &mut LagSums) {
        let Differences { dz, dx, dy } = self;
        let magnitude = core::array::from_fn(|k| dz[k].wrapping_abs());
        sums.square += u64::from(dot(dz, dz) as u32);
        sums.absolute += dot(&magnitude, &[1; PLACES]) as u32;
        sums.trend[0] += i64::from(dot(dz, dx));
        sums.trend[1] += i64::from(dot(dz, dy));
        sums.spread[0] += dot(dx, dx);
        sums.spread[1] += dot(dx, dy);
        sums.spread[2] += dot(dy, dy);
    }
}

/// Σ a b in 32 bits, two products at a time: the instruction that many machines have.
#[inline(always)]
fn dot(a: &[i16; PLACES], b: &[i16; PLACES]) -> i32 {
    let mut products = [0i32; PLACES / 2];
    for (k, product) in products.iter_mut().enumerate() {
        let even = i32::from(a[2 * k]) * i32::from(b[2 * k]);
        *product = even.wrapping_add(i32::from(a[2 * k + 1]) * i32::from(b[2 * k + 1]));
    }
    products
        .iter()
        .fold(0, |sum, &product| sum.wrapping_add(product))
}
