//! A link under any bytes and any passage of time.
#![no_main]

#[path = "../../crates/rugosa-wire/tests/common/hostile.rs"]
#[allow(dead_code)]
mod hostile;

libfuzzer_sys::fuzz_target!(|data: &[u8]| hostile::link(data));
