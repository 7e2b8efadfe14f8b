//! Heights → bytes.
//!
//! Both sides compute the same bits, so the encoder decodes its own stream and writes the
//! largest error into the header.

use super::band::Occupied;
use super::fill::{self, UNKNOWN};
use super::header::{
    HAS_UNKNOWN, HEADER, Header, LOSSY, NOTHING_KNOWN, QUICK, TRAILER, check_shape,
};
use super::model::{self, Walk};
use super::packed::Writer;
use super::range::Encoder;
use super::{CRC32, CodecError, check_memory, lifting};
use crate::surfaces::Shape;
use rugosa_grid::math;

/// Largest integer a height may become.
const MOST_QUANTA: f32 = 16_777_216.0;

/// How exactly heights are kept.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Precision {
    /// every height within this many metres (plus the rounding of f32)
    Within(f32),
    /// coefficients rounded to this step \[m\] (in units of their effect on the map); the
    /// error is measured, not prescribed
    Step(f32),
    /// as `Within`, packed quickly instead of coded well
    Quick(f32),
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

/// Encodes `heights` (row by row, NaN unknown) into `out`. `work` holds one i32 per node.
///
/// ```
/// use rugosa_fractal::codec::{CodecError, Precision, decode, encode};
/// use rugosa_fractal::surfaces::Shape;
/// let shape = Shape::new(17, 33);
/// let mut heights: Vec<f32> = (0..shape.len()).map(|i| (0.1 * i as f32).sin()).collect();
/// heights[40] = f32::NAN; // unknown
/// let (mut work, mut bytes) = (vec![0; shape.len()], vec![0; 2000]);
/// let told = encode(&heights, shape, Precision::Within(0.01), (&mut work, &mut bytes)).unwrap();
/// assert!(told.max_error <= 0.01 && told.bytes < shape.len()); // less than a byte a node
/// let mut back = vec![0.0; shape.len()];
/// decode(&bytes[..told.bytes], (&mut work, &mut back)).unwrap();
/// assert!(back[40].is_nan() && (back[41] - heights[41]).abs() <= 0.01);
/// let short = encode(&heights, shape, Precision::Within(0.01), (&mut work, &mut bytes[..99]));
/// assert_eq!(short, Err(CodecError::Full));
/// ```
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
    // packing takes nothing from the integers, so their errors are known before it
    let before = header.has(QUICK).then(|| errors(heights, &header, work));
    let length = match (header.has(NOTHING_KNOWN), header.has(QUICK)) {
        (true, _) => 0,
        (false, true) => pack_stream(heights, &header, work, out)?,
        (false, false) => write_stream(heights, &header, work, out)?,
    };
    header.length = HEADER + length + TRAILER;
    let (max_error, mean_square) = before.unwrap_or_else(|| errors(heights, &header, work));
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

/// Offset, quantum and flags.
fn prepare(heights: &[f32], shape: Shape, precision: Precision) -> Result<Header, CodecError> {
    let (wanted, quantum, profile) = match precision {
        Precision::Within(error) => (error, 2.0 * error, 0),
        Precision::Step(step) => (step, step / model::LOSSY_STEP as f32, LOSSY),
        Precision::Quick(error) => (error, 2.0 * error, QUICK),
    };
    if !(quantum > 0.0 && quantum.is_finite()) {
        return Err(CodecError::Precision(wanted));
    }
    let (low, high, count) = range(heights);
    if count > 0 && !(low.is_finite() && high.is_finite()) {
        let index = heights.iter().position(|z| z.is_infinite());
        return Err(CodecError::Infinite(index.unwrap_or(0)));
    }
    if count > 0 && (high - low) / quantum >= MOST_QUANTA {
        return Err(CodecError::TooFine(wanted));
    }
    let flag = |is: bool, flag: u8| if is { flag } else { 0 };
    Ok(Header {
        shape,
        offset: if count > 0 { low } else { 0.0 },
        quantum,
        max_error: 0.0,
        length: 0,
        flags: flag(count < heights.len(), HAS_UNKNOWN) | flag(count == 0, NOTHING_KNOWN) | profile,
    })
}

/// Running results side by side, so that one need not wait for another.
const LANES: usize = 8;

/// (lowest, highest, number) of known heights.
fn range(heights: &[f32]) -> (f32, f32, usize) {
    let (mut low, mut high) = ([f32::INFINITY; LANES], [f32::NEG_INFINITY; LANES]);
    let mut unknown = [0u32; LANES];
    let mut see = |lane: usize, z: f32| {
        // comparisons with NaN are false
        low[lane] = least(z, low[lane]);
        high[lane] = -least(-z, -high[lane]);
        unknown[lane] += u32::from(z.is_nan());
    };
    let (chunks, rest) = heights.as_chunks::<LANES>();
    for chunk in chunks {
        (0..LANES).for_each(|lane| see(lane, chunk[lane]));
    }
    rest.iter().for_each(|&z| see(0, z));
    let unknown: u32 = unknown.into_iter().sum();
    (
        low.into_iter().fold(f32::INFINITY, least),
        -high.into_iter().fold(f32::INFINITY, |a, b| least(a, -b)),
        heights.len() - unknown as usize,
    )
}

/// The smaller one; b if a is NaN.
#[inline]
fn least(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

/// Heights → integers. Exactly kept heights often are multiples of something coarser (whole
/// metres, say): the quantum becomes their greatest common divisor.
fn quantise(heights: &[f32], header: &mut Header, work: &mut [i32]) {
    for (to, &z) in work.iter_mut().zip(heights) {
        let integer = math::round_index((z - header.offset) / header.quantum);
        *to = if z.is_nan() { UNKNOWN } else { integer };
    }
    if header.has(LOSSY) {
        return;
    }
    let known = || work.iter().filter(|z| **z != UNKNOWN);
    let mut divisor = 0;
    for &z in known() {
        divisor = common_divisor(divisor, z as u32);
        if divisor == 1 {
            return;
        }
    }
    if divisor > 1 {
        header.quantum *= divisor as f32;
        let known = work.iter_mut().filter(|z| **z != UNKNOWN);
        known.for_each(|z| *z /= divisor as i32);
    }
}

fn common_divisor(mut a: u32, mut b: u32) -> u32 {
    while b > 0 {
        (a, b) = (b, a % b);
    }
    a
}

/// Writes the stream; `work` then holds the heights that the decoder will have.
fn write_stream(
    heights: &[f32],
    header: &Header,
    work: &mut [i32],
    out: &mut [u8],
) -> Result<usize, CodecError> {
    let (shape, levels) = (header.shape, lifting::levels(header.shape));
    if header.has(HAS_UNKNOWN) {
        fill::fill(work, shape);
    }
    lifting::forward(work, shape, levels, true);
    let body = out.len() - TRAILER;
    let coder = Encoder::new(&mut out[HEADER..body]);
    let mut walk = Walk::new(coder, work, shape, header.has(LOSSY));
    if header.has(HAS_UNKNOWN) {
        walk.unknown(|i| heights[i].is_nan(), |_, _| {});
    }
    walk.coarsest();
    for level in (1..=levels).rev() {
        walk.level(level);
        if walk.coder.is_full() {
            return Err(CodecError::Full);
        }
    }
    walk.dequantise(0);
    let occupied: Occupied = walk.occupied;
    let length = walk.coder.finish().ok_or(CodecError::Full)?;
    lifting::inverse(work, shape, (levels, 0), occupied);
    Ok(length)
}

/// Writes the stream of packed blocks.
fn pack_stream(
    heights: &[f32],
    header: &Header,
    work: &mut [i32],
    out: &mut [u8],
) -> Result<usize, CodecError> {
    let (shape, levels) = (header.shape, lifting::levels(header.shape));
    let body = out.len() - TRAILER;
    let mut writer = Writer::new(&mut out[HEADER..body]);
    if header.has(HAS_UNKNOWN) {
        writer.unknown(heights.iter().map(|z| z.is_nan()));
        fill::fill(work, shape);
    }
    lifting::forward(work, shape, levels, false);
    writer.levels(work, shape, levels);
    writer.finish().ok_or(CodecError::Full)
}

/// (largest error, mean square) over known heights.
fn errors(heights: &[f32], header: &Header, work: &[i32]) -> (f32, f64) {
    let (mut largest, mut sums) = ([0.0f32; LANES], [0.0f64; LANES]);
    let mut count = [0u32; LANES];
    let mut see = |lane: usize, z: f32, integer: i32| {
        let error = math::abs(header.height(integer) - z);
        let error = if z.is_nan() { 0.0 } else { error };
        largest[lane] = if error > largest[lane] {
            error
        } else {
            largest[lane]
        };
        sums[lane] += f64::from(error) * f64::from(error);
        count[lane] += u32::from(!z.is_nan());
    };
    let (chunks, rest) = heights.as_chunks::<LANES>();
    let (integers, integers_rest) = work.as_chunks::<LANES>();
    for (chunk, integers) in chunks.iter().zip(integers) {
        (0..LANES).for_each(|lane| see(lane, chunk[lane], integers[lane]));
    }
    let rest = rest.iter().zip(integers_rest);
    rest.for_each(|(&z, &integer)| see(0, z, integer));
    let largest = -largest.into_iter().fold(0.0, |a, b| least(a, -b));
    let count: u32 = count.into_iter().sum();
    (
        largest,
        sums.into_iter().sum::<f64>() / f64::from(count.max(1)),
    )
}
