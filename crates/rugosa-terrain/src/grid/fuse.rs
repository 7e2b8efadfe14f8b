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
use super::{ElevationGrid, GroundCell, SampleChoice};
use crate::Noise;
use crate::beam::rotation_rows;
use nalgebra::Isometry3;
use rugosa_grid::sample::PARTS;
use rugosa_grid::{Cell, Sample, Window, math};

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

/// Points that are projected together.
const STRIPE: usize = 64;

/// Where a return hit and how sure its height is.
#[derive(Clone, Copy)]
struct Hit {
    position: [f32; 3],
    variance: f32,
    sweep: u16,
}

impl ElevationGrid<'_> {
    /// Fuses one return of the given sweep.
    #[inline]
    pub fn fuse(&mut self, point: &Point, sweep: u16) -> Fused {
        let hit = Hit {
            position: point.position,
            variance: point.variance,
            sweep,
        };
        self.fuse_hit(&hit, || point.depression)
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
        let mut stripe = Stripe::new(view);
        for block in points.chunks(STRIPE) {
            stripe.project(block);
            for i in 0..block.len() {
                let fused = self.fuse_hit(&stripe.hit(i), || stripe.depression(i));
                tally.add(&fused);
                if let Fused::Sampled { cell, old } | Fused::Restarted { cell, old } = fused {
                    replaced(&self.window, self.samples, cell, &old);
                }
            }
        }
        tally
    }

    #[inline]
    fn fuse_hit(&mut self, hit: &Hit, depression: impl FnOnce() -> u8) -> Fused {
        let [x, y, z] = hit.position;
        // one sum is finite only if all its terms are
        if !((x + y + z).is_finite() && hit.variance >= 0.0 && hit.variance < f32::INFINITY) {
            return Fused::Invalid;
        }
        let (cell, east, north) = self.lattice.locate(x, y);
        let Some(slot) = self.window.slot(cell) else {
            return Fused::Outside;
        };
        let Some(steps) = self.steps(z) else {
            return Fused::HeightOutOfRange;
        };
        let height = Height {
            metres: z,
            steps,
            variance: hit.variance,
        };
        let ground: &mut GroundCell = &mut self.cells[slot];
        let met = ground.take(&self.gate, height, hit.sweep);
        if met == Met::Gated {
            return Fused::Gated;
        }
        if ground.elevation > self.ceiling {
            self.ceiling = ground.elevation;
        }
        let (east, north) = (part(east), part(north));
        let old = self.samples[slot];
        if met == Met::Merged && !self.better(&old, steps, [east, north]) {
            return Fused::Merged;
        }
        let variance = math::round_index(hit.variance * self.per_step * self.per_step);
        let variance = variance.min(i32::from(u16::MAX)) as u16;
        self.samples[slot] = Sample::measured(steps, variance, east, north, depression());
        match met {
            Met::Restarted => Fused::Restarted { cell, old },
            _ => Fused::Sampled { cell, old },
        }
    }

    /// Metres → height steps above the datum; `None` beyond 16 bits.
    #[inline]
    fn steps(&self, z: f32) -> Option<i16> {
        let steps = math::round_index(z * self.per_step).saturating_sub(self.datum);
        i16::try_from(steps).ok()
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

/// A stripe of points in the map frame.
struct Stripe<'a> {
    rows: [[f32; 3]; 3],
    translation: [f32; 3],
    noise: &'a Noise,
    sweep: u16,
    position: [[f32; STRIPE]; 3],
    variance: [f32; STRIPE],
    /// squared upward component of the beam's direction, negative for depressed beams
    up2: [f32; STRIPE],
}

impl<'a> Stripe<'a> {
    fn new(view: &View<'a>) -> Self {
        Stripe {
            rows: rotation_rows(view.map_from_sensor),
            translation: view.map_from_sensor.translation.vector.into(),
            noise: view.noise,
            sweep: view.sweep,
            position: [[0.0; STRIPE]; 3],
            variance: [0.0; STRIPE],
            up2: [0.0; STRIPE],
        }
    }

    fn project(&mut self, points: &[[f32; 3]]) {
        for (i, &[x, y, z]) in points.iter().enumerate().take(STRIPE) {
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

    #[inline]
    fn hit(&self, i: usize) -> Hit {
        Hit {
            position: [0, 1, 2].map(|axis| self.position[axis][i]),
            variance: self.variance[i],
            sweep: self.sweep,
        }
    }

    /// Sine of the depression times 255; an integer root, taken only for new samples.
    #[inline]
    fn depression(&self, i: usize) -> u8 {
        let squared = (-65_025.0 * self.up2[i]) as u16;
        squared.isqrt() as u8
    }
}
