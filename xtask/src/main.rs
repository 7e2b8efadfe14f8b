//! Developer tasks: `cargo xtask test` runs everything that has to pass.
//!
//! Each step prints one line when it starts and one when it ends. A step whose tool
//! cannot be had is *skipped*, which is said again in the last lines; with the
//! environment variable `CI` set a skipped step is a failure.

mod bare_metal;
mod layers;
mod steps;

use std::process::ExitCode;

const HELP: &str = "\
cargo xtask COMMAND

  test            all of the following, in this order; what CI runs
  fmt             formatting
  lint            clippy, warnings are errors
  layers          which crate may depend on which, no_std, no unsafe
  unit            cargo test of the host workspace
  doc             API documentation builds without a warning
  bare-metal      the no_std crates build for a Cortex-M4F, the firmware for every board
  hil             the firmware in the emulator against the host, bit for bit

Several commands may be given: cargo xtask fmt lint

  firmware BOARD  builds the image of a board and says where it is";

fn main() -> ExitCode {
    let names: Vec<String> = std::env::args().skip(1).collect();
    if let [first, board] = &names[..]
        && first == "firmware"
    {
        return match bare_metal::firmware(board) {
            Ok(()) => ExitCode::SUCCESS,
            Err(error) => {
                eprintln!("{error:#}");
                ExitCode::FAILURE
            }
        };
    }
    match steps::selected(&names) {
        Some(steps) if !steps.is_empty() => steps::run(&steps),
        _ => {
            eprintln!("{HELP}");
            let asked = names.iter().any(|n| n == "--help" || n == "help");
            ExitCode::from(if asked { 0 } else { 2 })
        }
    }
}
