//! Tables that follow from formulas, worked out when the crate is built.
//!
//! Only + − × ÷ in double precision and `libm`'s functions: the tables are the same
//! whatever machine builds them.

use std::{env, error::Error, fs, path::Path};

#[path = "build/pyramid.rs"]
mod pyramid;
#[path = "build/ziggurat.rs"]
mod ziggurat;

fn main() -> Result<(), Box<dyn Error>> {
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rerun-if-changed=build");
    let out = env::var("OUT_DIR")?;
    fs::write(Path::new(&out).join("ziggurat.rs"), ziggurat::table())?;
    println!("cargo::rerun-if-changed=src/pyramid/nnls.rs");
    fs::write(Path::new(&out).join("pyramid.rs"), pyramid::tables())?;
    Ok(())
}
