//! Why a map was not coded or decoded.

use crate::surfaces::Shape;
use core::fmt;

/// Why a map was not coded or decoded.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum CodecError {
    /// a side is 0 or above [`LONGEST_SIDE`](super::LONGEST_SIDE)
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
