//! Height-field codec for a thin link and for files: a grid of heights with a bound on the
//! error, whose prefix is a coarser grid.
//!
//! ```text
//! heights → integers (quantum) → wavelet (lifting) → contexts (model) → bytes (range)
//!                                              └──→ bits of blocks (packed) → bytes
//! ```
//!
//! - **Bounded**: heights are rounded to a quantum; if nothing else is rounded every height
//!   comes back within half a quantum ([`Precision::Within`]). A lossy map
//!   ([`Precision::Step`]) rounds the wavelet's coefficients; its largest error is measured
//!   by the encoder, which can because both sides compute the same bits, and stands in
//!   the header.
//! - **Quick or small**: [`Precision::Quick`] packs the numbers instead of coding them; several
//!   times faster, a fifth longer on natural ground. Its coarser maps are heights of the map,
//!   not local means.
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
//! | 2 | 1 | version 1 in the upper half; flags: 1 unknown cells, 2 lossy, 4 nothing known, 8 quick |
//! | 3 | 2, 2 | rows, columns |
//! | 7 | 4 | offset \[m\], f32: the lowest height |
//! | 11 | 4 | quantum \[m\], f32 |
//! | 15 | 4 | largest error \[m\], f32 |
//! | 19 | 4 | length of all, with the checksum |
//! | 23 | 2 | CRC-16 (IBM-3740) of the bytes before: a prefix has a header to rely on |
//! | 25 | | unknown cells, coarsest samples, levels: one range-coded stream, or packed blocks |
//! | end − 4 | 4 | CRC-32 (ISO-HDLC) of everything before |
//!
//! A height is offset + quantum · integer. The stream is specified by `model.rs` (order and
//! contexts), `chances.rs` (decisions) and `range.rs` (bits), or by `packed.rs`.
//!
//! ```
//! use rugosa_fractal::codec::{decode, encode_within};
//! use rugosa_fractal::surfaces::Shape;
//!
//! let shape = Shape::new(9, 9);
//! let heights: [f32; 81] = core::array::from_fn(|i| (i % 9 * (i / 9)) as f32 * 0.1);
//! let (mut work, mut bytes, mut back) = ([0; 81], [0; 600], [0.0; 81]);
//! let told = encode_within(&heights, shape, 0.05, (&mut work, &mut bytes))?;
//! decode(&bytes[..told.bytes], (&mut work, &mut back))?;
//! assert!(told.bytes < 81 && heights.iter().zip(back).all(|(a, b)| (a - b).abs() <= 0.05));
//! # Ok::<(), rugosa_fractal::codec::CodecError>(())
//! ```
//!
//! Cost and figures: `docs/results-surfaces.md`; tests: `tests/codec.rs`.
//!
//! Rejected: a pyramid with quantisation inside the prediction loop (its error is bounded at
//! any rate, but coarse samples that are not local means cost 1.5 dB), embedded bit planes
//! (each coefficient would be visited once per plane), a scale of the coder's chances from
//! the map of H and σ (the neighbours tell it already, without side information).

mod band;
mod chances;
mod decode;
mod encode;
mod error;
mod fill;
mod header;
mod lifting;
mod model;
mod packed;
mod range;
mod search;

pub use decode::{Decoded, decode};
pub use encode::{Encoded, Precision, encode};
pub use error::CodecError;
pub use header::{HEADER, Header};
pub use search::{encode_quickly, encode_to_size, encode_within};

/// Longest side of a map.
pub const LONGEST_SIDE: usize = 16_384;

/// Bytes looked up at once: 16 take 16 kB of tables, for machines that have them.
const AT_ONCE: usize = if cfg!(feature = "alloc") { 16 } else { 1 };

static CRC32: crc::Crc<u32, crc::Table<AT_ONCE>> = crc::Crc::<u32, _>::new(&crc::CRC_32_ISO_HDLC);

fn check_memory(needed: usize, given: usize) -> Result<(), CodecError> {
    if given < needed {
        Err(CodecError::Memory(needed, given))
    } else {
        Ok(())
    }
}
