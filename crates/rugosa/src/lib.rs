//! Rough-terrain module: roughness, reconstruction and traversability on board.
//!
//! [`Mapper`] is the pipeline: messages of a scanner go in, a map of elevations and of
//! fractal roughness comes out. It works in lent memory ([`Planes`] owns it), allocates
//! nothing, and gives the same bits on a Cortex-M and on a workstation.
#![no_std]
#![forbid(unsafe_code)]

#[cfg(test)]
extern crate std;

pub mod config;
pub mod counters;
mod digest;
pub mod ingest;
pub mod layer;
pub mod mapper;
pub mod memory;
pub mod outbox;
mod progress;
pub mod reconstruct;
pub mod report;
pub mod restore;
pub mod tiles;
pub mod traversability;
pub mod values;

pub use config::{Config, ConfigError, PARAMETERS};
pub use counters::Counters;
pub use layer::{LAYERS, Layer};
pub use mapper::Mapper;
pub use memory::{
    Memory, Planes, Planes33, Planes65, Planes129, Solver, Solver33, Solver65, Solver129, is_side,
    solver_of, tiles_of,
};
pub use outbox::Outbox;
pub use report::{Stage, SweepReport};
pub use tiles::TileGround;
