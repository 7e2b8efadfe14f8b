//! Bytes → heights.
//!
//! Never reads past its input: bytes that are not there count as zeros, and what would depend
//! on them is not returned. Writes into lent memory only.

use super::band::Occupied;
use super::header::{HAS_UNKNOWN, HEADER, Header, LOSSY, NOTHING_KNOWN, QUICK, TRAILER};
use super::model::Walk;
use super::packed::Reader;
use super::range::Decoder;
use super::{CRC32, CodecError, check_memory, lifting};
use crate::surfaces::Shape;

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

/// Decodes into `out`, one f32 per node of the whole map; `work` holds one i32 per node. Of a
/// prefix, the finest level that is complete.
///
/// ```
/// use rugosa_fractal::codec::{CodecError, Precision, decode, encode};
/// use rugosa_fractal::surfaces::Shape;
/// let shape = Shape::new(33, 33);
/// let heights: Vec<f32> = (0..33 * 33).map(|i| ((i * i) % 97) as f32 * 0.1).collect();
/// let (mut work, mut bytes, mut back) = (vec![0; 33 * 33], vec![0; 4000], vec![0.0; 33 * 33]);
/// let told = encode(&heights, shape, Precision::Quick(0.05), (&mut work, &mut bytes)).unwrap();
/// assert_eq!(decode(&bytes[..told.bytes], (&mut work, &mut back)).unwrap().step, 1);
/// // of half the bytes a coarser map: every second or fourth node
/// let half = decode(&bytes[..told.bytes / 2], (&mut work, &mut back)).unwrap();
/// assert!(half.step >= 2 && Some(half.shape) == shape.coarser(half.step));
/// let (row, column, columns) = (3, 1, half.shape.columns);
/// let height = heights[row * half.step * 33 + column * half.step];
/// assert!((back[row * columns + column] - height).abs() <= 0.05); // metres
/// bytes[told.bytes / 2] ^= 1;
/// let damaged = decode(&bytes[..told.bytes], (&mut work, &mut back));
/// assert_eq!(damaged, Err(CodecError::Checksum));
/// ```
///
/// # Errors
/// Damage, memory; see [`CodecError`]. A prefix is protected by the header's checksum only.
pub fn decode(bytes: &[u8], (work, out): (&mut [i32], &mut [f32])) -> Result<Decoded, CodecError> {
    let header = Header::read(bytes)?;
    let nodes = header.shape.len();
    check_memory(nodes, work.len().min(out.len()))?;
    let (work, out) = (&mut work[..nodes], &mut out[..nodes]);
    let whole = bytes.len() >= header.length;
    if whole {
        let (body, sum) = bytes[..header.length].split_at(header.length - TRAILER);
        if CRC32.checksum(body).to_le_bytes() != sum {
            return Err(CodecError::Checksum);
        }
    }
    if header.has(NOTHING_KNOWN) {
        out.fill(f32::NAN);
        return Ok(Decoded {
            header,
            step: 1,
            shape: header.shape,
        });
    }
    let end = bytes.len().min(header.length - TRAILER);
    let stream = &bytes[HEADER..end];
    let step = match header.has(QUICK) {
        true => unpack_stream(&header, stream, (work, out))?,
        false => read_stream(&header, (stream, whole), (work, out))?,
    };
    Ok(gather(header, step, work, out))
}

/// Integers of heights on every 2^k-th node in `work`; NaN in `out` where unknown. Returns 2^k.
fn read_stream(
    header: &Header,
    (stream, whole): (&[u8], bool),
    (work, out): (&mut [i32], &mut [f32]),
) -> Result<usize, CodecError> {
    let (shape, levels) = (header.shape, lifting::levels(header.shape));
    work.fill(0);
    let mut walk = Walk::new(Decoder::new(stream), work, shape, header.has(LOSSY));
    if header.has(HAS_UNKNOWN) {
        let mark = |i: usize, unknown: bool| out[i] = if unknown { f32::NAN } else { 0.0 };
        walk.unknown(|_| false, mark);
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
    let occupied = walk.occupied;
    lifting::inverse(work, shape, (levels, done), occupied);
    Ok(1 << done)
}

/// The same of packed blocks.
fn unpack_stream(
    header: &Header,
    stream: &[u8],
    (work, out): (&mut [i32], &mut [f32]),
) -> Result<usize, CodecError> {
    let (shape, levels) = (header.shape, lifting::levels(header.shape));
    let mut reader = Reader::new(stream);
    if header.has(HAS_UNKNOWN) {
        let mark = |i: usize, unknown: bool| out[i] = if unknown { f32::NAN } else { 0.0 };
        let told = reader.unknown(shape.len(), mark);
        told.ok_or(CodecError::Truncated)?;
    }
    let first = reader.coarsest(work, shape, levels);
    first.ok_or(CodecError::Truncated)?;
    let complete = (1..=levels).rev();
    let complete = complete.take_while(|&level| reader.level(work, shape, level).is_some());
    let done = complete.last().map_or(levels, |level| level - 1);
    lifting::inverse(work, shape, (levels, done), Occupied::default());
    Ok(1 << done)
}

/// Every `step`-th node, moved to the front; NaN where unknown.
fn gather(header: Header, step: usize, work: &[i32], out: &mut [f32]) -> Decoded {
    let columns = header.shape.columns;
    let shape = Shape::new(
        lifting::on(header.shape.rows, step),
        lifting::on(columns, step),
    );
    let holes = header.has(HAS_UNKNOWN);
    let height = |integer: i32, z: f32| match holes && z.is_nan() {
        true => f32::NAN,
        false => header.height(integer),
    };
    if step == 1 {
        let cells = out.iter_mut().zip(work);
        cells.for_each(|(z, &integer)| *z = height(integer, *z));
    } else {
        for i in 0..shape.len() {
            let from = i / shape.columns * step * columns + i % shape.columns * step;
            out[i] = height(work[from], out[from]);
        }
    }
    Decoded {
        header,
        step,
        shape,
    }
}
