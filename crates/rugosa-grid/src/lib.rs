//! The ground floor of rugosa: the one door to floating-point functions, cells and
//! their moving window, point samples and tiles.
//!
//! Nothing here knows of sensors, bytes or statistics. All geometry that two other
//! crates must agree on lives here, once.
#![no_std]
#![forbid(unsafe_code)]

pub mod math;
pub mod sample;
pub mod tile;
pub mod window;

pub use sample::{Sample, State};
pub use tile::{TILE, Tile, TileBits, Tiles};
pub use window::{Cell, Lattice, Window};
