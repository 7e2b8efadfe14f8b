//! A return → its cell.
//!
//! The cell is found by floor (half-open, negative coordinates included), the height is
//! rounded to steps above the datum, the return is fused ([`super::cell`]), and it
//! becomes the cell's point sample if it is the first, if the cell started afresh, or if
//! it is nearer to the centre than the old one (or lower, see
//! [`super::SampleChoice`]); ties keep the old one. NaN and infinities are refused here,
//! whatever the caller did.
//!
//! Cost: constant per return, whatever the size of the map and its history
//! (`benches/mapping.rs`).
//!
//! A sample stays until a nearer return replaces it or its cell starts afresh: on ground
//! that creeps by less than the gate it can be older than the fused elevation.
//!
//! [`ElevationGrid::fuse_points`] takes a block of points in the sensor frame (no beam
//! table needed) and gives the same result: see [`super::stripe`].

use super::cell::{Height, Met};
use super::stripe::{STRIPE, Stripe};
use super::{ElevationGrid, SampleChoice};
use crate::Noise;
use nalgebra::Isometry3;
use rugosa_grid::sample::PARTS;
use rugosa_grid::{Cell, Lattice, Sample, Window, math};

/// A return in the map frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// x, y, z \[m\]
    pub position: [f32; 3],
    /// variance of z \[m²\], not negative
    pub variance: f32,
    /// sine of the beam's depression: 1 straight down, 0 level, negative upward
    pub depression: f32,
}

/// What became of a return.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fused {
    /// not a number, infinite, or of negative variance
    Invalid,
    /// not in the window
    Outside,
    /// too far above or below the datum
    HeightOutOfRange,
    /// contradicts its cell
    Gated,
    /// fused, the sample stayed
    Merged,
    /// fused, and it is the cell's new sample
    Sampled {
        /// where
        cell: Cell,
        /// the sample it replaced, perhaps an empty one
        old: Sample,
    },
    /// contradicted its cell for so long that the cell started afresh with it
    Restarted {
        /// where
        cell: Cell,
        /// the sample it replaced
        old: Sample,
    },
}

/// Returns by what became of them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Tally {
    /// [`Fused::Invalid`]
    pub invalid: u32,
    /// [`Fused::Outside`]
    pub outside: u32,
    /// [`Fused::HeightOutOfRange`]
    pub height_out_of_range: u32,
    /// [`Fused::Gated`]
    pub gated: u32,
    /// [`Fused::Merged`]
    pub merged: u32,
    /// [`Fused::Sampled`]
    pub sampled: u32,
    /// [`Fused::Restarted`]
    pub restarted: u32,
}

impl Tally {
    /// Counts one return.
    ///
    /// ```
    /// use rugosa_terrain::{Fused, Tally};
    /// let mut tally = Tally::default();
    /// for fused in [Fused::Outside, Fused::Merged, Fused::Merged, Fused::Gated] {
    ///     tally.add(&fused);
    /// }
    /// assert_eq!((tally.outside, tally.gated, tally.used()), (1, 1, 2));
    /// ```
    #[inline]
    pub fn add(&mut self, fused: &Fused) {
        let counter = match fused {
            Fused::Invalid => &mut self.invalid,
            Fused::Outside => &mut self.outside,
            Fused::HeightOutOfRange => &mut self.height_out_of_range,
            Fused::Gated => &mut self.gated,
            Fused::Merged => &mut self.merged,
            Fused::Sampled { .. } => &mut self.sampled,
            Fused::Restarted { .. } => &mut self.restarted,
        };
        *counter = counter.wrapping_add(1);
    }

    /// Returns that are in the map.
    pub fn used(&self) -> u32 {
        self.merged + self.sampled + self.restarted
    }
}

/// What a block of points has in common.
#[derive(Clone, Copy, Debug)]
pub struct View<'a> {
    /// from the frame of the points into the map
    pub map_from_sensor: &'a Isometry3<f32>,
    /// the scanner's noise
    pub noise: &'a Noise,
    /// running number of the sweep
    pub sweep: u16,
}

/// A return with its place on the grid; a broken one has a NaN for its variance.
#[derive(Clone, Copy)]
pub(super) struct Placed {
    pub cell: Cell,
    /// offset from the cell's centre, in 1/64 cell
    pub part: [i8; 2],
    /// height steps above the datum
    pub steps: i32,
    /// elevation [m]
    pub metres: f32,
    pub variance: f32,
}

/// What turns metres into cells and steps.
#[derive(Clone, Copy)]
pub(super) struct Scale {
    pub lattice: Lattice,
    pub per_step: f32,
    /// the datum in height steps
    pub datum: f32,
}

impl Scale {
    #[inline]
    fn place(&self, [x, y, z]: [f32; 3], variance: f32) -> Placed {
        let (cell, east, north) = self.lattice.locate(x, y);
        Placed {
            cell,
            part: [part(east), part(north)],
            steps: math::floor_index(z * self.per_step - self.datum + 0.5),
            metres: z,
            variance: variance_if_finite([x, y, z], variance),
        }
    }
}

/// The variance, or NaN where any of the four is not finite: zero times a sum is zero
/// only if all its terms are.
#[inline]
pub(super) fn variance_if_finite([x, y, z]: [f32; 3], variance: f32) -> f32 {
    variance + 0.0 * (x + y + z)
}

/// Cells (at most one half) → 1/64 cells, ties to even.
///
/// Next to [`ONES`] the last bit of an f32 is worth 1, so the sum's low byte is the
/// rounded number: two instructions instead of a saturating conversion.
#[inline]
pub(super) fn part(offset: f32) -> i8 {
    (offset * PARTS as f32 + ONES).to_bits() as i8
}

/// A sample within a quarter of a cell of the centre stays, (1/64 cell)²; one further out
/// gives way to one at less than half of its squared distance. True distances are used
/// anyway, and a cell that settles costs nothing in the sweeps that follow.
const NEAR_ENOUGH: i32 = (PARTS / 4) * (PARTS / 4);

/// 1.5 · 2²³: the last bit of the numbers around it is worth 1.
pub(super) const ONES: f32 = 12_582_912.0;

impl ElevationGrid<'_> {
    /// Fuses one return of the given sweep.
    ///
    /// ```
    /// use rugosa_grid::{Cell, Sample, Window};
    /// use rugosa_terrain::{ElevationGrid, Fused, GridConfig, GroundCell, Point};
    /// # let (mut cells, mut samples) = ([GroundCell::EMPTY; 1089], [Sample::UNKNOWN; 1089]);
    /// # let window = Window::around(33, Cell::new(0, 0));
    /// # let config = GridConfig::new(0.1);
    /// let mut grid = ElevationGrid::new(config, window, &mut cells, &mut samples).unwrap();
    /// let at = |x, z, variance| Point { position: [x, 0.05, z], variance, depression: 1.0 };
    /// let cell = Cell::new(0, 0);
    /// let first = Fused::Sampled { cell, old: Sample::UNKNOWN };
    /// assert_eq!(grid.fuse(&at(0.05, 1.00, 0.0004), 1), first);
    /// // twice as sure, so it weighs twice as much
    /// assert_eq!(grid.fuse(&at(0.05, 1.03, 0.0002), 1), Fused::Merged);
    /// assert!((grid.ground(cell).unwrap().elevation - 1.02).abs() < 1e-5);
    /// assert_eq!(grid.fuse(&at(0.05, 9.00, 0.0002), 1), Fused::Gated);
    /// assert_eq!(grid.fuse(&at(7.0, 1.00, 0.0002), 1), Fused::Outside);
    /// ```
    #[inline]
    pub fn fuse(&mut self, point: &Point, sweep: u16) -> Fused {
        let placed = self.scale().place(point.position, point.variance);
        self.settle(&placed, || (255.0 * point.depression) as u8, sweep)
    }

    /// Fuses points \[m\] of the sensor frame; `replaced(window, samples, cell, old)` is
    /// called for each new sample, whether the old one held a return or not.
    ///
    /// ```
    /// use nalgebra::Isometry3;
    /// use rugosa_grid::{Cell, Sample, Window};
    /// use rugosa_terrain::{ElevationGrid, GridConfig, GroundCell, Noise, grid::View};
    /// # let (mut cells, mut samples) = ([GroundCell::EMPTY; 1089], [Sample::UNKNOWN; 1089]);
    /// # let window = Window::around(33, Cell::new(0, 0));
    /// # let config = GridConfig::new(0.1);
    /// let mut grid = ElevationGrid::new(config, window, &mut cells, &mut samples).unwrap();
    /// let (above, noise) = (Isometry3::translation(1.0, 0.0, 2.0), Noise::new(0.01, 0.0, 0.0));
    /// let view = View { map_from_sensor: &above, noise: &noise, sweep: 3 };
    /// let mut sampled = Vec::new();
    /// let points = [[-0.95, 0.25, -1.5], [-0.95, 0.25, -1.5], [9.0, 0.0, -2.0]];
    /// let tally = grid.fuse_points(&points, &view, |_, _, cell, _| sampled.push(cell));
    /// assert_eq!((tally.sampled, tally.merged, tally.outside), (1, 1, 1));
    /// assert_eq!(sampled, [Cell::new(0, 2)]);
    /// assert!((grid.ground(sampled[0]).unwrap().elevation - 0.5).abs() < 1e-5);
    /// ```
    pub fn fuse_points(
        &mut self,
        points: &[[f32; 3]],
        view: &View,
        mut replaced: impl FnMut(&Window, &[Sample], Cell, &Sample),
    ) -> Tally {
        let mut tally = Tally::default();
        let mut stripe = Stripe::new(view, self.scale());
        for block in points.chunks(STRIPE) {
            stripe.load(block);
            for i in 0..block.len() {
                let fused = self.settle(&stripe.placed(i), || stripe.depression(i), view.sweep);
                tally.add(&fused);
                if let Fused::Sampled { cell, old } | Fused::Restarted { cell, old } = fused {
                    replaced(&self.window, self.samples, cell, &old);
                }
            }
        }
        tally
    }

    fn scale(&self) -> Scale {
        Scale {
            lattice: self.lattice,
            per_step: self.per_step,
            datum: self.datum as f32,
        }
    }

    /// Fuses a return into its cell and keeps it as the sample if it is the better one.
    #[inline]
    fn settle(&mut self, placed: &Placed, depression: impl FnOnce() -> u8, sweep: u16) -> Fused {
        let (slot, height) = match self.admit(placed) {
            Ok(admitted) => admitted,
            Err(refused) => return refused,
        };
        let (cell, old) = (placed.cell, self.samples[slot]);
        let met = self.cells[slot].take(&self.gate, height, sweep);
        if met == Met::Gated {
            return Fused::Gated;
        }
        self.raise_ceiling(slot);
        if met == Met::Merged && !self.better(&old, height.steps, placed.part) {
            return Fused::Merged;
        }
        self.put(slot, self.sample_of(placed, height.steps, depression()));
        match met {
            Met::Restarted => Fused::Restarted { cell, old },
            _ => Fused::Sampled { cell, old },
        }
    }

    /// Where a return goes and its height, or why it goes nowhere.
    #[inline]
    fn admit(&self, placed: &Placed) -> Result<(usize, Height), Fused> {
        // neither negative nor infinite nor NaN
        if placed.variance.to_bits() >= f32::INFINITY.to_bits() {
            return Err(Fused::Invalid);
        }
        let slot = self.window.slot(placed.cell).ok_or(Fused::Outside)?;
        let steps = i16::try_from(placed.steps).map_err(|_| Fused::HeightOutOfRange)?;
        let height = Height {
            metres: placed.metres,
            steps,
            variance: placed.variance,
        };
        Ok((slot, height))
    }

    #[inline]
    fn raise_ceiling(&mut self, slot: usize) {
        let elevation = self.cells[slot].elevation;
        if elevation > self.ceiling {
            self.ceiling = elevation;
        }
    }

    fn sample_of(&self, placed: &Placed, steps: i16, depression: u8) -> Sample {
        let [east, north] = placed.part;
        // the conversion saturates
        let variance = (placed.variance * self.per_step * self.per_step + 0.5) as u16;
        Sample::measured(steps, variance, east, north, depression)
    }

    #[inline]
    fn better(&self, old: &Sample, steps: i16, [east, north]: [i8; 2]) -> bool {
        match self.config.sample {
            SampleChoice::Nearest => {
                let (e, n) = (i32::from(east), i32::from(north));
                let old = i32::from(old.eccentricity());
                old > NEAR_ENOUGH && 2 * (e * e + n * n) < old
            }
            SampleChoice::Lowest => steps < old.height,
        }
    }
}
