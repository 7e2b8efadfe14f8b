//! The link of rugosa: bytes, frames, messages
#![no_std]
#![forbid(unsafe_code)]

pub mod message;
pub use message::*;

/// Version of the protocol; peers of another version are refused.
pub const PROTOCOL: u16 = 1;
