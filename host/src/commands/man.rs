//! `rugosa man`: manual pages.

use crate::cli::Cli;
use crate::console::Console;
use crate::error::{Failure, Result};
use crate::io::atomic;
use clap::{Command, CommandFactory};
use clap_mangen::Man;
use std::path::{Path, PathBuf};

/// Write the manual pages: rugosa.1 and one page per command.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  rugosa man --out ~/.local/share/man/man1
  rugosa man | man -l -")]
pub struct Args {
    /// Directory for all pages; without it the page of `rugosa` is printed
    #[arg(long)]
    out: Option<PathBuf>,
}

/// Prints the main page or writes all pages.
pub fn run(args: &Args, console: &Console) -> Result<()> {
    let mut command = Cli::command();
    command.build();
    let Some(directory) = &args.out else {
        let page = String::from_utf8_lossy(&page(command)?).into_owned();
        return console.result(&serde_json::json!({ "page": page }), page.trim_end());
    };
    let mut files = vec![save(directory, "rugosa", command.clone())?];
    for sub in command.get_subcommands().filter(|c| !c.is_hide_set()) {
        files.push(save(
            directory,
            &format!("rugosa-{}", sub.get_name()),
            sub.clone(),
        )?);
    }
    let text = format!("{} pages in {}", files.len(), directory.display());
    console.result(&serde_json::json!({ "files": files }), text)
}

fn page(command: Command) -> Result<Vec<u8>> {
    let mut page = Vec::new();
    Man::new(command)
        .render(&mut page)
        .map_err(Failure::runtime)?;
    Ok(page)
}

fn save(directory: &Path, name: &str, command: Command) -> Result<PathBuf> {
    let path = directory.join(format!("{name}.1"));
    let page = page(command.display_name(name.to_owned()))?;
    atomic::write(&path, |writer| writer.write_all(&page))?;
    Ok(path)
}
