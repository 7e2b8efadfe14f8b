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
//! table needed): rotation, translation and variance for a stripe of points at a time,
//! which compilers turn into vector instructions, then the cells one by one.

use super::cell::{Height, Met};
use super::{ElevationGrid, SampleChoice};
use crate::Noise;
use crate::beam::rotation_rows;
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
    /// sine of the beam's depression times 255: 0 level (or upward), 255 straight down
    pub depression: u8,
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
struct Placed {
    cell: Cell,
    /// offset from the cell's centre, in 1/64 cell
    part: [i8; 2],
    /// height steps above the map's zero
    steps: i32,
    /// elevation [m]
    metres: f32,
    variance: f32,
}

/// What turns metres into cells and steps.
#[derive(Clone, Copy)]
struct Scale {
    lattice: Lattice,
    per_step: f32,
}

impl Scale {
    /// Arithmetic only: no branch, no memory.
    #[inline(always)]
    fn place(&self, [x, y, z]: [f32; 3], variance: f32) -> Placed {
        let (cell, east, north) = self.lattice.locate(x, y);
        Placed {
            cell,
            part: [part(east), part(north)],
            steps: math::round_index(z * self.per_step),
            metres: z,
            // zero times the sum is not zero if one of its terms is not finite
            variance: variance + 0.0 * (x + y + z),
        }
    }
}

impl ElevationGrid<'_> {
    /// Fuses one return of the given sweep.
    #[inline]
    pub fn fuse(&mut self, point: &Point, sweep: u16) -> Fused {
        let placed = self.scale().place(point.position, point.variance);
        self.settle(&placed, || point.depression, sweep)
    }

    /// Fuses points \[m\] of the sensor frame; `replaced(window, samples, cell, old)`
    /// is called for each cell that has a new sample.
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
            stripe.project();
            stripe.place();
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
        }
    }

    /// Fuses a return into its cell and keeps it as the sample if it is the better one.
    #[inline]
    fn settle(&mut self, placed: &Placed, depression: impl FnOnce() -> u8, sweep: u16) -> Fused {
        // neither negative nor infinite nor NaN
        if placed.variance.to_bits() >= f32::INFINITY.to_bits() {
            return Fused::Invalid;
        }
        let Some(slot) = self.window.slot(placed.cell) else {
            return Fused::Outside;
        };
        let Ok(steps) = i16::try_from(placed.steps.saturating_sub(self.datum)) else {
            return Fused::HeightOutOfRange;
        };
        let height = Height {
            metres: placed.metres,
            steps,
            variance: placed.variance,
        };
        let ground = &mut self.cells[slot];
        let met = ground.take(&self.gate, height, sweep);
        if met == Met::Gated {
            return Fused::Gated;
        }
        if ground.elevation > self.ceiling {
            self.ceiling = ground.elevation;
        }
        let old = self.samples[slot];
        if met == Met::Merged && !self.better(&old, steps, placed.part) {
            return Fused::Merged;
        }
        self.samples[slot] = self.sample_of(placed, steps, depression());
        let cell = placed.cell;
        match met {
            Met::Restarted => Fused::Restarted { cell, old },
            _ => Fused::Sampled { cell, old },
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
                e * e + n * n < i32::from(old.eccentricity())
            }
            SampleChoice::Lowest => steps < old.height,
        }
    }
}

/// Cells (at most one half) → 1/64 cells, ties to even.
///
/// Next to 1.5 · 2²³ the last bit of an f32 is worth 1, so the sum's low byte is the
/// rounded number: two instructions instead of a saturating conversion.
#[inline]
fn part(offset: f32) -> i8 {
    (offset * PARTS as f32 + 12_582_912.0).to_bits() as i8
}

/// Points that are projected together.
const STRIPE: usize = 64;

type Lane<T> = [T; STRIPE];

/// A stripe of points, coordinate by coordinate, from the sensor to their places.
struct Stripe<'a> {
    rows: [[f32; 3]; 3],
    translation: [f32; 3],
    noise: &'a Noise,
    scale: Scale,
    position: [Lane<f32>; 3],
    variance: Lane<f32>,
    /// squared upward component of the beam's direction, negative for depressed beams
    up2: Lane<f32>,
    cell: [Lane<i32>; 2],
    part: [Lane<i8>; 2],
    steps: Lane<i32>,
}

impl<'a> Stripe<'a> {
    fn new(view: &View<'a>, scale: Scale) -> Self {
        Stripe {
            rows: rotation_rows(view.map_from_sensor),
            translation: view.map_from_sensor.translation.vector.into(),
            noise: view.noise,
            scale,
            position: [[0.0; STRIPE]; 3],
            variance: [0.0; STRIPE],
            up2: [0.0; STRIPE],
            cell: [[0; STRIPE]; 2],
            part: [[0; STRIPE]; 2],
            steps: [0; STRIPE],
        }
    }

    fn load(&mut self, points: &[[f32; 3]]) {
        let [xs, ys, zs] = &mut self.position;
        for (((x, y), z), point) in xs.iter_mut().zip(ys).zip(zs).zip(points) {
            [*x, *y, *z] = *point;
        }
    }

    /// Sensor frame → map frame, with the variance of the elevation.
    fn project(&mut self) {
        for i in 0..STRIPE {
            let [x, y, z] = [0, 1, 2].map(|axis| self.position[axis][i]);
            let [dx, dy, dz] = self.rows.map(|r| r[0] * x + r[1] * y + r[2] * z);
            let range2 = x * x + y * y + z * z;
            let up2 = dz * dz / range2;
            self.position[0][i] = self.translation[0] + dx;
            self.position[1][i] = self.translation[1] + dy;
            self.position[2][i] = self.translation[2] + dz;
            self.variance[i] = self.noise.variance_of_squares(up2, range2);
            self.up2[i] = if dz < 0.0 { -up2 } else { up2 };
        }
    }

    fn place(&mut self) {
        for i in 0..STRIPE {
            let position = [0, 1, 2].map(|axis| self.position[axis][i]);
            let placed = self.scale.place(position, self.variance[i]);
            self.cell[0][i] = placed.cell.x;
            self.cell[1][i] = placed.cell.y;
            self.part[0][i] = placed.part[0];
            self.part[1][i] = placed.part[1];
            self.steps[i] = placed.steps;
            self.variance[i] = placed.variance;
        }
    }

    #[inline]
    fn placed(&self, i: usize) -> Placed {
        Placed {
            cell: Cell::new(self.cell[0][i], self.cell[1][i]),
            part: [self.part[0][i], self.part[1][i]],
            steps: self.steps[i],
            metres: self.position[2][i],
            variance: self.variance[i],
        }
    }

    /// Sine of the depression times 255; an integer root, taken only for new samples.
    #[inline]
    fn depression(&self, i: usize) -> u8 {
        let squared = (-65_025.0 * self.up2[i]) as u16;
        squared.isqrt() as u8
    }
}
