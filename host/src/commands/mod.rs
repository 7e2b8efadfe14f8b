//! The commands, one file each: `Args` (what clap parses) and `run`.
//!
//! To add one: a file with `pub struct Args` (derive [`clap::Args`], a doc comment that
//! becomes the help, examples in `after_help`) and
//! `pub fn run(args: &Args, console: &Console) -> Result<()>`, a line in [`Command`] and a
//! line in [`run`].

pub mod info;

use crate::console::Console;
use crate::error::Result;
use clap::Subcommand;

/// What to do.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Say what a file holds
    Info(info::Args),
}

/// Runs a command.
pub fn run(command: &Command, console: &Console) -> Result<()> {
    match command {
        Command::Info(args) => info::run(args, console),
    }
}
