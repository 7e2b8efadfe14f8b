//! Simulated hardware for rugosa: a scanner on a robot on a terrain, serial cables with
//! faults, a player of recordings, and an emulator of the module.
//!
//! ```text
//! terrain → robot → scanner → stream → transmit → port (→ faults) → whoever listens
//! ```
//!
//! - [`terrain`]: surfaces, and where a ray meets them
//! - [`geometry`], [`device`]: beams of a scanner, in double precision and with nothing
//!   in common with the mapping crates
//! - [`robot`]: path and posture
//! - [`scanner`]: the measurement with its errors, and the truth
//! - [`stream`]: the messages in the order of time
//! - [`transmit`]: the scanner's end of the link
//! - [`port`], [`faults`]: a cable between two pseudo-terminals, slow and bad if wished
//! - [`player`]: recorded bytes into any port
//! - [`qemu`]: an emulated module with two serial ports
//! - [`clock`], [`random`]: time and chance, both replaceable by the repeatable
//!
//! `docs/simulator.md` has the models, the defaults and how to use them together.
pub mod clock;
pub mod device;
pub mod faults;
pub mod geometry;
mod monitor;
pub mod player;
pub mod port;
pub mod qemu;
pub mod random;
pub mod robot;
pub mod scanner;
pub mod stream;
pub mod terrain;
pub mod transmit;

/// Compiles the examples of the documentation.
#[cfg(doctest)]
#[doc = include_str!("../../docs/simulator.md")]
struct Documentation;
