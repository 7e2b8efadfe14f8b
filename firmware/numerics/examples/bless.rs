//! Writes `src/expected.rs` anew from what this machine computes:
//! `cargo run --release --example bless` in this folder.

use rugosa_numerics::CHECKS;
use std::{fmt::Write, fs, io, path::Path};

fn main() -> io::Result<()> {
    let mut text =
        String::from("//! Fingerprints of an x86-64 host, written by `examples/bless.rs`.\n\n");
    for check in CHECKS {
        let _ = writeln!(
            text,
            "pub const {}: u32 = 0x{:08x};",
            check.constant,
            (check.run)()
        );
    }
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("src/expected.rs");
    fs::write(path, text)
}
