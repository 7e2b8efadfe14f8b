//! The rays of one scan line under one pose.

use super::perceptron::Emission;
use super::{Geometry, LineTrig, Trig};
use crate::{Noise, Point};
use nalgebra::Isometry3;

/// A 3 × 3 matrix by rows.
pub(super) type Rows = [[f32; 3]; 3];

/// One beam and how far it went.
///
/// ```
/// use rugosa_terrain::{Noise, Ray};
/// // straight down from 3 m above the map's origin
/// let ray = Ray { origin: [0.0, 0.0, 3.0], direction: [0.0, 0.0, -1.0], length: 2.5 };
/// assert_eq!(ray.point(), [0.0, 0.0, 0.5]);
/// let point = ray.measured(&Noise::new(0.1, 0.0, 0.0));
/// assert_eq!((point.position, point.depression), ([0.0, 0.0, 0.5], 1.0));
/// assert!((point.variance - 0.01).abs() < 1e-6); // m²
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// where it left the scanner \[m\]
    pub origin: [f32; 3],
    /// unit vector
    pub direction: [f32; 3],
    /// distance from the origin to the return \[m\]
    pub length: f32,
}

impl Ray {
    /// Where it hit \[m\].
    #[inline]
    pub fn point(&self) -> [f32; 3] {
        core::array::from_fn(|i| self.origin[i] + self.length * self.direction[i])
    }

    /// The return with its variance and the depression of the beam; the ray must be in
    /// the map frame.
    #[inline]
    pub fn measured(&self, noise: &Noise) -> Point {
        let up = self.direction[2];
        Point {
            position: self.point(),
            variance: noise.elevation_variance(up, self.length),
            depression: -up,
        }
    }
}

/// All rays of a line, in the frame of the pose they were made with.
///
/// ```
/// use nalgebra::{Isometry3, Vector3};
/// use rugosa_terrain::{Beams, Geometry, Raster, Trig};
/// let raster = Raster { azimuth: [0.0, 0.5], inclination: [0.0, 0.0] };
/// let (mut columns, mut lines) = ([Trig::ZERO; 3], [Default::default(); 1]);
/// let beams = Beams::new(Geometry::Spherical, raster, &mut columns, &mut lines);
/// // the sensor looks north: its front is the map's y
/// let north = Isometry3::rotation(Vector3::z() * core::f32::consts::FRAC_PI_2);
/// let rays = beams.rays(0, &north).unwrap();
/// assert_eq!(rays.len(), 3);
/// let [x, y, _] = rays.ray(0, 4.0).unwrap().point();
/// assert!(x.abs() < 1e-5 && (y - 4.0).abs() < 1e-5);
/// assert!(rays.ray(1, 4.0).unwrap().direction[0] < 0.0 && rays.ray(3, 4.0).is_none());
/// ```
#[derive(Debug)]
pub struct Rays<'b> {
    columns: &'b [Trig],
    rows: Rows,
    translation: [f32; 3],
    emission: Option<Emission>,
}

impl<'b> Rays<'b> {
    pub(super) fn new(
        geometry: &Geometry,
        line: &LineTrig,
        columns: &'b [Trig],
        pose: &Isometry3<f32>,
    ) -> Self {
        let rotation = rotation_rows(pose);
        let (line_rows, emission) = match geometry {
            Geometry::Spherical => (spherical_rows(line), None),
            Geometry::Perceptron(constants) => (
                perceptron_rows(line),
                Some(constants.emission(line, rotation)),
            ),
        };
        Rays {
            columns,
            rows: core::array::from_fn(|i| left_times(rotation[i], &line_rows)),
            translation: pose.translation.vector.into(),
            emission,
        }
    }

    /// Columns of the line.
    pub fn len(&self) -> usize {
        self.columns.len()
    }

    /// Has the line no columns?
    pub fn is_empty(&self) -> bool {
        self.columns.is_empty()
    }

    /// The ray of a column with the scanner's `range` \[m\]; `None` where there is no
    /// such column.
    #[inline]
    pub fn ray(&self, column: usize, range: f32) -> Option<Ray> {
        let azimuth = self.columns.get(column)?;
        let direction = self
            .rows
            .map(|r| r[0] * azimuth.cos + r[1] * azimuth.sin + r[2]);
        let Some(emission) = &self.emission else {
            return Some(Ray {
                origin: self.translation,
                direction,
                length: range,
            });
        };
        let (offset, length) = emission.leave(azimuth, range);
        Some(Ray {
            origin: core::array::from_fn(|i| self.translation[i] + offset[i]),
            direction,
            length,
        })
    }
}

/// The rotation of a pose; products and sums only.
pub(crate) fn rotation_rows(pose: &Isometry3<f32>) -> Rows {
    let rotation = pose.rotation.to_rotation_matrix();
    let m = rotation.matrix();
    core::array::from_fn(|i| core::array::from_fn(|j| m[(i, j)]))
}

/// Multiplies a matrix by a column vector.
#[inline]
pub(super) fn times(rows: &Rows, v: [f32; 3]) -> [f32; 3] {
    rows.map(|r| r[0] * v[0] + r[1] * v[1] + r[2] * v[2])
}

fn left_times(row: [f32; 3], m: &Rows) -> [f32; 3] {
    core::array::from_fn(|j| row[0] * m[0][j] + row[1] * m[1][j] + row[2] * m[2][j])
}

fn spherical_rows(line: &LineTrig) -> Rows {
    let (incl, off) = (line.inclination, line.azimuth_offset);
    [
        [incl.cos * off.cos, -incl.cos * off.sin, 0.0],
        [incl.cos * off.sin, incl.cos * off.cos, 0.0],
        [0.0, 0.0, incl.sin],
    ]
}

fn perceptron_rows(line: &LineTrig) -> Rows {
    let (incl, off) = (line.inclination, line.azimuth_offset);
    [
        [incl.cos * off.cos, -incl.cos * off.sin, 0.0],
        [off.sin, off.cos, 0.0],
        [incl.sin * off.cos, -incl.sin * off.sin, 0.0],
    ]
}

#[cfg(test)]
mod tests {
    use crate::{Beams, Geometry, LineTrig, Noise, Raster, Trig};
    use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
    use proptest::prelude::*;

    const RASTER: Raster = Raster {
        azimuth: [-3.1, 0.7],
        inclination: [-1.2, 0.31],
    };

    proptest! {
        #[test]
        fn spherical_against_f64(
            line in 0..5usize, column in 0..9usize, range in 0.1f32..100.0,
            offset in -0.5f32..0.5, euler in prop::array::uniform3(-3f32..3.0)
        ) {
            let (mut columns, mut lines) = ([Trig::default(); 9], [LineTrig::default(); 5]);
            let mut beams = Beams::new(Geometry::Spherical, RASTER, &mut columns, &mut lines);
            beams.set_azimuth_offset(line, offset);
            let rotation = UnitQuaternion::from_euler_angles(euler[0], euler[1], euler[2]);
            let pose = Isometry3::from_parts(Translation3::new(3.0, -7.0, 1.5), rotation);
            let ray = beams.rays(line, &pose).unwrap().ray(column, range).unwrap();

            let azimuth = -3.1 + 0.7 * column as f64 + f64::from(offset);
            let inclination = -1.2 + 0.31 * line as f64;
            let unit = Vector3::new(
                inclination.cos() * azimuth.cos(),
                inclination.cos() * azimuth.sin(),
                inclination.sin(),
            );
            let exact = pose.cast::<f64>() * nalgebra::Point3::from(unit * f64::from(range));
            for (&found, expected) in ray.point().iter().zip(exact.coords.iter()) {
                prop_assert!((f64::from(found) - expected).abs() < 2e-6 * f64::from(range) + 2e-6);
            }
            prop_assert_eq!(ray.origin, [3.0, -7.0, 1.5]);
            prop_assert_eq!(ray.length, range);
        }
    }

    #[test]
    fn left_is_positive_and_so_is_up() {
        let (mut columns, mut lines) = ([Trig::default(); 2], [LineTrig::default(); 2]);
        let raster = Raster {
            azimuth: [0.0, 0.1],
            inclination: [0.0, 0.1],
        };
        let beams = Beams::new(Geometry::Spherical, raster, &mut columns, &mut lines);
        let [x, y, z] = beams.point(0, 1, 10.0).unwrap();
        assert!(x > 9.9 && (y - 0.998).abs() < 1e-3 && z == 0.0);
        let [x, y, z] = beams.point(1, 0, 10.0).unwrap();
        assert!(x > 9.9 && (z - 0.998).abs() < 1e-3 && y == 0.0);
        assert_eq!(beams.point(2, 0, 1.0), None);
        assert_eq!(beams.point(0, 2, 1.0), None);
    }

    #[test]
    fn tables_override_the_raster() {
        let (mut columns, mut lines) = ([Trig::default(); 4], [LineTrig::default(); 3]);
        let mut beams = Beams::new(Geometry::Spherical, RASTER, &mut columns, &mut lines);
        assert!(beams.set_azimuth(3, 0.4) && beams.set_inclination(2, -0.2));
        assert!(beams.set_azimuth_offset(2, -0.1));
        assert!(!beams.set_azimuth(4, 0.0) && !beams.set_inclination(3, 0.0));
        assert!(!beams.set_azimuth_offset(3, 0.0));
        let [x, y, z] = beams.point(2, 3, 5.0).unwrap();
        assert!((y.atan2(x) - 0.3).abs() < 1e-6 && (z - 5.0 * (-0.2f32).sin()).abs() < 1e-5);
    }

    #[test]
    fn depression_is_positive_downward() {
        let (mut columns, mut lines) = ([Trig::default(); 1], [LineTrig::default(); 2]);
        let raster = Raster {
            azimuth: [0.0, 0.0],
            inclination: [-core::f32::consts::FRAC_PI_2, core::f32::consts::PI],
        };
        let beams = Beams::new(Geometry::Spherical, raster, &mut columns, &mut lines);
        let noise = Noise::new(0.01, 0.0, 0.001);
        for (line, expected) in [(0, 1.0), (1, -1.0)] {
            let rays = beams.rays(line, &Isometry3::identity()).unwrap();
            let depression = rays.ray(0, 2.0).unwrap().measured(&noise).depression;
            assert!((depression - expected).abs() < 1e-6);
        }
    }
}
