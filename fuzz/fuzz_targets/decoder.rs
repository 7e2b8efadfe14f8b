//! Any bytes in any chunks.
#![no_main]

#[path = "../../crates/rugosa-wire/tests/common/hostile.rs"]
#[allow(dead_code)]
mod hostile;

libfuzzer_sys::fuzz_target!(|data: &[u8]| hostile::decoder(data));
