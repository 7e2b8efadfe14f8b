//! The two-mirror geometry of the Perceptron laser range finder.
//!
//! The beam leaves a rotating mirror at a point that moves with the angles α (azimuth,
//! positive to the left) and β (inclination, positive upward). The published conversion
//! of the USF range-image set, here with lengths in metres:
//!
//! ```text
//! dz = −h1 (1 − cos α) / tan γ     dy = dz tan(θ + β/2)     dx = (h2 + dy) tan α
//! r1 = dz − h2      r2 = √(dx² + (h2 + dy)²)      r3 = r + r0 − (r1 + r2)
//! X = dx + r3 sin α     Y = dy + r3 cos α sin β     Z = dz + r3 cos α cos β
//! ```
//!
//! The published frame has X to the left, Y up and Z out of the sensor; here the axes
//! are permuted to REP-103: x = Z, y = X, z = Y. With q = (h2 + dy) / cos α the root is
//! |q| and dx = q sin α: one division, no root, no tangent per return.
//!
//! Valid for |α| < 90° and |θ + β/2| < 90°. Accuracy: within 3 µm of the f64 formula at
//! 8 m (`the_published_vectors`).
//!
//! Source: the range-image-to-Cartesian conversion distributed with the University of
//! South Florida range image database (Perceptron images).

use super::rays::{Rows, times};
use super::{LineTrig, Trig};
use rugosa_grid::math;

/// Constants of one unit.
///
/// ```
/// use rugosa_terrain::{Beams, Geometry, PerceptronConstants, Raster, Trig};
/// let unit = PerceptronConstants::PUBLISHED;
/// let raster = Raster { azimuth: [0.0, 0.1], inclination: [0.0, 0.1] };
/// let (mut columns, mut lines) = ([Trig::ZERO; 2], [Default::default(); 2]);
/// let beams = Beams::new(Geometry::Perceptron(unit), raster, &mut columns, &mut lines);
/// // straight ahead a count of 1000 lies 1830.3 counts away
/// let metres = |counts: f32| counts * PerceptronConstants::METRES_PER_COUNT;
/// let [x, y, z] = beams.point(0, 0, metres(1000.0)).unwrap();
/// assert!((x - metres(1830.3)).abs() < 1e-5 && y.abs() < 1e-6 && z.abs() < 1e-6);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PerceptronConstants {
    /// mirror offset h1 \[m\]
    pub h1: f32,
    /// mirror offset h2 \[m\]
    pub h2: f32,
    /// slope γ of the first mirror \[rad\]
    pub gamma: f32,
    /// slope θ of the second mirror \[rad\]
    pub theta: f32,
    /// standoff r0 \[m\]
    pub standoff: f32,
}

impl PerceptronConstants {
    /// Range count → metres of the published unit.
    pub const METRES_PER_COUNT: f32 = 0.002_023_6;

    /// The published unit: h1 = 3.0 cm, h2 = 5.5 cm, γ = θ = 45°, r0 = 830.3 counts.
    pub const PUBLISHED: Self = PerceptronConstants {
        h1: 0.03,
        h2: 0.055,
        gamma: math::PI / 4.0,
        theta: math::PI / 4.0,
        standoff: 830.3 * Self::METRES_PER_COUNT,
    };

    pub(super) fn mirror_tangent(&self, inclination: f32) -> f32 {
        math::tan(self.theta + 0.5 * inclination)
    }

    pub(super) fn emission(&self, line: &LineTrig, rotation: Rows) -> Emission {
        Emission {
            travel: self.h1 / math::tan(self.gamma),
            h2: self.h2,
            path: self.standoff + self.h2,
            mirror: line.mirror,
            offset: line.azimuth_offset,
            rotation,
        }
    }
}

/// Where the beams of one line leave the scanner.
#[derive(Clone, Copy, Debug)]
pub(super) struct Emission {
    /// h1 / tan γ
    travel: f32,
    h2: f32,
    /// r0 + h2: the part of r3 − r that does not depend on the angles
    path: f32,
    mirror: f32,
    offset: Trig,
    rotation: Rows,
}

impl Emission {
    /// Offset of the point of emission, rotated, and the distance r3 from it.
    #[inline]
    pub(super) fn leave(&self, azimuth: &Trig, range: f32) -> ([f32; 3], f32) {
        let cos = azimuth.cos * self.offset.cos - azimuth.sin * self.offset.sin;
        let sin = azimuth.sin * self.offset.cos + azimuth.cos * self.offset.sin;
        let out = -self.travel * (1.0 - cos);
        let up = out * self.mirror;
        let q = (self.h2 + up) / cos;
        let length = range + self.path - out - math::abs(q);
        (times(&self.rotation, [out, q * sin, up]), length)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Beams, Geometry, Raster};
    use std::vec;

    /// Row, column, range count → X left, Y up, Z out, in centimetres.
    const PUBLISHED_VECTORS: [(usize, usize, f32, [f64; 3]); 6] = [
        (0, 0, 1000.0, [163.573962, 104.516381, 316.439269]),
        (0, 511, 1000.0, [-163.573962, 104.516381, 316.439269]),
        (255, 255, 0.0, [0.152755, 0.105185, 168.019409]),
        (256, 256, 2048.0, [-0.517595, -0.364637, 582.452447]),
        (511, 0, 4095.0, [435.910639, -282.445238, 851.632097]),
        (100, 400, 1500.0, [-120.091075, 88.184509, 447.694143]),
    ];

    /// α = 51.65° (255.5 − c) / 512, β = 36.73° (255.5 − r) / 512.
    fn published_raster() -> Raster {
        let axis = |field: f64| {
            let step = field.to_radians() / 512.0;
            [(255.5 * step) as f32, -step as f32]
        };
        Raster {
            azimuth: axis(51.65),
            inclination: axis(36.73),
        }
    }

    #[test]
    fn the_published_vectors() {
        let (mut columns, mut lines) = (vec![Trig::default(); 512], vec![LineTrig::default(); 512]);
        let geometry = Geometry::Perceptron(PerceptronConstants::PUBLISHED);
        let beams = Beams::new(geometry, published_raster(), &mut columns, &mut lines);
        for (row, column, count, [left, up, out]) in PUBLISHED_VECTORS {
            let range = count * PerceptronConstants::METRES_PER_COUNT;
            let found = beams.point(row, column, range).unwrap();
            for (found, expected) in found.into_iter().zip([out, left, up]) {
                let error = (f64::from(found) - expected / 100.0).abs();
                assert!(error < 3e-6, "({row}, {column}): {found} for {expected} cm");
            }
        }
    }

    #[test]
    fn an_azimuth_offset_is_a_shift_of_columns() {
        let (mut columns, mut lines) = (vec![Trig::default(); 512], vec![LineTrig::default(); 512]);
        let geometry = Geometry::Perceptron(PerceptronConstants::PUBLISHED);
        let raster = published_raster();
        let mut beams = Beams::new(geometry, raster, &mut columns, &mut lines);
        let expected = beams.point(40, 30, 3.0).unwrap();
        beams.set_azimuth_offset(40, -20.0 * raster.azimuth[1]);
        let found = beams.point(40, 50, 3.0).unwrap();
        for (found, expected) in found.iter().zip(expected) {
            assert!((found - expected).abs() < 3e-6);
        }
    }
}
