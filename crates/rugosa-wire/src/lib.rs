//! The link of rugosa: bytes ↔ frames ↔ messages.
//!
//! `no_std`, no heap, no unsafe code; knows nothing of the other crates. The format is
//! written down, apart from this code, in `docs/wire-format.md`.
//!
//! - [`message`]: what is said, in raw device units
//! - [`frame`]: [`encode`] and [`Decoder`]; feed bytes, pull frames
//! - [`link`]: one end of a link: handshake, sessions, losses, credit, heartbeat
//! - [`packing`]: ranges of 12 or 16 bits
//! - [`counter`]: names of the counters in a [`Status`]
//! - [`self_test`]: echo, source and sink
#![no_std]
#![forbid(unsafe_code)]

mod bytes;
pub mod counter;
pub mod credit;
pub mod frame;
pub mod handshake;
pub mod link;
pub mod message;
pub mod packing;
pub mod self_test;
pub mod sequence;

pub use frame::{
    Broken, BufferFull, Counts, Decoder, Frame, Header, MAX_FRAME, MAX_MESSAGE, Version, encode,
};
pub use handshake::{Peer, Refusal};
pub use link::{Event, Link, Tally, Unsent};
pub use message::*;
pub use packing::{Reading, Unpacked};
pub use self_test::SelfTest;

/// Version of the protocol; peers of another version are refused.
pub const PROTOCOL: u16 = 1;

/// What the message types look like on the wire, one line per type.
pub const SCHEMA: &str = include_str!("../schema.txt");

/// CRC-32 of [`SCHEMA`]: peers whose messages differ are refused even where somebody
/// forgot to raise [`PROTOCOL`].
///
/// ```
/// use rugosa_wire::{Hello, Role, SCHEMA, schema_hash};
/// let crc = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC);
/// assert_eq!(schema_hash(), crc.checksum(SCHEMA.as_bytes()));
/// // every greeting carries it
/// assert_eq!(Hello::new(Role::Host, "desk", "0.1.0").schema, schema_hash());
/// ```
pub const fn schema_hash() -> u32 {
    SCHEMA_HASH
}

const SCHEMA_HASH: u32 = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC).checksum(SCHEMA.as_bytes());
