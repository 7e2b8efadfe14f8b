//! `rugosa config`: the configuration as a commented TOML file.

use crate::config::Settings;
use crate::console::Console;
use crate::error::Result;
use rugosa::config::PARAMETERS;
use serde_json::{Map, Value, json};
use std::path::PathBuf;

/// Print the configuration, with a comment for every parameter.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  rugosa config > rugosa.toml        the defaults, to be edited
  rugosa config rugosa.toml          check a file and print what it sets")]
pub struct Args {
    /// A configuration to check; without it the defaults are printed
    file: Option<PathBuf>,
}

/// Prints the configuration.
pub fn run(args: &Args, console: &Console) -> Result<()> {
    let settings = Settings::read(args.file.as_deref())?;
    console.result(&object(&settings), settings.to_toml().trim_end())
}

fn object(settings: &Settings) -> Value {
    let mut object = Map::new();
    object.insert("side".into(), json!(settings.side));
    for p in PARAMETERS {
        object.insert(p.name.into(), json!(p.get(&settings.mapper)));
    }
    Value::Object(object)
}
