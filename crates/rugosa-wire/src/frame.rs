//! Frames: one message each, kept apart by zero bytes, checked as a whole.
//!
//! ```text
//! frame = COBS( postcard(Header) ‖ postcard(Message) ‖ CRC-32, little-endian ) ‖ 00
//! ```
//!
//! COBS (Cheshire & Baker 1999, "Consistent Overhead Byte Stuffing", IEEE/ACM Trans.
//! Networking 7(2)) leaves no zero byte inside a frame, so whatever was damaged, the
//! next zero byte is the end of a frame and the decoder is in step again behind it.
//! CRC-32 is that of ISO-HDLC (polynomial 04C11DB7, reflected), over header and message;
//! at the 1 kB of the longest frame it finds every error of up to three bits and every
//! burst of up to 32; anything else slips through once in 2³².
//!
//! Memory: [`MAX_FRAME`] bytes for the decoder, none for the encoder. Cost: see
//! `docs/wire-format.md`. Nothing here panics, whatever the bytes.

use core::fmt;

use crc::{CRC_32_ISO_HDLC, Crc};
use postcard::ser_flavors::{Cobs, Slice, crc::CrcModifier};
use serde::{Deserialize, Serialize};

use crate::message::{MAX_RANGE_BYTES, Message};
use crate::{PROTOCOL, schema_hash};

/// The check of a frame; 256 entries of four bytes in flash.
static CRC: Crc<u32> = Crc::<u32>::new(&CRC_32_ISO_HDLC);
const CRC_BYTES: usize = 4;

/// Most bytes of postcard's variable-length integers of 16, 32 and 64 bits.
const VARINT: [usize; 3] = [3, 5, 10];
/// Most bytes of an encoded [`Header`].
const MAX_HEADER: usize = VARINT[1] + VARINT[0];
/// Most bytes of an encoded [`Message`]; a scan line with reflectances is the longest.
pub const MAX_MESSAGE: usize =
    1 + VARINT[1] + 3 * VARINT[0] + VARINT[2] + 1 + 2 * (2 + MAX_RANGE_BYTES);
/// Most bytes of a frame with its delimiter; longer ones are discarded.
pub const MAX_FRAME: usize = {
    let body = MAX_HEADER + MAX_MESSAGE + CRC_BYTES;
    body + body / 254 + 1 + 1
};

/// What precedes every message.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Header {
    /// number of the sender's session; never 0
    pub session: u32,
    /// running number of the frame in that session, from 0, wraps
    pub sequence: u16,
}

/// A frame that passed all checks.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// who sent it and which of its frames it is
    pub header: Header,
    /// what it says
    pub message: Message,
}

/// A protocol as a [`crate::Hello`] names it.
///
/// ```
/// use rugosa_wire::{Hello, PROTOCOL, Role, Version};
/// let hello = Hello::new(Role::Scanner, "simulated", "0.1.0");
/// let named = Version { protocol: hello.protocol, schema: hello.schema };
/// assert_eq!(named, Version::OURS);
/// let other = Version { protocol: PROTOCOL + 1, schema: 0xbeef };
/// assert_eq!(other.to_string(), "protocol 2 (schema 0000beef)");
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Version {
    /// [`PROTOCOL`]
    pub protocol: u16,
    /// [`schema_hash`]
    pub schema: u32,
}

impl Version {
    /// The protocol of this crate.
    pub const OURS: Version = Version {
        protocol: PROTOCOL,
        schema: schema_hash(),
    };
}

impl fmt::Display for Version {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "protocol {} (schema {:08x})", self.protocol, self.schema)
    }
}

/// Why a frame was thrown away.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Broken {
    /// not COBS, or too short to be a frame
    Cobs,
    /// the check fails: bytes were changed, lost or added
    Crc,
    /// the check holds, but it is no message of this protocol
    Message,
    /// no delimiter within [`MAX_FRAME`] bytes
    OverLong,
    /// the greeting of a peer with another protocol
    Version(Version),
}

impl fmt::Display for Broken {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Broken::Cobs => f.write_str("broken frame: bad byte stuffing"),
            Broken::Crc => f.write_str("broken frame: CRC-32 differs"),
            Broken::Message => f.write_str("intact frame without a known message"),
            Broken::OverLong => write!(f, "frame longer than {MAX_FRAME} bytes"),
            Broken::Version(theirs) => write!(f, "greeting of a peer with {theirs}"),
        }
    }
}

impl core::error::Error for Broken {}

/// The buffer is too short for the frame; [`MAX_FRAME`] bytes always suffice.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BufferFull;

impl fmt::Display for BufferFull {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("buffer too short for the frame")
    }
}

impl core::error::Error for BufferFull {}

/// Writes one frame, delimiter included, to the front of `buffer`; returns its length.
///
/// ```
/// use rugosa_wire::{BufferFull, Header, MAX_FRAME, Message, encode};
/// let header = Header { session: 7, sequence: 300 };
/// let mut buffer = [0xff; MAX_FRAME];
/// let length = encode(&header, &Message::Reset, &mut buffer).unwrap();
/// // 1 byte of session, 2 of sequence, 1 of message, 4 of check; stuffing and delimiter
/// assert_eq!(length, 8 + 2);
/// // the only zero is the last byte
/// assert_eq!(buffer.iter().position(|&byte| byte == 0), Some(length - 1));
/// assert_eq!(encode(&header, &Message::Reset, &mut [0; 5]), Err(BufferFull));
/// ```
pub fn encode(header: &Header, message: &Message, buffer: &mut [u8]) -> Result<usize, BufferFull> {
    let stuffed = Cobs::try_new(Slice::new(buffer)).map_err(|_| BufferFull)?;
    let checked = CrcModifier::new(stuffed, CRC.digest());
    postcard::serialize_with_flavor(&(header, message), checked)
        .map(|frame: &mut [u8]| frame.len())
        .map_err(|_| BufferFull)
}

/// What a decoder has seen, by cause. Counters wrap.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// bytes taken, delimiters included
    pub bytes: u32,
    /// frames that passed all checks
    pub frames: u32,
    /// [`Broken::Cobs`]
    pub bad_cobs: u32,
    /// [`Broken::Crc`]
    pub bad_crc: u32,
    /// [`Broken::Message`]
    pub bad_message: u32,
    /// [`Broken::OverLong`]
    pub over_long: u32,
    /// [`Broken::Version`]
    pub unknown_version: u32,
}

impl Counts {
    fn note(&mut self, result: &Result<Frame, Broken>) {
        let counter = match result {
            Ok(_) => &mut self.frames,
            Err(Broken::Cobs) => &mut self.bad_cobs,
            Err(Broken::Crc) => &mut self.bad_crc,
            Err(Broken::Message) => &mut self.bad_message,
            Err(Broken::OverLong) => &mut self.over_long,
            Err(Broken::Version(_)) => &mut self.unknown_version,
        };
        *counter = counter.wrapping_add(1);
    }

    /// Frames that were thrown away.
    ///
    /// ```
    /// use rugosa_wire::{Broken, Decoder, Header, MAX_FRAME, Message, encode};
    /// let mut buffer = [0; MAX_FRAME];
    /// let header = Header { session: 7, sequence: 300 };
    /// let length = encode(&header, &Message::Refresh, &mut buffer).unwrap();
    /// let mut decoder = Decoder::new();
    /// assert!(decoder.pull(&mut &buffer[..length]).unwrap().is_ok());
    /// buffer[1] ^= 0x40; // a bit was changed on the way
    /// assert_eq!(decoder.pull(&mut &buffer[..length]), Some(Err(Broken::Crc)));
    /// let counts = decoder.counts();
    /// assert_eq!((counts.frames, counts.bad_crc, counts.broken()), (1, 1, 1));
    /// ```
    pub fn broken(&self) -> u32 {
        [
            self.bad_crc,
            self.bad_message,
            self.over_long,
            self.unknown_version,
        ]
        .iter()
        .fold(self.bad_cobs, |sum, &n| sum.wrapping_add(n))
    }
}

/// Bytes in, frames out.
///
/// ```
/// use rugosa_wire::{Decoder, Header, MAX_FRAME, Message, encode};
/// let (mut buffer, header) = ([0; MAX_FRAME], Header { session: 7, sequence: 0 });
/// let length = encode(&header, &Message::Refresh, &mut buffer).unwrap();
///
/// let mut decoder = Decoder::new();
/// let mut bytes = &buffer[..length];
/// let frame = decoder.pull(&mut bytes).unwrap().unwrap();
/// assert_eq!((frame.header, frame.message), (header, Message::Refresh));
/// assert_eq!(decoder.pull(&mut bytes), None); // more bytes, please
/// ```
#[derive(Clone, Debug)]
pub struct Decoder {
    buffer: [u8; MAX_FRAME],
    length: usize,
    discarding: bool,
    counts: Counts,
}

impl Default for Decoder {
    fn default() -> Self {
        Decoder::new()
    }
}

impl Decoder {
    /// A decoder in step: the first byte it gets starts a frame.
    pub const fn new() -> Self {
        Decoder {
            buffer: [0; MAX_FRAME],
            length: 0,
            discarding: false,
            counts: Counts {
                bytes: 0,
                frames: 0,
                bad_cobs: 0,
                bad_crc: 0,
                bad_message: 0,
                over_long: 0,
                unknown_version: 0,
            },
        }
    }

    /// Takes bytes off the front of `bytes` up to the end of the next frame.
    ///
    /// `None`: all bytes are taken and more are needed. `Some(Err(..))`: a broken frame
    /// was thrown away; call again. Empty frames (two delimiters in a row) are skipped.
    pub fn pull(&mut self, bytes: &mut &[u8]) -> Option<Result<Frame, Broken>> {
        while let Some(end) = memchr::memchr(0, bytes) {
            let (body, rest) = bytes.split_at(end);
            self.keep(body);
            self.counts.bytes = self.counts.bytes.wrapping_add(end as u32 + 1);
            *bytes = &rest[1..];
            if let Some(result) = self.close() {
                self.counts.note(&result);
                return Some(result);
            }
        }
        self.keep(bytes);
        self.counts.bytes = self.counts.bytes.wrapping_add(bytes.len() as u32);
        *bytes = &[];
        None
    }

    /// What was seen so far.
    pub fn counts(&self) -> &Counts {
        &self.counts
    }

    /// Throws away a frame in progress, as when a port was closed and opened again; the
    /// counters stay.
    ///
    /// ```
    /// use rugosa_wire::{Decoder, Header, MAX_FRAME, Message, encode};
    /// let mut buffer = [0; MAX_FRAME];
    /// let length = encode(&Header::default(), &Message::Reset, &mut buffer).unwrap();
    /// let mut decoder = Decoder::new();
    /// assert_eq!(decoder.pull(&mut &buffer[..3]), None); // the port is closed here
    /// decoder.restart();
    /// let frame = decoder.pull(&mut &buffer[..length]).unwrap().unwrap();
    /// assert_eq!(frame.message, Message::Reset);
    /// assert_eq!(decoder.counts().bytes, 3 + length as u32);
    /// ```
    pub fn restart(&mut self) {
        (self.length, self.discarding) = (0, false);
    }

    /// Appends to the frame in progress, unless that has become too long.
    fn keep(&mut self, bytes: &[u8]) {
        let end = self.length + bytes.len();
        self.discarding |= end >= MAX_FRAME;
        if !self.discarding {
            self.buffer[self.length..end].copy_from_slice(bytes);
            self.length = end;
        }
    }

    /// A delimiter: what is in the buffer is a frame, or nothing.
    #[inline]
    fn close(&mut self) -> Option<Result<Frame, Broken>> {
        let (length, over_long) = (self.length, self.discarding);
        self.restart();
        if over_long {
            return Some(Err(Broken::OverLong));
        }
        (length > 0).then(|| open(&mut self.buffer[..length]))
    }
}

/// Undoes the stuffing in place, checks, parses.
#[inline]
fn open(stuffed: &mut [u8]) -> Result<Frame, Broken> {
    let (header, body) = checked(stuffed)?;
    let mut parser = postcard::Deserializer::from_bytes(body);
    let message = Message::deserialize(&mut parser).map_err(|_| Broken::Message)?;
    match parser.finalize() {
        Ok([]) => Ok(Frame { header, message }),
        _ => Err(Broken::Message),
    }
}

/// Header and message of a frame that is intact and of our version.
fn checked(stuffed: &mut [u8]) -> Result<(Header, &[u8]), Broken> {
    let length = cobs::decode_in_place(stuffed).map_err(|_| Broken::Cobs)?;
    let (body, check) = stuffed[..length]
        .split_last_chunk::<CRC_BYTES>()
        .ok_or(Broken::Cobs)?;
    if CRC.checksum(body) != u32::from_le_bytes(*check) {
        return Err(Broken::Crc);
    }
    let (header, message) = take(body)?;
    refuse_other_versions(message)?;
    Ok((header, message))
}

fn take<'a, T: Deserialize<'a>>(bytes: &'a [u8]) -> Result<(T, &'a [u8]), Broken> {
    postcard::take_from_bytes(bytes).map_err(|_| Broken::Message)
}

/// The start of a greeting is the same in all versions, the rest need not be.
fn refuse_other_versions(message: &[u8]) -> Result<(), Broken> {
    let [0, hello @ ..] = message else {
        return Ok(());
    };
    match take(hello)?.0 {
        Version::OURS => Ok(()),
        theirs => Err(Broken::Version(theirs)),
    }
}
