//! From the beams of a scanner to an elevation grid that moves with the robot.
//!
//! | module | what it does |
//! |---|---|
//! | [`range`] | is a range a measurement? the causes why not |
//! | [`beam`] | line, column, range → a ray in any frame; tables instead of sin and cos |
//! | [`pose`] | the body's pose at the instant of a return |
//! | [`noise`] | variance of a return's elevation |
//! | [`grid`] | fusion into cells, the moving window, clearing of ghosts |
//!
//! All lengths are metres, angles radians, time stamps microseconds; frames follow
//! REP-103 (x forward, y left, z up; in the map x east, y north). The memory of tables
//! and planes is lent by the caller.
//!
//! ```
//! use nalgebra::{Isometry3, Translation3, UnitQuaternion};
//! use rugosa_grid::{Cell, Sample, Window};
//! use rugosa_terrain::{Beams, ElevationGrid, Geometry, GridConfig, GroundCell, Noise, Raster};
//!
//! // four beams to the front that look down by 45°
//! let raster = Raster { azimuth: [-0.15, 0.1], inclination: [-0.785_398, 0.0] };
//! let (mut columns, mut lines) = ([Default::default(); 4], [Default::default(); 1]);
//! let beams = Beams::new(Geometry::Spherical, raster, &mut columns, &mut lines);
//!
//! let (mut cells, mut samples) = ([GroundCell::default(); 33 * 33], [Sample::default(); 33 * 33]);
//! let window = Window::around(33, Cell::new(0, 0));
//! let mut grid = ElevationGrid::new(GridConfig::new(0.1), window, &mut cells, &mut samples).unwrap();
//!
//! let map_from_sensor = Isometry3::from_parts(
//!     Translation3::new(0.0, 0.0, 1.0),
//!     UnitQuaternion::identity(),
//! );
//! let noise = Noise::new(0.01, 0.0, 0.001);
//! let rays = beams.rays(0, &map_from_sensor).unwrap();
//! for column in 0..4 {
//!     let ray = rays.ray(column, 1.414_214).unwrap();
//!     grid.fuse(&ray.measured(&noise), 1);
//! }
//! let ground = grid.ground(Cell::new(9, 0)).unwrap();
//! assert!(ground.elevation.abs() < 1e-5 && ground.count == 1);
//! ```
#![no_std]
#![forbid(unsafe_code)]

#[cfg(test)]
extern crate std;

pub mod beam;
pub mod grid;
pub mod noise;
pub mod pose;
pub mod range;

pub use beam::{Beams, Geometry, LineTrig, PerceptronConstants, Raster, Ray, Rays, Trig};
pub use grid::{
    ElevationGrid, Fused, GridConfig, GridError, Ground, GroundCell, Point, SampleChoice, Tally,
};
pub use noise::Noise;
pub use pose::{NoPose, PoseBuffer, PoseError};
pub use range::{RangeFault, RangeLimits};
