//! What a cell holds, taken out and put back exactly.

use super::{ElevationGrid, GroundCell};
use rugosa_grid::{Cell, Sample, State, Window};

/// Everything that a cell holds. Heights count in height steps from the map's zero, not
/// from the datum, so that they mean the same in every grid of the same step.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SavedCell {
    /// unknown, measured or seen through
    pub state: State,
    /// fused elevation \[m\]
    pub elevation: f32,
    /// its variance \[m²\]
    pub variance: f32,
    /// lowest fused return, in height steps
    pub min: i32,
    /// highest fused return, in height steps
    pub max: i32,
    /// returns fused (low 13 bits) and gated in a row (high 3 bits)
    pub tally: u16,
    /// the sweep (its low 16 bits) that touched the cell last
    pub last_sweep: u16,
    /// height of the point sample, in height steps
    pub height: i32,
    /// the sample's variance and place, see [`Sample`]
    pub sample_variance: u16,
    /// offset from the cell's centre to the east and north, in 1/64 cell
    pub offset: [i8; 2],
    /// depression of the sample's beam, see [`Sample`]
    pub depression: u8,
}

impl ElevationGrid<'_> {
    /// What the cell holds; the empty one outside the window.
    ///
    /// ```
    /// use rugosa_grid::{Cell, Sample, Window};
    /// use rugosa_terrain::{ElevationGrid, GridConfig, GroundCell, Point};
    /// # let (mut cells, mut samples) = ([GroundCell::EMPTY; 1089], [Sample::UNKNOWN; 1089]);
    /// # let (mut more, mut others) = ([GroundCell::EMPTY; 1089], [Sample::UNKNOWN; 1089]);
    /// # let window = Window::around(33, Cell::new(0, 0));
    /// # let config = GridConfig::new(0.1);
    /// let mut grid = ElevationGrid::new(config, window, &mut cells, &mut samples).unwrap();
    /// grid.fuse(&Point { position: [0.02, 0.05, 1.0], variance: 1e-4, depression: 1.0 }, 1);
    /// let cell = Cell::new(0, 0);
    /// let saved = grid.save(cell);
    /// assert_eq!((saved.elevation, saved.height), (1.0, 2000)); // metres, steps of 0.5 mm
    /// let mut other = ElevationGrid::new(config, window, &mut more, &mut others).unwrap();
    /// assert!(other.restore(cell, &saved, |_, _, _, _| {}));
    /// assert_eq!(other.ground(cell), grid.ground(cell));
    /// assert_eq!(other.sample_position(cell), grid.sample_position(cell));
    /// assert!(!other.restore(Cell::new(99, 0), &saved, |_, _, _, _| {})); // outside
    /// ```
    pub fn save(&self, cell: Cell) -> SavedCell {
        let Some(slot) = self.window.slot(cell) else {
            return SavedCell::default();
        };
        let (held, sample) = (&self.cells[slot], &self.samples[slot]);
        let steps = |height: i16| self.datum + i32::from(height);
        if !sample.is_measured() {
            return SavedCell {
                state: sample.state(),
                ..SavedCell::default()
            };
        }
        SavedCell {
            state: State::Measured,
            elevation: held.elevation,
            variance: held.variance,
            min: steps(held.min),
            max: steps(held.max),
            tally: held.tally(),
            last_sweep: held.last_sweep,
            height: steps(sample.height),
            sample_variance: sample.variance,
            offset: [sample.east, sample.north],
            depression: sample.depression,
        }
    }

    /// Puts back what a cell held. `changed` is called as after every change of a sample.
    /// False where the cell lies outside the window or its heights do not fit the datum;
    /// the cell is then left as it is.
    pub fn restore(
        &mut self,
        cell: Cell,
        saved: &SavedCell,
        mut changed: impl FnMut(&Window, &[Sample], Cell, &Sample),
    ) -> bool {
        let Some(slot) = self.window.slot(cell) else {
            return false;
        };
        let (held, sample) = match saved.state {
            State::Unknown => (GroundCell::EMPTY, Sample::UNKNOWN),
            State::SeenThrough => (GroundCell::EMPTY, Sample::seen_through()),
            State::Measured => match self.held(saved) {
                Some(held) => held,
                None => return false,
            },
        };
        if saved.state == State::Measured && saved.elevation > self.ceiling {
            self.ceiling = saved.elevation;
        }
        self.cells[slot] = held;
        let old = self.put(slot, sample);
        changed(&self.window, self.samples, cell, &old);
        true
    }

    /// A measured cell and its sample; `None` where the heights do not fit the datum.
    fn held(&self, saved: &SavedCell) -> Option<(GroundCell, Sample)> {
        let height = |steps: i32| i16::try_from(i64::from(steps) - i64::from(self.datum)).ok();
        let extremes = [height(saved.min)?, height(saved.max)?];
        let top = height(saved.height)?;
        let [east, north] = saved.offset;
        let sample = Sample::measured(top, saved.sample_variance, east, north, saved.depression);
        Some((GroundCell::restored(saved, extremes), sample))
    }
}
