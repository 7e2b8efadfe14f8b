//! The command `rugosa`.
fn main() {}
