//! Host side of rugosa: readers and writers of points and rasters, drawings, and the
//! command `rugosa` on top of them.
//!
//! Everything a command does can be called from here; the command line ([`cli`]) only
//! parses, prints and turns a [`error::Failure`] into an exit code.

pub mod bridge;
pub mod cli;
pub mod commands;
pub mod config;
pub mod console;
pub mod draw;
pub mod error;
pub mod export;
pub mod io;
pub mod layers;
pub mod link;
pub mod offline;
pub mod plan;
pub mod planes;
pub mod reconstruct;
pub mod recording;
pub mod relaxation;
pub mod saved;
pub mod scaling;
pub mod view;
pub mod windows;
