//! `rugosa completions SHELL`.

use crate::cli::Cli;
use crate::console::Console;
use crate::error::Result;
use clap::CommandFactory;
use clap_complete::Shell;

/// Print the completion script of a shell.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  rugosa completions bash > ~/.local/share/bash-completion/completions/rugosa
  rugosa completions zsh > ~/.zfunc/_rugosa
  rugosa completions fish > ~/.config/fish/completions/rugosa.fish")]
pub struct Args {
    /// Which shell
    shell: Shell,
}

/// Prints the script.
pub fn run(args: &Args, console: &Console) -> Result<()> {
    let mut script = Vec::new();
    clap_complete::generate(args.shell, &mut Cli::command(), "rugosa", &mut script);
    let script = String::from_utf8_lossy(&script);
    console.result(&serde_json::json!({ "script": script }), script.trim_end())
}
