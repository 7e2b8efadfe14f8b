//! The counters of the structure function: integer sums over the pairs of a lag.
//!
//! For a pair of samples with elevation difference Δz \[height steps\], variances v_a and
//! v_b \[height steps²\] and horizontal difference δ = (δx, δy) \[1/64 cell\]:
//!
//! | sum | | bound per tile and lag | kept as |
//! |---|---|---|---|
//! | A | Σ \|Δz\| | 64 · 18 · 65 535 = 7.5e7 | u32 |
//! | B | Σ Δz² | 4.9e12 | u64 |
//! | C | pairs | 1152 | u32 |
//! | N | Σ (v_a + v_b) | 1.5e8 | u32 |
//! | T | Σ Δz δ | 8.2e10 | 2 × i64 |
//! | G | Σ δ δᵀ (so Σ \|δ\|² = Gxx + Gyy) | 64 · 18 · 1088² = 1.4e9 | 3 × i32 |
//!
//! Every sum is an integer, so a pair that was added is taken back without a trace: after
//! any history the sums equal, bit for bit, those of a pass over the current samples
//! (Arakawa and Krotkov 1996, § 2.4, recompute A and C from all pairs instead).

use super::offsets::LAGS;
use core::ops::{AddAssign, SubAssign};
use rugosa_grid::{Sample, TileBits, sample::PARTS};

/// Sums over the pairs of one lag whose lower member lies in one tile; 48 bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(C)]
pub struct LagSums {
    /// B = Σ Δz² \[height steps²\]
    pub square: u64,
    /// T = Σ Δz δ \[height steps / 64 cell\], x and y
    pub trend: [i64; 2],
    /// A = Σ |Δz| \[height steps\]
    pub absolute: u32,
    /// C, the number of pairs
    pub pairs: u32,
    /// N = Σ (v_a + v_b) \[height steps²\]
    pub noise: u32,
    /// G = Σ δ δᵀ \[(1/64 cell)²\]: xx, xy, yy
    pub spread: [i32; 3],
}

impl LagSums {
    /// The sums of the single pair (lower, upper) whose cells lie `(x, y)` cells apart.
    ///
    /// ```
    /// use rugosa_fractal::roughness::LagSums;
    /// use rugosa_grid::Sample;
    /// let lower = Sample::measured(100, 4, 0, 0, 255);
    /// let upper = Sample::measured(95, 2, -16, 0, 255); // a quarter of a cell to the west
    /// let pair = LagSums::of_pair(&lower, &upper, (2, 0));
    /// assert_eq!((pair.pairs, pair.absolute, pair.square, pair.noise), (1, 5, 25, 6));
    /// // 1.75 cells to the east, downward
    /// assert_eq!((pair.spread, pair.trend), ([112 * 112, 0, 0], [-5 * 112, 0]));
    /// let mut sums = LagSums::EMPTY;
    /// sums += &pair;
    /// sums -= &pair;
    /// assert_eq!(sums, LagSums::EMPTY);
    /// ```
    #[inline(always)]
    pub fn of_pair(lower: &Sample, upper: &Sample, (x, y): (i32, i32)) -> Self {
        let dz = i32::from(upper.height) - i32::from(lower.height);
        let dx = PARTS * x + i32::from(upper.east) - i32::from(lower.east);
        let dy = PARTS * y + i32::from(upper.north) - i32::from(lower.north);
        let noise = u32::from(lower.variance) + u32::from(upper.variance);
        LagSums::of_differences(dz, [dx, dy], noise)
    }

    /// The same from its differences \[height steps, 1/64 cell\] and the sum of its variances.
    #[inline(always)]
    pub(super) fn of_differences(dz: i32, [dx, dy]: [i32; 2], noise: u32) -> Self {
        let magnitude = dz.unsigned_abs();
        LagSums {
            square: u64::from(magnitude) * u64::from(magnitude),
            trend: [i64::from(dz) * i64::from(dx), i64::from(dz) * i64::from(dy)],
            absolute: magnitude,
            pairs: 1,
            noise,
            spread: [dx * dx, dx * dy, dy * dy],
        }
    }
}

impl AddAssign<&LagSums> for LagSums {
    #[inline(always)]
    fn add_assign(&mut self, other: &LagSums) {
        self.square += other.square;
        self.absolute += other.absolute;
        self.pairs += other.pairs;
        self.noise += other.noise;
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
    /// which of its cells were measured at the last commit
    pub(super) measured: TileBits,
    /// samples of the tile that changed since the last commit
    pub(super) changes: u16,
    /// the same of all tiles whose pairs it may own
    pub(super) news: u16,
    /// its sums are out of date: recompute them at the commit
    pub(super) stale: bool,
    /// its sums differ from what the reader of [`TileSums::take_changed`] last saw
    pub(super) changed: bool,
}

impl LagSums {
    /// No pairs.
    pub const EMPTY: LagSums = LagSums {
        square: 0,
        trend: [0; 2],
        absolute: 0,
        pairs: 0,
        noise: 0,
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

    /// Which of its cells were measured at the last commit.
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
        let (mut sums, pair) = (LagSums::default(), LagSums::of_pair(&low, &high, (16, 16)));
        for _ in 0..64 * 18 {
            sums += &pair;
        }
        assert_eq!(sums.square, 1152 * 65_535 * 65_535);
        assert_eq!(sums.trend, [1152 * 65_535 * 1088; 2]);
        assert_eq!(sums.spread, [1152 * 1088 * 1088; 3]);
        for _ in 0..64 * 18 {
            sums -= &pair;
        }
        assert_eq!(sums, LagSums::default());
    }
}
