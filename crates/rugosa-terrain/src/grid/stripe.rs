//! Points of the sensor frame → places on the grid, a stripe at a time.
//!
//! The steps of [`super::fuse`] that only calculate, over arrays of fixed length, one per
//! quantity: rotation, translation, variance, cell and height step. There is no branch
//! and no conversion that compilers cannot turn into vector instructions; the conversion
//! of a float to an integer that saturates is one that they cannot, hence [`floor`].
//!
//! Cost on x86-64 with its basic vector instructions: about 45 instructions per point.

use super::fuse::{ONES, Placed, Scale, View, part, variance_if_finite};
use crate::Noise;
use crate::beam::rotation_rows;
use rugosa_grid::Cell;

/// Points that are projected together.
pub(super) const STRIPE: usize = 64;

type Lane<T> = [T; STRIPE];

/// A stripe of points, coordinate by coordinate, from the sensor to their places.
pub(super) struct Stripe<'a> {
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
    pub(super) fn new(view: &View<'a>, scale: Scale) -> Self {
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

    /// Takes up to [`STRIPE`] points and works out their places.
    pub(super) fn load(&mut self, points: &[[f32; 3]]) {
        let [xs, ys, zs] = &mut self.position;
        for (((x, y), z), point) in xs.iter_mut().zip(ys).zip(zs).zip(points) {
            [*x, *y, *z] = *point;
        }
        self.project();
        self.place();
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
        let per_metre = 1.0 / self.scale.lattice.resolution();
        for i in 0..STRIPE {
            let [x, y, z] = [0, 1, 2].map(|axis| self.position[axis][i]);
            for (axis, metres) in [x, y].into_iter().enumerate() {
                let (index, offset) = floor(metres * per_metre);
                self.cell[axis][i] = index;
                self.part[axis][i] = part(offset - 0.5);
            }
            let (steps, _) = floor(z * self.scale.per_step - self.scale.datum + 0.5);
            self.steps[i] = steps;
            self.variance[i] = variance_if_finite([x, y, z], self.variance[i]);
        }
    }

    #[inline]
    pub(super) fn placed(&self, i: usize) -> Placed {
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
    pub(super) fn depression(&self, i: usize) -> u8 {
        let squared = (-65_025.0 * self.up2[i]) as u16;
        squared.isqrt() as u8
    }
}

/// Largest integer not above `x`, and how far `x` is above it; numbers beyond ±2²² count
/// as ±2²², NaN gives anything.
#[inline(always)]
fn floor(x: f32) -> (i32, f32) {
    const LIMIT: f32 = 4_194_304.0;
    let x = if x > LIMIT { LIMIT } else { x };
    let x = if x < -LIMIT { -LIMIT } else { x };
    let sum = x + ONES;
    let nearest = sum - ONES;
    let index = (sum.to_bits() as i32).wrapping_sub(ONES.to_bits() as i32);
    let above = nearest > x;
    let floor = if above { nearest - 1.0 } else { nearest };
    (index.wrapping_sub(i32::from(above)), x - floor)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use rugosa_grid::math;

    proptest! {
        #[test]
        fn floor_is_the_floor(x in prop_oneof![-4_194_303f32..4_194_303.0, -3f32..3.0, -500f32..500.0]) {
            let (index, above) = floor(x);
            prop_assert_eq!(index, math::floor_index(x));
            prop_assert_eq!(above, x - index as f32);
        }
    }

    #[test]
    fn floor_at_borders_and_beyond() {
        for (x, index) in [
            (0.0, 0),
            (-0.0, 0),
            (1.0, 1),
            (-1.0, -1),
            (-0.25, -1),
            (1.5, 1),
            (2.5, 2),
            (-1.5, -2),
        ] {
            assert_eq!(floor(x).0, index, "{x}");
        }
        assert_eq!(floor(f32::INFINITY).0, 4_194_304);
        assert_eq!(floor(f32::NEG_INFINITY).0, -4_194_304);
    }
}
