//! Fingerprints of the numerics: the same on the host and on every microcontroller.
//!
//! Each [`Check`] runs one part of the core on thousands of inputs and folds the bits
//! of every result into one number. The expected numbers are in `expected.rs`. A host
//! test and an on-target test compare with them, so a single different bit anywhere is
//! found on the side that differs.
#![no_std]
#![forbid(unsafe_code)]

mod codec;
#[rustfmt::skip]
mod expected;
mod fold;
mod math;

pub use fold::Fold;

/// One part of the core.
pub struct Check {
    /// what is checked
    pub name: &'static str,
    /// name of its constant in `expected.rs`
    pub constant: &'static str,
    /// computes the fingerprint
    pub run: fn() -> u32,
    /// what it has to be
    pub expected: u32,
}

impl Check {
    /// Is the fingerprint the expected one?
    pub fn passes(&self) -> bool {
        (self.run)() == self.expected
    }
}

macro_rules! checks {
    ($($name:literal $run:path, $expected:ident;)*) => {
        &[$(Check { name: $name, run: $run, constant: stringify!($expected), expected: expected::$expected }),*]
    };
}

/// Every check.
pub const CHECKS: &[Check] = checks! {
    "square root" math::sqrt, SQRT;
    "sine, cosine, tangent" math::circular, CIRCULAR;
    "inverse sine, arc tangent" math::arcs, ARCS;
    "logarithms" math::logarithms, LOGARITHMS;
    "exponentials" math::exponentials, EXPONENTIALS;
    "powers" math::powers, POWERS;
    "complementary error function" math::error_function, ERROR_FUNCTION;
    "rounding" math::rounding, ROUNDING;
    "codec, exact" codec::exact, CODEC_EXACT;
    "codec, rounded coefficients" codec::rounded, CODEC_ROUNDED;
    "codec, quick" codec::quick, CODEC_QUICK;
};
