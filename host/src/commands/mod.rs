//! The commands, one file each: `Args` (what clap parses) and `run`.
//!
//! To add one: a file with `pub struct Args` (derive [`clap::Args`], a doc comment that
//! becomes the help, examples in `after_help`) and
//! `pub fn run(args: &Args, console: &Console) -> Result<()>`, a line in [`Command`] and a
//! line in [`run`].

pub mod completions;
pub mod config;
pub mod doctor;
pub mod info;
pub mod man;

use crate::console::Console;
use crate::error::Result;
use clap::Subcommand;

/// What to do.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Say what a file holds
    Info(info::Args),
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
        Command::Info(args) => info::run(args, console),
        Command::Config(args) => config::run(args, console),
        Command::Doctor(args) => doctor::run(args, console),
        Command::Completions(args) => completions::run(args, console),
        Command::Man(args) => man::run(args, console),
    }
}
