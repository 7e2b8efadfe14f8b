//! The link of rugosa: bytes ↔ frames ↔ messages.
//!
//! `no_std`, no heap, no unsafe code; knows nothing of the other crates. The format is
//! written down, apart from this code, in `docs/wire-format.md`.
//!
//! - [`message`]: what is said, in raw device units
//! - [`frame`]: [`encode`] and [`Decoder`]; feed bytes, pull frames
#![no_std]
#![forbid(unsafe_code)]

mod bytes;
pub mod frame;
pub mod message;

pub use frame::{
    Broken, BufferFull, Counts, Decoder, Frame, Header, MAX_FRAME, MAX_MESSAGE, Version, encode,
};
pub use message::*;

/// Version of the protocol; peers of another version are refused.
pub const PROTOCOL: u16 = 1;

/// What the message types look like on the wire, one line per type.
pub const SCHEMA: &str = include_str!("../schema.txt");

/// CRC-32 of [`SCHEMA`]: peers whose messages differ are refused even where somebody
/// forgot to raise [`PROTOCOL`].
pub const fn schema_hash() -> u32 {
    SCHEMA_HASH
}

const SCHEMA_HASH: u32 = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC).checksum(SCHEMA.as_bytes());
