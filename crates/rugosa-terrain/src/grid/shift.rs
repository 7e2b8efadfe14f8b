//! Moves of the window and of the datum.
//!
//! A move is by whole cells and never copies: the ring keeps what stays, and the cells
//! that leave are emptied (so that those that enter are unknown). Cost: the cells that
//! leave, plus one step per row.
//!
//! A change of the datum subtracts one integer from every stored height, exactly; the
//! differences of samples, and with them all statistics over pairs, stay as they are.
//! Cells that no longer fit into 16 bits are emptied and counted.

use super::{ElevationGrid, GroundCell};
use core::ops::Range;
use rugosa_grid::{Cell, Sample, Window, math};

/// Height steps that the reference may be from the datum before
/// [`ElevationGrid::follow_height`] rebases: a quarter of the range.
const SLACK: u32 = 1 << 13;

impl ElevationGrid<'_> {
    /// Moves the window so that `centre` is its middle cell, however far that is.
    /// `forget(window, samples, cell, old)` is called for each measured cell that leaves.
    ///
    /// ```
    /// use rugosa_grid::{Cell, Sample, Window};
    /// use rugosa_terrain::{ElevationGrid, GridConfig, GroundCell, Point};
    /// # let (mut cells, mut samples) = ([GroundCell::EMPTY; 1089], [Sample::UNKNOWN; 1089]);
    /// # let window = Window::around(33, Cell::new(0, 0));
    /// # let config = GridConfig::new(0.1);
    /// let mut grid = ElevationGrid::new(config, window, &mut cells, &mut samples).unwrap();
    /// for x in [-1.55, 0.05] {
    ///     grid.fuse(&Point { position: [x, 0.05, 0.5], variance: 1e-4, depression: 1.0 }, 1);
    /// }
    /// // ten cells to the east: the western return is left behind, the other keeps its address
    /// let mut left = Vec::new();
    /// grid.move_to(Cell::new(10, 0), |_, _, cell, _| left.push(cell));
    /// assert_eq!(left, [Cell::new(-16, 0)]);
    /// assert_eq!(grid.ground(Cell::new(0, 0)).unwrap().elevation, 0.5);
    /// assert_eq!(grid.window().centre(), Cell::new(10, 0));
    /// ```
    pub fn move_to(
        &mut self,
        centre: Cell,
        mut forget: impl FnMut(&Window, &[Sample], Cell, &Sample),
    ) {
        let next = Window::around(self.window.side(), centre);
        for cell in leaving(&self.window, &next) {
            self.release(cell, Sample::default(), &mut forget);
        }
        self.window = next;
        self.ceiling = self.highest();
    }

    /// Elevation of the highest cell \[m\]; −∞ where nothing is measured.
    fn highest(&self) -> f32 {
        let measured = self.cells.iter().filter(|held| held.count() != 0);
        measured.fold(f32::NEG_INFINITY, |top, held| {
            if held.elevation > top {
                held.elevation
            } else {
                top
            }
        })
    }

    /// Changes the datum (height steps above the map's zero). Returns how many measured
    /// cells did not fit and were emptied; `forget` is called for each of them.
    ///
    /// ```
    /// use rugosa_grid::{Cell, Sample, Window};
    /// use rugosa_terrain::{ElevationGrid, Fused, GridConfig, GroundCell, Point};
    /// # let (mut cells, mut samples) = ([GroundCell::EMPTY; 1089], [Sample::UNKNOWN; 1089]);
    /// # let window = Window::around(33, Cell::new(0, 0));
    /// let config = GridConfig { height_step: 0.001, ..GridConfig::new(0.1) };
    /// let mut grid = ElevationGrid::new(config, window, &mut cells, &mut samples).unwrap();
    /// let high = Point { position: [0.05, 0.05, 40.0], variance: 1e-4, depression: 1.0 };
    /// assert_eq!(grid.fuse(&high, 1), Fused::HeightOutOfRange); // 40 000 steps
    /// assert_eq!(grid.rebase(30_000, |_, _, _, _| {}), 0); // nothing measured, nothing lost
    /// assert!(matches!(grid.fuse(&high, 1), Fused::Sampled { .. }));
    /// assert_eq!(grid.sample(Cell::new(0, 0)).height, 10_000); // steps above the datum
    /// assert_eq!(grid.metres(10_000), 40.0);
    /// ```
    pub fn rebase(
        &mut self,
        datum: i32,
        mut forget: impl FnMut(&Window, &[Sample], Cell, &Sample),
    ) -> u32 {
        let down = i64::from(datum) - i64::from(self.datum);
        let fits = |steps: i16| i16::try_from(i64::from(steps) - down).is_ok();
        let mut dropped = 0;
        for cell in self.window.cells() {
            let Some(slot) = self.window.slot(cell) else {
                continue;
            };
            let (held, sample) = (&self.cells[slot], &self.samples[slot]);
            let stays = fits(held.min) && fits(held.max) && fits(sample.height);
            if sample.is_measured() && !stays {
                self.release(cell, Sample::default(), &mut forget);
                dropped += 1;
            }
        }
        self.lower(down);
        self.datum = datum;
        dropped
    }

    /// Rebases to the height `z` \[m\] (of the robot) when the datum has come far from
    /// it: by more than 8192 height steps. Returns what [`ElevationGrid::rebase`] does.
    ///
    /// ```
    /// use rugosa_grid::{Cell, Sample, Window};
    /// use rugosa_terrain::{ElevationGrid, GridConfig, GroundCell, Point};
    /// # let (mut cells, mut samples) = ([GroundCell::EMPTY; 1089], [Sample::UNKNOWN; 1089]);
    /// # let window = Window::around(33, Cell::new(0, 0));
    /// let config = GridConfig { height_step: 0.001, ..GridConfig::new(0.1) };
    /// let mut grid = ElevationGrid::new(config, window, &mut cells, &mut samples).unwrap();
    /// grid.fuse(&Point { position: [0.05, 0.05, 2.0], variance: 1e-4, depression: 1.0 }, 1);
    /// grid.follow_height(5.0, |_, _, _, _| {});
    /// assert_eq!(grid.datum(), 0); // near enough: within 8.192 m
    /// assert_eq!(grid.follow_height(20.0, |_, _, _, _| {}), 0);
    /// assert_eq!(grid.datum(), 20_000);
    /// // the ground is where it was
    /// assert_eq!(grid.sample_position(Cell::new(0, 0)).unwrap()[2], 2.0);
    /// ```
    pub fn follow_height(
        &mut self,
        z: f32,
        forget: impl FnMut(&Window, &[Sample], Cell, &Sample),
    ) -> u32 {
        let wanted = math::round_index(z * self.per_step);
        if !z.is_finite() || wanted.abs_diff(self.datum) <= SLACK {
            return 0;
        }
        self.rebase(wanted, forget)
    }

    /// Subtracts `down` from all stored heights, which must fit.
    fn lower(&mut self, down: i64) {
        let lower = |steps: &mut i16| *steps = (i64::from(*steps) - down) as i16;
        for (held, sample) in self.cells.iter_mut().zip(self.samples.iter_mut()) {
            if sample.is_measured() {
                lower(&mut held.min);
                lower(&mut held.max);
                lower(&mut sample.height);
            }
        }
    }

    /// Empties a cell and leaves `replacement` as its sample.
    pub(super) fn release(
        &mut self,
        cell: Cell,
        replacement: Sample,
        forget: &mut impl FnMut(&Window, &[Sample], Cell, &Sample),
    ) {
        let Some(slot) = self.window.slot(cell) else {
            return;
        };
        let old = self.put(slot, replacement);
        self.cells[slot] = GroundCell::default();
        if old.is_measured() {
            forget(&self.window, self.samples, cell, &old);
        }
    }
}

/// The cells of `old` that `next` does not hold, row by row.
fn leaving(old: &Window, next: &Window) -> impl Iterator<Item = Cell> + use<> {
    let side = old.side() as i32;
    let (from, to) = (old.origin(), next.origin());
    let columns = passed(to.x.wrapping_sub(from.x), side);
    let rows = passed(to.y.wrapping_sub(from.y), side);
    (0..side).flat_map(move |row| {
        let columns = if rows.contains(&row) {
            0..side
        } else {
            columns.clone()
        };
        columns.map(move |column| from.offset(column, row))
    })
}

/// Indices along one axis that a shift leaves behind.
fn passed(shift: i32, side: i32) -> Range<i32> {
    if shift >= 0 {
        0..shift.min(side)
    } else {
        shift.saturating_add(side).max(0)..side
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::vec::Vec;

    proptest! {
        #[test]
        fn leaving_is_the_set_difference(
            x in -90..90i32, y in -90..90i32, dx in -40..40i32, dy in -40..40i32
        ) {
            let old = Window::new(33, Cell::new(x, y));
            let next = Window::new(33, Cell::new(x + dx, y + dy));
            let fast: Vec<_> = leaving(&old, &next).collect();
            let slow: Vec<_> = old.leaving(&next).collect();
            prop_assert_eq!(fast, slow);
        }
    }

    #[test]
    fn a_far_jump_leaves_all() {
        let old = Window::new(33, Cell::new(0, 0));
        for far in [i32::MIN, i32::MAX, 33, -33] {
            assert_eq!(
                leaving(&old, &Window::new(33, Cell::new(far, 0))).count(),
                33 * 33
            );
        }
    }
}
