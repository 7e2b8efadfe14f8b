//! Recordings of the link: MCAP files (the container of robotics logs) of wire frames.
//!
//! | in the file | content |
//! |---|---|
//! | schema | name `rugosa.wire.v1`, encoding `rugosa`; data: [`rugosa_wire::SCHEMA`] |
//! | channel | one per sender and kind of message: topic `/scanner/line`, `/module/patch`, …; message encoding `cobs-postcard` |
//! | message | one frame as on the wire, delimiter included, so a channel's bytes can be sent as they are |
//! | log time | nanoseconds since the recording began |
//! | publish time | the measurement's own stamp where it has one, else the log time |
//!
//! The file is written in chunks, each compressed and with a CRC-32 of its own, at least
//! every second; after a kill it is readable up to the last chunk ([`Ending::Truncated`]).
//! Only what passed the link's checks is recorded. A recording is never overwritten.
//!
//! ```
//! use rugosa_host::recording::{Ending, Recorder, Recording};
//! use rugosa_wire::{Frame, Header, Message, Role};
//! # fn main() -> rugosa_host::error::Result<()> {
//! # let folder = tempfile::tempdir().unwrap();
//! let path = folder.path().join("sweeps.mcap");
//! let frame = Frame { header: Header { session: 1, sequence: 0 }, message: Message::Refresh };
//! let mut recorder = Recorder::create(&path)?;
//! recorder.record(Role::Host, 1000, &frame)?;
//! recorder.finish()?;
//!
//! let mut recording = Recording::open(&path)?;
//! let entry = recording.next().unwrap()?;
//! assert_eq!((entry.from, entry.time_us, &entry.frame), (Role::Host, 1000, &frame));
//! assert!(recording.next().is_none());
//! assert_eq!(recording.ending(), Some(Ending::Complete));
//! # Ok(()) }
//! ```

mod reader;
mod summary;
mod writer;

pub use reader::{Ending, Entry, Recording};
pub use summary::{Scanner, Summary};
pub use writer::Recorder;

/// Name of the MCAP schema.
pub const SCHEMA_NAME: &str = "rugosa.wire.v1";
/// Encoding of the MCAP schema: the text of [`rugosa_wire::SCHEMA`].
pub const SCHEMA_ENCODING: &str = "rugosa";
/// Encoding of the messages: frames of docs/wire-format.md.
pub const MESSAGE_ENCODING: &str = "cobs-postcard";
/// Bytes of a chunk before compression.
const CHUNK_BYTES: u64 = 256 * 1024;
/// Longest record or chunk that a reader takes; a file that claims more is damaged.
const MAX_RECORD_BYTES: usize = 16 * 1024 * 1024;
