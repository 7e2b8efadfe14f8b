//! The ground floor of rugosa: the one door to floating-point functions, cells and
//! their moving window, point samples and tiles.
//!
//! Nothing here knows of sensors, bytes or statistics. All geometry that two other
//! crates must agree on lives here, once.
//!
//! ```
//! use rugosa_grid::{Cell, Lattice, Tile, Window};
//! let lattice = Lattice::new(0.1); // cells of 0.1 m
//! let (cell, ..) = lattice.locate(1.23, -0.01);
//! assert_eq!((cell, Tile::of(cell)), (Cell::new(12, -1), Tile::new(1, -1)));
//! let window = Window::around(33, Cell::new(0, 0));
//! assert!(window.contains(cell) && !window.contains(Cell::new(17, 0)));
//! ```
#![no_std]
#![forbid(unsafe_code)]

pub mod math;
pub mod sample;
pub mod tile;
pub mod window;

pub use sample::{Sample, State};
pub use tile::{TILE, Tile, TileBits, Tiles};
pub use window::{Cell, Lattice, Window};
