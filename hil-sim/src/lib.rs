//! Simulated hardware.
pub mod device;
pub mod geometry;
pub mod random;
pub mod robot;
pub mod scanner;
pub mod terrain;
