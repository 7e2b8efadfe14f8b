//! The commands, one file each: `Args` (what clap parses) and `run`.
//!
//! To add one: a file with `pub struct Args` (derive [`clap::Args`], a doc comment that
//! becomes the help, examples in `after_help`) and
//! `pub fn run(args: &Args, console: &Console) -> Result<()>`, a line in [`Command`] and a
//! line in [`run`].

pub mod completions;
pub mod compress;
pub mod config;
pub mod demo;
pub mod densify;
pub mod device;
pub mod dimension;
pub mod doctor;
pub mod fis;
pub mod hil;
pub mod ifs;
pub mod info;
pub mod live;
pub mod man;
pub mod map;
pub mod merge;
pub mod reconstruct;
pub mod record;
pub mod replay;
pub mod roughness;
pub mod scan;
pub mod send;
pub mod session;
pub mod simulate;
pub mod simulation;
pub mod synthesize;

use crate::console::Console;
use crate::error::Result;
use clap::Subcommand;

/// What to do.
#[derive(Debug, Subcommand)]
#[allow(clippy::large_enum_variant)]
pub enum Command {
    /// Run everything on this machine: scanner, cable, bridge, maps
    Demo(demo::Args),
    /// Map what a scanner on a serial port sends
    Scan(scan::Args),
    /// Map what a scanner sends and show it in a browser
    Live(live::Args),
    /// Record what a scanner on a serial port sends
    Record(record::Args),
    /// Map a recording, or play it into a serial port
    Replay(replay::Args),
    /// Play a simulated scanner into a serial port
    Simulate(simulate::Args),
    /// Run the firmware in the emulator and compare it with this machine
    Hil(hil::Args),
    /// Make a map of files of points or of rasters
    Map(map::Args),
    /// Merge saved maps by variance, or cut a part out of one
    Merge(merge::Args),
    /// Estimate the fractal dimension of points or of a raster
    Dimension(dimension::Args),
    /// Local roughness of a raster in moving windows
    Roughness(roughness::Args),
    /// Double the resolution of a raster with natural roughness
    Densify(densify::Args),
    /// Rebuild a raster with a fractal interpolation surface
    Fis(fis::Args),
    /// Fit or tabulate a projected IFS
    Ifs(ifs::Args),
    /// Compress a raster, with a bound on error or size
    Compress(compress::Args),
    /// Decompress a raster
    Decompress(compress::DecompressArgs),
    /// Say what a file holds
    Info(info::Args),
    /// A full surface from sparse points or a raster with holes
    Reconstruct(reconstruct::Args),
    /// A fractional Brownian surface of a given dimension
    Synthesize(synthesize::Args),
    /// Print or check the configuration
    Config(config::Args),
    /// Say which ports, permissions, tools and versions there are
    Doctor(doctor::Args),
    /// Print the completion script of a shell
    Completions(completions::Args),
    /// Write the manual pages
    Man(man::Args),
}

/// Runs a command.
pub fn run(command: &Command, console: &Console) -> Result<()> {
    match command {
        Command::Demo(args) => demo::run(args, console),
        Command::Scan(args) => scan::run(args, console),
        Command::Record(args) => record::run(args, console),
        Command::Replay(args) => replay::run(args, console),
        Command::Simulate(args) => simulate::run(args, console),
        Command::Hil(args) => hil::run(args, console),
        Command::Map(args) => map::run(args, console),
        Command::Merge(args) => merge::run(args, console),
        Command::Live(args) => live::run(args, console),
        Command::Dimension(args) => dimension::run(args, console),
        Command::Roughness(args) => roughness::run(args, console),
        Command::Densify(args) => densify::run(args, console),
        Command::Fis(args) => fis::run(args, console),
        Command::Ifs(args) => ifs::run(args, console),
        Command::Compress(args) => compress::run(args, console),
        Command::Decompress(args) => compress::run_decompress(args, console),
        Command::Info(args) => info::run(args, console),
        Command::Reconstruct(args) => reconstruct::run(args, console),
        Command::Synthesize(args) => synthesize::run(args, console),
        Command::Config(args) => config::run(args, console),
        Command::Doctor(args) => doctor::run(args, console),
        Command::Completions(args) => completions::run(args, console),
        Command::Man(args) => man::run(args, console),
    }
}
