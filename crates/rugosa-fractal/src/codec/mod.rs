//! Height-field codec for a thin link and for files: a grid of heights with a bound on the
//! error, whose prefix is a coarser grid.
//!
//! ```text
//! heights → integers (quantum) → wavelet (lifting) → contexts (model) → bytes (range)
//! ```
//!
//! - **Bounded**: heights are rounded to a quantum; if nothing else is rounded every height
//!   comes back within half a quantum ([`Precision::Within`]). A lossy map
//!   ([`Precision::Step`]) rounds the wavelet's coefficients; its largest error is measured
//!   by the encoder, which can because both sides compute the same bits, and stands in
//!   the header.
//! - **Progressive**: levels follow each other from the coarsest; [`decode`] of a prefix
//!   gives the finest complete level, local means on every 2^k-th node.
//! - **Unknown cells** (NaN) come back as NaN, wherever they are.
//! - **No heap**: the caller lends one i32 per node and the output; the state is below
//!   4 kB. A 65 × 65 map needs 17 kB. Any size up to 16 384 per side, 8 × 8 tiles too
//!   (the header is 29 bytes).
//!
//! Format, little-endian, version 1:
//!
//! | offset | size | field |
//! |---|---|---|
//! | 0 | 2 | "RZ" |
//! | 2 | 1 | version 1 in the upper half; flags: 1 unknown cells, 2 lossy, 4 nothing known |
//! | 3 | 2, 2 | rows, columns |
//! | 7 | 4 | offset \[m\], f32: the lowest height |
//! | 11 | 4 | quantum \[m\], f32 |
//! | 15 | 4 | largest error \[m\], f32 |
//! | 19 | 4 | length of all, with the checksum |
//! | 23 | 2 | CRC-16 (IBM-3740) of the bytes before: a prefix has a header to rely on |
//! | 25 | | unknown cells, coarsest samples, levels: one range-coded stream |
//! | end − 4 | 4 | CRC-32 (ISO-HDLC) of everything before |
//!
//! A height is offset + quantum · integer. The stream is specified by `model.rs`.
//!
//! Cost and figures: `docs/results-surfaces.md`; tests: `tests/codec.rs`.
//!
//! Rejected: a pyramid with quantisation inside the prediction loop (its error is bounded at
//! any rate, but coarse samples that are not local means cost 1.5 dB), embedded bit planes
//! (each coefficient would be visited once per plane), a scale of the coder's chances from
//! the map of H and σ (the neighbours tell it already, without side information).

mod fill;
mod lifting;
mod model;
mod range;
mod search;

pub use search::{encode_to_size, encode_within};

use crate::surfaces::Shape;
use core::fmt;
use fill::UNKNOWN;
use model::Walk;
use range::{Decoder, Encoder};
use rugosa_grid::math;

const MAGIC: [u8; 2] = *b"RZ";
const VERSION: u8 = 1;
/// Bytes before the stream.
pub const HEADER: usize = 25;
/// Bytes after it.
const TRAILER: usize = 4;
/// Longest side of a map.
pub const LONGEST_SIDE: usize = 16_384;
/// Largest integer a height may become.
const MOST_QUANTA: f32 = 16_777_216.0;

const CRC32: crc::Crc<u32> = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC);
const CRC16: crc::Crc<u16> = crc::Crc::<u16>::new(&crc::CRC_16_IBM_3740);

const HAS_UNKNOWN: u8 = 1;
const LOSSY: u8 = 2;
const NOTHING_KNOWN: u8 = 4;

/// How exactly heights are kept.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Precision {
    /// every height within this many metres (plus the rounding of f32)
    Within(f32),
    /// coefficients rounded to this step \[m\] (in units of their effect on the map); the
    /// error is measured, not prescribed
    Step(f32),
}

/// What was written.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Encoded {
    /// bytes, header and checksums included
    pub bytes: usize,
    /// largest error of a known height \[m\]
    pub max_error: f32,
    /// mean squared error of the known heights \[m²\]
    pub mean_square: f64,
}

/// What the header says.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Header {
    /// size of the map
    pub shape: Shape,
    /// lowest height \[m\]
    pub offset: f32,
    /// unit of the integers \[m\]
    pub quantum: f32,
    /// largest error of a known height, measured by the encoder \[m\]
    pub max_error: f32,
    /// bytes of the whole
    pub length: usize,
    flags: u8,
}

/// What was decoded.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Decoded {
    /// the header
    pub header: Header,
    /// 1 for the whole map; 2^k if only every 2^k-th node is there
    pub step: usize,
    /// size of what was written: every `step`-th node
    pub shape: Shape,
}

/// Why a map was not coded or decoded.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum CodecError {
    /// a side is 0 or above [`LONGEST_SIDE`]
    Size(Shape),
    /// lent memory is too short: needed, given
    Memory(usize, usize),
    /// precision not positive and finite
    Precision(f32),
    /// relief / quantum exceeds 2²⁴: ask for less precision
    TooFine(f32),
    /// infinite height at this index
    Infinite(usize),
    /// the bytes do not fit into the output
    Full,
    /// no encoding of at most so many bytes
    Unreachable(usize),
    /// the first bytes are not "RZ"
    Magic,
    /// a version this program does not know
    Version(u8),
    /// header damaged or impossible
    Header,
    /// too few bytes for even the coarsest level
    Truncated,
    /// the checksum is wrong: bytes were damaged
    Checksum,
}

impl fmt::Display for CodecError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            CodecError::Size(s) => {
                write!(
                    f,
                    "a map of {} × {} nodes cannot be coded",
                    s.rows, s.columns
                )
            }
            CodecError::Memory(n, given) => write!(f, "{n} elements are needed, {given} were lent"),
            CodecError::Precision(p) => write!(f, "precision {p} is not positive and finite"),
            CodecError::TooFine(p) => {
                write!(
                    f,
                    "precision {p} m is too fine for this relief (over 2^24 steps)"
                )
            }
            CodecError::Infinite(i) => write!(f, "height {i} is infinite"),
            CodecError::Full => write!(f, "the output is too small"),
            CodecError::Unreachable(n) => write!(f, "this map cannot be coded in {n} bytes"),
            CodecError::Magic => write!(f, "not a compressed height field (no \"RZ\")"),
            CodecError::Version(v) => write!(f, "compressed height field: unknown version {v}"),
            CodecError::Header => write!(f, "compressed height field: the header is damaged"),
            CodecError::Truncated => {
                write!(
                    f,
                    "compressed height field: too short for even the coarsest level"
                )
            }
            CodecError::Checksum => {
                write!(
                    f,
                    "compressed height field: wrong checksum, the data are damaged"
                )
            }
        }
    }
}

impl core::error::Error for CodecError {}

impl Header {
    /// Reads and checks a header; what follows it may be missing.
    ///
    /// # Errors
    /// Too short, another magic or version, damage.
    pub fn read(bytes: &[u8]) -> Result<Header, CodecError> {
        if bytes.len() >= 2 && bytes[..2] != MAGIC {
            return Err(CodecError::Magic);
        }
        let h: &[u8; HEADER] = bytes.first_chunk().ok_or(CodecError::Truncated)?;
        if h[2] >> 4 != VERSION {
            return Err(CodecError::Version(h[2] >> 4));
        }
        if CRC16.checksum(&h[..23]).to_le_bytes() != h[23..] {
            return Err(CodecError::Header);
        }
        let float = |at: usize| f32::from_le_bytes([h[at], h[at + 1], h[at + 2], h[at + 3]]);
        let short = |at: usize| usize::from(u16::from_le_bytes([h[at], h[at + 1]]));
        let header = Header {
            shape: Shape::new(short(3), short(5)),
            offset: float(7),
            quantum: float(11),
            max_error: float(15),
            length: u32::from_le_bytes([h[19], h[20], h[21], h[22]]) as usize,
            flags: h[2] & 15,
        };
        let sane = header.offset.is_finite() && header.quantum > 0.0 && header.quantum.is_finite();
        check_shape(header.shape)?;
        if !sane || header.length < HEADER + TRAILER {
            return Err(CodecError::Header);
        }
        Ok(header)
    }

    fn write(&self, out: &mut [u8]) {
        out[..2].copy_from_slice(&MAGIC);
        out[2] = VERSION << 4 | self.flags;
        out[3..5].copy_from_slice(&(self.shape.rows as u16).to_le_bytes());
        out[5..7].copy_from_slice(&(self.shape.columns as u16).to_le_bytes());
        out[7..11].copy_from_slice(&self.offset.to_le_bytes());
        out[11..15].copy_from_slice(&self.quantum.to_le_bytes());
        out[15..19].copy_from_slice(&self.max_error.to_le_bytes());
        out[19..23].copy_from_slice(&(self.length as u32).to_le_bytes());
        let sum = CRC16.checksum(&out[..23]);
        out[23..25].copy_from_slice(&sum.to_le_bytes());
    }

    fn has(&self, flag: u8) -> bool {
        self.flags & flag != 0
    }

    /// Was precision given as a step, so that only the measured error bounds it?
    pub fn is_lossy(&self) -> bool {
        self.has(LOSSY)
    }

    #[inline]
    fn height(&self, integer: i32) -> f32 {
        self.offset + self.quantum * integer as f32
    }
}

fn check_shape(shape: Shape) -> Result<(), CodecError> {
    let good = |side: usize| (1..=LONGEST_SIDE).contains(&side);
    if good(shape.rows) && good(shape.columns) {
        Ok(())
    } else {
        Err(CodecError::Size(shape))
    }
}

/// Encodes `heights` (row by row, NaN unknown) into `out`. `work` holds one i32 per node.
///
/// # Errors
/// Sizes, memory, precision, infinite heights; [`CodecError::Full`] if `out` is too short.
pub fn encode(
    heights: &[f32],
    shape: Shape,
    precision: Precision,
    (work, out): (&mut [i32], &mut [u8]),
) -> Result<Encoded, CodecError> {
    check_shape(shape)?;
    check_memory(shape.len(), heights.len().min(work.len()))?;
    check_memory(HEADER + TRAILER, out.len())?;
    let (heights, work) = (&heights[..shape.len()], &mut work[..shape.len()]);
    let mut header = prepare(heights, shape, precision)?;
    quantise(heights, &mut header, work);
    let body = out.len() - TRAILER;
    let length = if header.has(NOTHING_KNOWN) {
        0
    } else {
        fill::fill(work, shape);
        lifting::forward(work, shape, lifting::levels(shape));
        write_stream(heights, &header, work, &mut out[HEADER..body]).ok_or(CodecError::Full)?
    };
    header.length = HEADER + length + TRAILER;
    reconstruct(&header, work);
    let (max_error, mean_square) = errors(heights, &header, work);
    header.max_error = max_error;
    header.write(out);
    let end = header.length - TRAILER;
    let sum = CRC32.checksum(&out[..end]);
    out[end..header.length].copy_from_slice(&sum.to_le_bytes());
    Ok(Encoded {
        bytes: header.length,
        max_error,
        mean_square,
    })
}

/// Decodes into `out`, one f32 per node of the result; `work` holds one i32 per node of the
/// whole map. Of a prefix, the finest level that is complete.
///
/// # Errors
/// Damage, memory; see [`CodecError`]. A prefix is protected by the header's checksum only.
pub fn decode(bytes: &[u8], (work, out): (&mut [i32], &mut [f32])) -> Result<Decoded, CodecError> {
    let header = Header::read(bytes)?;
    check_memory(header.shape.len(), work.len())?;
    let whole = bytes.len() >= header.length;
    if whole {
        let (body, sum) = bytes[..header.length].split_at(header.length - TRAILER);
        if CRC32.checksum(body).to_le_bytes() != sum {
            return Err(CodecError::Checksum);
        }
    }
    let work = &mut work[..header.shape.len()];
    let end = if whole {
        header.length - TRAILER
    } else {
        bytes.len().min(header.length - TRAILER)
    };
    if header.has(NOTHING_KNOWN) {
        return write_unknown(header, out);
    }
    read_stream(&header, &bytes[HEADER..end], whole, (work, out))
}

fn check_memory(needed: usize, given: usize) -> Result<(), CodecError> {
    if given < needed {
        Err(CodecError::Memory(needed, given))
    } else {
        Ok(())
    }
}

/// Offset, quantum and flags.
fn prepare(heights: &[f32], shape: Shape, precision: Precision) -> Result<Header, CodecError> {
    if let Some(i) = heights.iter().position(|z| z.is_infinite()) {
        return Err(CodecError::Infinite(i));
    }
    let (wanted, quantum, lossy) = match precision {
        Precision::Within(error) => (error, 2.0 * error, 0),
        Precision::Step(step) => (step, step / model::LOSSY_STEP as f32, LOSSY),
    };
    if !(quantum > 0.0 && quantum.is_finite()) {
        return Err(CodecError::Precision(wanted));
    }
    let known = heights.iter().filter(|z| !z.is_nan());
    let (mut low, mut high, mut count) = (f32::MAX, f32::MIN, 0);
    known.for_each(|&z| {
        (low, high) = (low.min(z), high.max(z));
        count += 1;
    });
    let holes = if count < heights.len() {
        HAS_UNKNOWN
    } else {
        0
    };
    let nothing = if count == 0 { NOTHING_KNOWN } else { 0 };
    if count > 0 && (high - low) / quantum >= MOST_QUANTA {
        return Err(CodecError::TooFine(wanted));
    }
    Ok(Header {
        shape,
        offset: if count > 0 { low } else { 0.0 },
        quantum,
        max_error: 0.0,
        length: 0,
        flags: holes | nothing | lossy,
    })
}

/// Heights → integers. Exactly kept heights often are multiples of something coarser (whole
/// metres, say): the quantum becomes their greatest common divisor.
fn quantise(heights: &[f32], header: &mut Header, work: &mut [i32]) {
    let mut divisor = 0;
    for (to, &z) in work.iter_mut().zip(heights) {
        *to = UNKNOWN;
        if !z.is_nan() {
            *to = math::round_index((z - header.offset) / header.quantum);
            divisor = common_divisor(divisor, *to as u32);
        }
    }
    if divisor > 1 && !header.has(LOSSY) {
        header.quantum *= divisor as f32;
        work.iter_mut()
            .filter(|z| **z != UNKNOWN)
            .for_each(|z| *z /= divisor as i32);
    }
}

fn common_divisor(mut a: u32, mut b: u32) -> u32 {
    if a == 1 {
        return 1;
    }
    while b > 0 {
        (a, b) = (b, a % b);
    }
    a
}

/// Writes the stream; `work` then holds what the decoder will have. `None` if it is too long.
fn write_stream(
    heights: &[f32],
    header: &Header,
    work: &mut [i32],
    out: &mut [u8],
) -> Option<usize> {
    let levels = lifting::levels(header.shape);
    let mut walk = Walk::new(
        Encoder::new(out),
        work,
        header.shape,
        header.has(LOSSY),
        true,
    );
    if header.has(HAS_UNKNOWN) {
        walk.unknown(|i| heights[i].is_nan(), |_, _| {});
    }
    walk.coarsest();
    (1..=levels).rev().for_each(|level| walk.level(level));
    walk.dequantise(0);
    walk.coder.finish()
}

/// Coefficients → integers of heights.
fn reconstruct(header: &Header, work: &mut [i32]) {
    if !header.has(NOTHING_KNOWN) {
        lifting::inverse(work, header.shape, lifting::levels(header.shape), 0);
    }
}

/// (largest error, mean square) over known heights.
fn errors(heights: &[f32], header: &Header, work: &[i32]) -> (f32, f64) {
    let (mut largest, mut sum, mut count) = (0.0f32, 0.0f64, 0u32);
    for (&z, &integer) in heights.iter().zip(work).filter(|(z, _)| !z.is_nan()) {
        let error = math::abs(header.height(integer) - z);
        largest = largest.max(error);
        sum += f64::from(error) * f64::from(error);
        count += 1;
    }
    (largest, sum / f64::from(count.max(1)))
}

fn write_unknown(header: Header, out: &mut [f32]) -> Result<Decoded, CodecError> {
    check_memory(header.shape.len(), out.len())?;
    out[..header.shape.len()].fill(f32::NAN);
    Ok(Decoded {
        header,
        step: 1,
        shape: header.shape,
    })
}

fn read_stream(
    header: &Header,
    stream: &[u8],
    whole: bool,
    (work, out): (&mut [i32], &mut [f32]),
) -> Result<Decoded, CodecError> {
    let (shape, levels) = (header.shape, lifting::levels(header.shape));
    work.fill(0);
    check_memory(shape.len(), out.len())?;
    out[..shape.len()].fill(0.0);
    let mut walk = Walk::new(Decoder::new(stream), work, shape, header.has(LOSSY), false);
    if header.has(HAS_UNKNOWN) {
        walk.unknown(
            |_| false,
            |i, unknown| out[i] = if unknown { f32::NAN } else { 0.0 },
        );
    }
    walk.coarsest();
    if !whole && walk.coder.is_exhausted() {
        return Err(CodecError::Truncated);
    }
    let mut done = levels;
    for level in (1..=levels).rev() {
        walk.level(level);
        if !whole && walk.coder.is_exhausted() {
            break;
        }
        done = level - 1;
    }
    walk.dequantise(done);
    lifting::inverse(work, shape, levels, done);
    Ok(gather(header, 1 << done, work, out))
}

/// Every `step`-th node, moved to the front; NaN where unknown.
fn gather(header: &Header, step: usize, work: &[i32], out: &mut [f32]) -> Decoded {
    let columns = header.shape.columns;
    let shape = Shape::new(
        lifting::on(header.shape.rows, step),
        lifting::on(columns, step),
    );
    if step == 1 {
        let cells = out.iter_mut().zip(work).filter(|(z, _)| !z.is_nan());
        cells.for_each(|(z, &integer)| *z = header.height(integer));
        return Decoded {
            header: *header,
            step,
            shape,
        };
    }
    for i in 0..shape.len() {
        let from = i / shape.columns * step * columns + i % shape.columns * step;
        let unknown = out[from].is_nan();
        out[i] = if unknown {
            f32::NAN
        } else {
            header.height(work[from])
        };
    }
    Decoded {
        header: *header,
        step,
        shape,
    }
}
