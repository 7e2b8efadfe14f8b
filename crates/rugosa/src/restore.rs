//! A map as it was saved: the cells go back in, everything else is derived anew.
//!
//! What is saved are the cells ([`Mapper::save`]); counters of the structure function,
//! roughness and costs follow from them, bit for bit, because they are functions of the
//! cells and the configuration only. The reconstruction starts afresh: it converges to
//! the same surface but keeps no memory of its iterations.

use crate::Mapper;
use crate::report::SweepReport;
use rugosa_grid::Cell;
use rugosa_terrain::grid::SavedCell;

/// Where a saved map lies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Place {
    /// lowest cell of the window
    pub origin: Cell,
    /// height steps from the map's zero to that of the stored heights
    pub datum: i32,
    /// number of the last sweep
    pub sweep: u32,
}

impl Mapper<'_> {
    /// Where the map lies.
    pub fn place(&self) -> Place {
        Place {
            origin: self.window().origin(),
            datum: self.grid().datum(),
            sweep: self.sweep(),
        }
    }

    /// What the cell holds.
    pub fn save(&self, cell: Cell) -> SavedCell {
        self.grid().save(cell)
    }

    /// Replaces the map by a saved one, made with the same resolution and height step.
    /// Returns the report of a sweep and how many cells did not fit.
    ///
    /// ```
    /// use rugosa::{Config, Mapper, Planes33};
    /// # let (mut a, mut b) = (Box::new(Planes33::new()), Box::new(Planes33::new()));
    /// let first = Mapper::new(Config::default(), a.lend()).unwrap();
    /// let mut second = Mapper::new(Config::default(), b.lend()).unwrap();
    /// let cells: Vec<_> = first.window().cells().map(|c| (c, first.save(c))).collect();
    /// let (report, lost) = second.restore(&first.place(), cells);
    /// assert_eq!((report.measured, lost), (0, 0));
    /// ```
    pub fn restore(
        &mut self,
        place: &Place,
        cells: impl IntoIterator<Item = (Cell, SavedCell)>,
    ) -> (SweepReport, u32) {
        self.surface.clear(place);
        self.resume(place.sweep);
        let lost = cells
            .into_iter()
            .filter(|(cell, saved)| !self.surface.restore(*cell, saved))
            .count();
        (self.commit(&mut |_| {}), lost as u32)
    }
}
