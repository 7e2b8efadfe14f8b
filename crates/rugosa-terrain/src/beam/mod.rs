//! From line, column and range to a ray.
//!
//! A scanner has a raster of azimuths θ (by column, positive to the left) and
//! inclinations φ (by line, positive upward). For both geometries the unit direction of
//! a beam is linear in (cos θ, sin θ, 1) with a matrix that depends only on the line,
//!
//! ```text
//! u = E_line · (cos θ, sin θ, 1)ᵀ
//! spherical:   u = (cos φ cos α, cos φ sin α, sin φ)
//! Perceptron:  u = (cos φ cos α, sin α, sin φ cos α)         α = θ + offset_line
//! ```
//!
//! so the angle addition (the azimuth offset of a line) and the rotation into the map
//! are folded into one 3 × 3 matrix per line, [`Rays`]. A return costs 6
//! multiplications for its direction and 3 for its point; sines and cosines are taken
//! once, when the tables are filled.
//!
//! Frame: REP-103, x forward, y left, z up, origin at the sensor.
//!
//! Accuracy: f32, 1e-6 of the range (`perceptron::tests`, `spherical_against_f64`).

mod perceptron;
mod rays;

pub use perceptron::PerceptronConstants;
pub(crate) use rays::rotation_rows;
pub use rays::{Ray, Rays};

use nalgebra::Isometry3;
use rugosa_grid::math;

/// How the beams leave the scanner.
///
/// ```
/// use rugosa_terrain::{Beams, Geometry, PerceptronConstants, Raster, Trig};
/// let raster = Raster { azimuth: [0.5, 0.0], inclination: [-0.3, 0.0] }; // rad
/// let (mut columns, mut lines) = ([Trig::ZERO; 1], [Default::default(); 1]);
/// let beams = Beams::new(Geometry::Spherical, raster, &mut columns, &mut lines);
/// let [x, y, z] = beams.point(0, 0, 2.0).unwrap();
/// // to the left and downward, at the range itself
/// assert!(x > 0.0 && (y - 2.0 * 0.3f32.cos() * 0.5f32.sin()).abs() < 1e-6);
/// assert!((z + 2.0 * 0.3f32.sin()).abs() < 1e-6);
/// let mirrors = Geometry::Perceptron(PerceptronConstants::PUBLISHED);
/// let beams = Beams::new(mirrors, raster, &mut columns, &mut lines);
/// let [x, y, z] = beams.point(0, 0, 2.0).unwrap();
/// // its ranges count from the standoff of 1.68 m, and from a point that moves
/// assert!(((x * x + y * y + z * z).sqrt() - 3.68).abs() < 0.1);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Geometry {
    /// all beams come from the origin; range, azimuth and inclination are spherical
    /// coordinates
    Spherical,
    /// two mirrors: the point of emission moves with the angles
    Perceptron(PerceptronConstants),
}

/// A regular raster of angles: `[first, step]` in radians.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Raster {
    /// by column, positive to the left
    pub azimuth: [f32; 2],
    /// by line, positive upward
    pub inclination: [f32; 2],
}

/// Sine and cosine of an angle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Trig {
    /// sine
    pub sin: f32,
    /// cosine
    pub cos: f32,
}

impl Trig {
    /// Of the angle 0.
    pub const ZERO: Trig = Trig { sin: 0.0, cos: 1.0 };

    /// Of an angle in radians.
    ///
    /// ```
    /// use rugosa_terrain::Trig;
    /// let trig = Trig::of(core::f32::consts::FRAC_PI_6);
    /// assert!((trig.sin - 0.5).abs() < 1e-6 && (trig.cos - 0.75f32.sqrt()).abs() < 1e-6);
    /// ```
    pub fn of(angle: f32) -> Self {
        Trig {
            sin: math::sin(angle),
            cos: math::cos(angle),
        }
    }
}

impl Default for Trig {
    fn default() -> Self {
        Trig::ZERO
    }
}

/// What a line has in common.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LineTrig {
    /// its inclination
    pub inclination: Trig,
    /// added to the azimuth of every column
    pub azimuth_offset: Trig,
    /// tan(θ + φ/2) of the Perceptron's second mirror; 0 for the spherical model
    pub mirror: f32,
}

impl LineTrig {
    /// Of the angles 0.
    pub const ZERO: LineTrig = LineTrig {
        inclination: Trig::ZERO,
        azimuth_offset: Trig::ZERO,
        mirror: 0.0,
    };
}

impl Default for LineTrig {
    fn default() -> Self {
        LineTrig::ZERO
    }
}

/// The beams of a scanner: geometry and tables.
///
/// ```
/// use nalgebra::Isometry3;
/// use rugosa_terrain::{Beams, Geometry, Raster, Trig};
/// // 360 columns all around, from the front to the left; two lines 0.1 and 0.2 rad down
/// let step = core::f32::consts::TAU / 360.0;
/// let raster = Raster { azimuth: [0.0, step], inclination: [-0.1, -0.1] };
/// let (mut columns, mut lines) = ([Trig::ZERO; 360], [Default::default(); 2]);
/// let beams = Beams::new(Geometry::Spherical, raster, &mut columns, &mut lines);
/// // the sensor stands at (5, 0, 2) in the map; line 1, to the left, 10 m far
/// let rays = beams.rays(1, &Isometry3::translation(5.0, 0.0, 2.0)).unwrap();
/// let [x, y, z] = rays.ray(90, 10.0).unwrap().point();
/// assert!((x - 5.0).abs() < 1e-5 && (y - 10.0 * 0.2f32.cos()).abs() < 1e-5);
/// assert!((z - (2.0 - 10.0 * 0.2f32.sin())).abs() < 1e-5);
/// ```
#[derive(Debug)]
pub struct Beams<'m> {
    geometry: Geometry,
    columns: &'m mut [Trig],
    lines: &'m mut [LineTrig],
    /// columns and lines of the raster; the tables may be longer
    size: [usize; 2],
}

impl<'m> Beams<'m> {
    /// Fills the lent tables from a regular raster; their lengths are the scanner's
    /// columns per line and lines per sweep.
    pub fn new(
        geometry: Geometry,
        raster: Raster,
        columns: &'m mut [Trig],
        lines: &'m mut [LineTrig],
    ) -> Self {
        let size = [columns.len(), lines.len()];
        let mut beams = Beams::unknown(columns, lines);
        beams.describe(geometry, raster, size);
        beams
    }

    /// A scanner without beams, until [`Beams::describe`]; the lent tables say how many
    /// columns and lines it may have.
    pub fn unknown(columns: &'m mut [Trig], lines: &'m mut [LineTrig]) -> Self {
        Beams {
            geometry: Geometry::Spherical,
            columns,
            lines,
            size: [0; 2],
        }
    }

    /// Takes over another scanner with a regular raster of `size` = columns and lines;
    /// `false`, and nothing changed, where the tables are too short.
    ///
    /// ```
    /// use rugosa_terrain::{Beams, Geometry, Raster, Trig};
    /// let (mut columns, mut lines) = ([Trig::ZERO; 64], [Default::default(); 16]);
    /// let mut beams = Beams::unknown(&mut columns, &mut lines);
    /// assert_eq!(beams.point(0, 0, 1.0), None);
    /// let raster = Raster { azimuth: [0.0, 0.01], inclination: [0.0, 0.01] };
    /// assert!(beams.describe(Geometry::Spherical, raster, [32, 8]));
    /// assert_eq!(beams.point(0, 0, 1.0), Some([1.0, 0.0, 0.0]));
    /// assert!(!beams.describe(Geometry::Spherical, raster, [65, 8]));
    /// assert_eq!((beams.columns(), beams.lines()), (32, 8));
    /// ```
    pub fn describe(&mut self, geometry: Geometry, raster: Raster, size: [usize; 2]) -> bool {
        if size[0] > self.columns.len() || size[1] > self.lines.len() {
            return false;
        }
        (self.geometry, self.size) = (geometry, size);
        self.lines.fill(LineTrig::default());
        for column in 0..size[0] {
            self.set_azimuth(column, nth(raster.azimuth, column));
        }
        for line in 0..size[1] {
            self.set_inclination(line, nth(raster.inclination, line));
        }
        true
    }

    /// Columns per line.
    pub fn columns(&self) -> usize {
        self.size[0]
    }

    /// Lines per sweep.
    pub fn lines(&self) -> usize {
        self.size[1]
    }

    /// The geometry.
    pub fn geometry(&self) -> &Geometry {
        &self.geometry
    }

    /// Replaces the azimuth \[rad\] of a column; `false` where there is no such column.
    pub fn set_azimuth(&mut self, column: usize, azimuth: f32) -> bool {
        let entry = self.columns[..self.size[0]].get_mut(column);
        entry.map(|trig| *trig = Trig::of(azimuth)).is_some()
    }

    /// Replaces the inclination \[rad\] of a line; `false` where there is no such line.
    pub fn set_inclination(&mut self, line: usize, inclination: f32) -> bool {
        let mirror = match &self.geometry {
            Geometry::Spherical => 0.0,
            Geometry::Perceptron(constants) => constants.mirror_tangent(inclination),
        };
        let entry = self.lines[..self.size[1]].get_mut(line);
        entry
            .map(|trig| {
                trig.inclination = Trig::of(inclination);
                trig.mirror = mirror;
            })
            .is_some()
    }

    /// Sets the angle \[rad\] that a line adds to every azimuth (0 at first); `false`
    /// where there is no such line.
    ///
    /// ```
    /// use rugosa_terrain::{Beams, Geometry, Raster, Trig};
    /// let raster = Raster { azimuth: [0.1, 0.0], inclination: [0.0, 0.0] };
    /// let (mut columns, mut lines) = ([Trig::ZERO; 1], [Default::default(); 2]);
    /// let mut beams = Beams::new(Geometry::Spherical, raster, &mut columns, &mut lines);
    /// assert!(beams.set_azimuth_offset(1, -0.3) && beams.set_inclination(1, 0.2));
    /// let left = |line| beams.point(line, 0, 1.0).unwrap()[1];
    /// assert!((left(0) - 0.1f32.sin()).abs() < 1e-6);
    /// assert!((left(1) + 0.2f32.sin() * 0.2f32.cos()).abs() < 1e-6); // 0.1 − 0.3 rad
    /// assert!(!beams.set_azimuth_offset(2, 0.0)); // no such line
    /// ```
    pub fn set_azimuth_offset(&mut self, line: usize, offset: f32) -> bool {
        let entry = self.lines[..self.size[1]].get_mut(line);
        entry
            .map(|trig| trig.azimuth_offset = Trig::of(offset))
            .is_some()
    }

    /// The rays of one line in the frame that `pose` leads to (`map_from_sensor`);
    /// `None` where there is no such line.
    pub fn rays(&self, line: usize, pose: &Isometry3<f32>) -> Option<Rays<'_>> {
        let trig = self.lines[..self.size[1]].get(line)?;
        let columns = &self.columns[..self.size[0]];
        Some(Rays::new(&self.geometry, trig, columns, pose))
    }

    /// The point \[m\] of one return in the sensor frame; `None` outside the raster.
    ///
    /// For single points and tests: it sets up a whole line. Use [`Beams::rays`].
    pub fn point(&self, line: usize, column: usize, range: f32) -> Option<[f32; 3]> {
        let rays = self.rays(line, &Isometry3::identity())?;
        Some(rays.ray(column, range)?.point())
    }
}

fn nth([first, step]: [f32; 2], index: usize) -> f32 {
    first + step * index as f32
}
