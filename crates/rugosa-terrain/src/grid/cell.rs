//! One cell: variance-weighted mean with a gate.
//!
//! A return of elevation z and variance v meets a cell of mean e and variance w:
//!
//! ```text
//! gate:  (z − e)² ≤ k² (w + v + relief²)
//! mean:  g = w / (w + v),   e ← e + g (z − e),   w ← max(g v, floor)
//! ```
//!
//! the recursive form of the variance-weighted mean (a Kalman filter with one state).
//! `relief` is the standard deviation of true heights inside one cell: without it a
//! well-measured cell on a slope would refuse every return that is not at its middle.
//! The floor (a twelfth of a squared height step) keeps the cell able to follow.
//!
//! A gated return changes nothing but a counter. After `restart_after` gated returns in
//! a row the cell starts afresh from the last of them, so that a change that persists
//! wins. Minimum and maximum are those of the returns that were fused since the start.
//!
//! Cost: 12 floating operations, one of them a division.

use super::SavedCell;

/// What a cell holds, 16 bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(C)]
pub struct GroundCell {
    pub(super) elevation: f32,
    pub(super) variance: f32,
    pub(super) min: i16,
    pub(super) max: i16,
    /// low 13 bits: returns fused (saturates); high 3 bits: gated returns in a row
    tally: u16,
    pub(super) last_sweep: u16,
}

impl GroundCell {
    /// A cell without returns.
    pub const EMPTY: GroundCell = GroundCell {
        elevation: 0.0,
        variance: 0.0,
        min: 0,
        max: 0,
        tally: 0,
        last_sweep: 0,
    };
}

const COUNT_BITS: u32 = 13;
const COUNT_MAX: u16 = (1 << COUNT_BITS) - 1;
/// Most gated returns in a row that a cell can count.
pub(super) const RUN_MAX: u8 = 7;

/// A return as the cell sees it.
#[derive(Clone, Copy)]
pub(super) struct Height {
    /// elevation \[m\]
    pub metres: f32,
    /// the same in height steps above the datum
    pub steps: i16,
    /// variance \[m²\]
    pub variance: f32,
}

/// The parameters of the fusion, as the inner loop needs them.
#[derive(Clone, Copy, Debug)]
pub(super) struct Gate {
    /// k²
    pub sigmas2: f32,
    /// relief² \[m²\]
    pub relief2: f32,
    /// least variance of a cell \[m²\]
    pub floor: f32,
    /// gated returns in a row that restart a cell
    pub restart_after: u16,
}

/// What became of a return in its cell.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Met {
    First,
    Merged,
    Gated,
    Restarted,
}

impl GroundCell {
    /// Returns fused since the cell started; saturates at 8191.
    ///
    /// ```
    /// use rugosa_grid::{Cell, Sample, Window};
    /// use rugosa_terrain::{ElevationGrid, GridConfig, GroundCell, Point};
    /// let (mut cells, mut samples) = ([GroundCell::EMPTY; 33 * 33], [Sample::UNKNOWN; 33 * 33]);
    /// let window = Window::new(33, Cell::new(0, 0));
    /// let mut grid =
    ///     ElevationGrid::new(GridConfig::new(0.1), window, &mut cells, &mut samples).unwrap();
    /// let point = Point { position: [0.05, 0.05, 1.0], variance: 1e-4, depression: 1.0 };
    /// grid.fuse(&point, 1);
    /// grid.fuse(&point, 1);
    /// let slot = window.slot(Cell::new(0, 0)).unwrap();
    /// assert_eq!((cells[slot].count(), cells[slot + 1].count()), (2, 0));
    /// ```
    pub fn count(&self) -> u16 {
        self.tally & COUNT_MAX
    }

    /// The count and the gated returns in a row, packed.
    pub(super) fn tally(&self) -> u16 {
        self.tally
    }

    /// A cell as it was; `heights` are its extremes above the datum.
    pub(super) fn restored(saved: &SavedCell, [min, max]: [i16; 2]) -> Self {
        GroundCell {
            elevation: saved.elevation,
            variance: saved.variance,
            min,
            max,
            tally: saved.tally,
            last_sweep: saved.last_sweep,
        }
    }

    #[inline]
    pub(super) fn take(&mut self, gate: &Gate, height: Height, sweep: u16) -> Met {
        if self.tally == 0 {
            self.start(gate, height, sweep);
            return Met::First;
        }
        let innovation = height.metres - self.elevation;
        let spread = self.variance + height.variance;
        if innovation * innovation > gate.sigmas2 * (spread + gate.relief2) {
            return self.refuse(gate, height, sweep);
        }
        let gain = self.variance / spread;
        self.elevation += gain * innovation;
        self.variance = at_least(gain * height.variance, gate.floor);
        self.min = self.min.min(height.steps);
        self.max = self.max.max(height.steps);
        self.tally = self.count() + u16::from(self.count() < COUNT_MAX);
        self.last_sweep = sweep;
        Met::Merged
    }

    fn start(&mut self, gate: &Gate, height: Height, sweep: u16) {
        *self = GroundCell {
            elevation: height.metres,
            variance: at_least(height.variance, gate.floor),
            min: height.steps,
            max: height.steps,
            tally: 1,
            last_sweep: sweep,
        };
    }

    fn refuse(&mut self, gate: &Gate, height: Height, sweep: u16) -> Met {
        let run = (self.tally >> COUNT_BITS) + 1;
        if run >= gate.restart_after {
            self.start(gate, height, sweep);
            return Met::Restarted;
        }
        self.tally = self.count() | (run << COUNT_BITS);
        Met::Gated
    }
}

#[inline]
fn at_least(x: f32, floor: f32) -> f32 {
    if x < floor { floor } else { x }
}

#[cfg(test)]
mod tests {
    use super::*;

    const GATE: Gate = Gate {
        sigmas2: 9.0,
        relief2: 1e-4,
        floor: 1e-8,
        restart_after: 4,
    };

    fn at(metres: f32, variance: f32) -> Height {
        Height {
            metres,
            steps: (metres * 1000.0) as i16,
            variance,
        }
    }

    #[test]
    fn the_mean_is_weighted_by_variance() {
        let mut cell = GroundCell::default();
        assert!(cell.take(&GATE, at(1.00, 4e-4), 1) == Met::First);
        assert!(cell.take(&GATE, at(1.03, 1e-4), 2) == Met::Merged);
        assert!(cell.take(&GATE, at(1.02, 2e-4), 3) == Met::Merged);
        let weight: f32 = 1.0 / 4e-4 + 1.0 / 1e-4 + 1.0 / 2e-4;
        let mean = (1.00 / 4e-4 + 1.03 / 1e-4 + 1.02 / 2e-4) / weight;
        assert!((cell.elevation - mean).abs() < 1e-6);
        assert!((cell.variance * weight - 1.0).abs() < 1e-5);
        assert_eq!(
            (cell.min, cell.max, cell.count(), cell.last_sweep),
            (1000, 1030, 3, 3)
        );
    }

    #[test]
    fn an_outlier_is_refused_and_a_change_wins() {
        let mut cell = GroundCell::default();
        cell.take(&GATE, at(0.0, 1e-4), 1);
        for _ in 0..3 {
            assert!(cell.take(&GATE, at(0.5, 1e-4), 2) == Met::Gated);
        }
        assert_eq!((cell.elevation, cell.max, cell.last_sweep), (0.0, 0, 1));
        assert!(cell.take(&GATE, at(0.001, 1e-4), 3) == Met::Merged);
        for _ in 0..3 {
            assert!(cell.take(&GATE, at(0.5, 1e-4), 4) == Met::Gated);
        }
        assert!(cell.take(&GATE, at(0.51, 1e-4), 5) == Met::Restarted);
        assert_eq!((cell.elevation, cell.min, cell.count()), (0.51, 510, 1));
    }

    #[test]
    fn the_count_saturates_beside_the_run() {
        assert_eq!(core::mem::size_of::<GroundCell>(), 16);
        let mut cell = GroundCell::default();
        for _ in 0..9000 {
            cell.take(&GATE, at(0.0, 1e-5), 1);
        }
        assert_eq!(cell.count(), 8191);
        cell.take(&GATE, at(9.0, 1e-4), 1);
        assert_eq!((cell.count(), cell.tally >> 13), (8191, 1));
        assert_eq!(cell.variance, GATE.floor);
    }
}
