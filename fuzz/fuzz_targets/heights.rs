//! Any bytes as a compressed height field, as they are and with right checksums.
#![no_main]

#[path = "../../crates/rugosa-fractal/tests/common/hostile.rs"]
mod hostile;

libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    hostile::anything(data);
    hostile::with_right_checksums(data);
});
