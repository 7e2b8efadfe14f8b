//! Runs an image in the emulator to its end and prints what it logs.
//!
//! ```text
//! cargo run -p rugosa-hil --example log -- solver
//! ```

use anyhow::{Context, Result};

fn main() -> Result<()> {
    let name = std::env::args().nth(1).context("which image?")?;
    for entry in rugosa_hil::costs::logged(&rugosa_hil::image(&name)?, &[])? {
        println!("{entry}");
    }
    Ok(())
}
