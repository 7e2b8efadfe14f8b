//! The counters of the structure function: integer sums over the pairs of a lag.
//!
//! For a pair of samples with elevation difference Δz \[height steps\], variances v_a and
//! v_b \[height steps²\], whose cells lie o = (x, y) \[cells\] and they themselves δ apart:
//!
//! | sum | | bound per tile and lag | kept as |
//! |---|---|---|---|
//! | A | Σ \|Δz\| | 64 · 18 · 65 535 = 7.5e7 | u32 |
//! | B | Σ Δz² | 4.9e12 | u64 |
//! | C | pairs | 1152 | u32 |
//! | N | Σ (v_a + v_b) | 1.5e8 | u32 |
//! | T | Σ Δz o | 1.2e9 | 2 × i32 |
//! | G | Σ o oᵀ | 2.9e5 | 3 × i32 |
//! | X | Σ (\|δ\|² − \|o\|²), up to lags of 4 cells | 4.4e7 | i32 |
//!
//! The places of the samples in their cells are noise of mean zero about o, so the sums of the
//! trend take o: T and G then cost nothing for each pair but Σ Δz, which all pairs of an offset
//! share. The distance of a pair matters where it is short; beyond 4 cells the places change
//! |δ|² by 1 % or less, which is known from the short lags ([`Pool`](super::Pool)).
//!
//! Every sum is an integer, so a pair that was added is taken back without a trace: after
//! any history the sums equal, bit for bit, those of a pass over the current samples
//! (Arakawa and Krotkov 1996, § 2.4, recompute A and C from all pairs instead).

use super::offsets::{LAGS, NEAR_LAGS};
use core::ops::{AddAssign, SubAssign};
use rugosa_grid::{Sample, TileBits, sample::PARTS};

/// Sums over the pairs of one lag whose lower member lies in one tile; 48 bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(C)]
pub struct LagSums {
    /// B = Σ Δz² \[height steps²\]
    pub square: u64,
    /// A = Σ |Δz| \[height steps\]
    pub absolute: u32,
    /// C, the number of pairs
    pub pairs: u32,
    /// N = Σ (v_a + v_b) \[height steps²\]
    pub noise: u32,
    /// X = Σ (|δ|² − |o|²) \[(1/64 cell)²\]; 0 for lags beyond [`NEAR_LAGS`]
    pub excess: i32,
    /// T = Σ Δz o \[height steps · cell\], x and y
    pub trend: [i32; 2],
    /// G = Σ o oᵀ \[cell²\]: xx, xy, yy
    pub spread: [i32; 3],
}

impl LagSums {
    /// The sums of the single pair (lower, upper) of lag number `lag` whose cells lie `(x, y)`
    /// cells apart.
    ///
    /// ```
    /// use rugosa_fractal::roughness::LagSums;
    /// use rugosa_grid::Sample;
    /// let lower = Sample::measured(100, 4, 0, 0, 255);
    /// let upper = Sample::measured(95, 2, -16, 0, 255); // a quarter of a cell to the west
    /// let pair = LagSums::of_pair(1, &lower, &upper, (2, 0));
    /// assert_eq!((pair.pairs, pair.absolute, pair.square, pair.noise), (1, 5, 25, 6));
    /// // cells 2 to the east, downward; the samples 1.75
    /// assert_eq!((pair.spread, pair.trend), ([4, 0, 0], [-5 * 2, 0]));
    /// assert_eq!(pair.excess, 112 * 112 - 128 * 128);
    /// let mut sums = LagSums::EMPTY;
    /// sums += &pair;
    /// sums -= &pair;
    /// assert_eq!(sums, LagSums::EMPTY);
    /// ```
    #[inline(always)]
    pub fn of_pair(lag: usize, lower: &Sample, upper: &Sample, (x, y): (i32, i32)) -> Self {
        let mut sums = LagSums::EMPTY;
        let rise = sums.add_heights(lower, upper);
        sums.add_offset(rise, 1, (x, y));
        if lag < NEAR_LAGS {
            sums.add_places(lower, upper, (x, y));
        }
        sums
    }

    /// Adds to A, B and N of a pair; returns its Δz.
    #[inline(always)]
    pub(super) fn add_heights(&mut self, lower: &Sample, upper: &Sample) -> i32 {
        let rise = i32::from(upper.height) - i32::from(lower.height);
        let size = rise.unsigned_abs();
        self.square += u64::from(size) * u64::from(size);
        self.absolute += size;
        self.noise += u32::from(lower.variance) + u32::from(upper.variance);
        rise
    }

    /// Adds to X of a pair: |δ|² − |o|² = ε (2 o + ε), where δ = o + ε.
    #[inline(always)]
    pub(super) fn add_places(&mut self, lower: &Sample, upper: &Sample, (x, y): (i32, i32)) {
        let east = i32::from(upper.east) - i32::from(lower.east);
        let north = i32::from(upper.north) - i32::from(lower.north);
        self.excess += east * (2 * PARTS * x + east) + north * (2 * PARTS * y + north);
    }

    /// Adds what pairs of one offset share: their number, T and G, for a sum of their Δz.
    #[inline(always)]
    pub(super) fn add_offset(&mut self, rise: i32, pairs: u32, (x, y): (i32, i32)) {
        let count = pairs as i32;
        self.pairs += pairs;
        self.trend = [self.trend[0] + rise * x, self.trend[1] + rise * y];
        let [xx, xy, yy] = self.spread;
        self.spread = [xx + count * x * x, xy + count * x * y, yy + count * y * y];
    }
}

impl AddAssign<&LagSums> for LagSums {
    #[inline(always)]
    fn add_assign(&mut self, other: &LagSums) {
        self.square += other.square;
        self.absolute += other.absolute;
        self.pairs += other.pairs;
        self.noise += other.noise;
        self.excess += other.excess;
        for axis in 0..2 {
            self.trend[axis] += other.trend[axis];
        }
        for part in 0..3 {
            self.spread[part] += other.spread[part];
        }
    }
}

impl SubAssign<&LagSums> for LagSums {
    #[inline(always)]
    fn sub_assign(&mut self, other: &LagSums) {
        self.square -= other.square;
        self.absolute -= other.absolute;
        self.pairs -= other.pairs;
        self.noise -= other.noise;
        self.excess -= other.excess;
        for axis in 0..2 {
            self.trend[axis] -= other.trend[axis];
        }
        for part in 0..3 {
            self.spread[part] -= other.spread[part];
        }
    }
}

/// The counters of one tile and what the current transaction knows of it; 400 bytes.
#[derive(Clone, Copy, Debug, Default)]
pub struct TileSums {
    /// the sums, lag by lag
    pub lags: [LagSums; LAGS],
    /// which of its cells are measured
    pub(super) measured: TileBits,
    /// samples of the tile that changed since the last commit
    pub(super) changes: u16,
    /// the same of all tiles whose pairs it may own
    pub(super) news: u16,
    /// a pass was the cheaper way at the last commit: the next one will need it too
    pub(super) is_busy: bool,
    /// its sums are out of date: recompute them at the commit
    pub(super) stale: bool,
    /// its sums differ from what the reader of [`TileSums::take_changed`] last saw
    pub(super) changed: bool,
}

impl LagSums {
    /// No pairs.
    pub const EMPTY: LagSums = LagSums {
        square: 0,
        absolute: 0,
        pairs: 0,
        noise: 0,
        excess: 0,
        trend: [0; 2],
        spread: [0; 3],
    };
}

impl TileSums {
    /// No pairs.
    pub const EMPTY: TileSums = TileSums {
        lags: [LagSums::EMPTY; LAGS],
        measured: 0,
        changes: 0,
        news: 0,
        is_busy: false,
        stale: false,
        changed: false,
    };

    /// Did the sums change since this was last asked? Asking resets it.
    ///
    /// ```
    /// use rugosa_fractal::roughness::{Block, StructureFunction, TileSums};
    /// use rugosa_grid::{Cell, Sample, Window};
    /// let window = Window::new(33, Cell::new(0, 0));
    /// let mut samples = [Sample::UNKNOWN; 33 * 33];
    /// let (mut tiles, mut block) = ([TileSums::EMPTY; 25], Block::new());
    /// let mut structure = StructureFunction::new(33, &mut tiles, &mut block);
    /// samples[0] = Sample::measured(7, 0, 0, 0, 255);
    /// structure.replaced(&window, &samples, Cell::new(0, 0), &Sample::UNKNOWN);
    /// structure.commit(&window, &mut samples);
    /// let sums = structure.tiles_mut();
    /// assert!(sums[0].take_changed() && !sums[0].take_changed());
    /// assert!(!sums[24].take_changed()); // out of reach of cell (0, 0)
    /// ```
    pub fn take_changed(&mut self) -> bool {
        core::mem::take(&mut self.changed)
    }

    pub(super) fn set_measured(&mut self, place: usize, is_measured: bool) {
        let bit = 1 << place;
        self.measured = (self.measured & !bit) | if is_measured { bit } else { 0 };
    }

    /// Which of its cells are measured.
    pub fn measured(&self) -> TileBits {
        self.measured
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_are_as_stated() {
        assert_eq!(core::mem::size_of::<LagSums>(), 48);
        assert_eq!(core::mem::size_of::<TileSums>(), 400);
    }

    #[test]
    fn the_bounds_fit_at_the_extremes() {
        let low = Sample::measured(i16::MIN, u16::MAX, -32, -32, 0);
        let high = Sample::measured(i16::MAX, u16::MAX, 32, 32, 0);
        let (mut sums, pair) = (
            LagSums::default(),
            LagSums::of_pair(7, &low, &high, (16, 16)),
        );
        for _ in 0..64 * 18 {
            sums += &pair;
        }
        assert_eq!(sums.square, 1152 * 65_535 * 65_535);
        assert_eq!(sums.trend, [1152 * 65_535 * 16; 2]);
        assert_eq!(sums.spread, [1152 * 16 * 16; 3]);
        for _ in 0..64 * 18 {
            sums -= &pair;
        }
        assert_eq!(sums, LagSums::default());
    }
}
