//! The command line.

use crate::commands::{self, Command};
use crate::console::Console;
use clap::Parser;
use std::process::ExitCode;

/// Rough-terrain module: maps of elevation and fractal roughness from range scans.
#[derive(Debug, Parser)]
#[command(name = "rugosa", version, max_term_width = 100, after_help = EXIT_CODES)]
pub struct Cli {
    /// Print nothing on standard error but errors
    #[arg(long, short, global = true)]
    pub quiet: bool,

    /// Print the result as one JSON object on standard output
    #[arg(long, global = true)]
    pub json: bool,

    /// What to do
    #[command(subcommand)]
    pub command: Command,
}

const EXIT_CODES: &str = "\
Exit codes: 0 done; 1 failed while running (port, disk, …); 2 bad input or usage.
Results go to standard output, progress and errors to standard error.";

/// Parses the command line and runs it.
pub fn main() -> ExitCode {
    let cli = Cli::parse();
    let console = Console {
        quiet: cli.quiet,
        json: cli.json,
    };
    match commands::run(&cli.command, &console) {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            eprintln!("rugosa: {failure}");
            failure.exit_code()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    #[test]
    fn the_command_line_is_consistent() {
        Cli::command().debug_assert();
    }
}
