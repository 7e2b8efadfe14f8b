//! The precision that meets a bound or a size.
//!
//! Both try encodings, each at the cost of one or, where it would be too long, less; the best
//! one is made again at the end.

use super::header::{HEADER, TRAILER};
use super::{CodecError, Encoded, Precision, encode};
use crate::surfaces::Shape;
use rugosa_grid::math;

/// Trials of a step for a bound.
const TRIALS: u32 = 7;

/// Halvings, in the logarithm, of a step for a size: to 0.3 %.
const HALVINGS: u32 = 9;

/// Factor between the trials that find the interval to be halved.
const STRIDE: f32 = 4.0;

/// Fewest bytes with every known height within `bound` metres: exact to the quantum, or
/// coefficients rounded as coarsely as the bound allows, whichever is smaller.
///
/// ```
/// use rugosa_fractal::codec::{Precision, encode, encode_within};
/// use rugosa_fractal::surfaces::Shape;
/// let shape = Shape::new(33, 33);
/// let heights: Vec<f32> = (0..33 * 33).map(|i| (0.01 * (i % 33 * i) as f32).sin()).collect();
/// let (mut work, mut bytes) = (vec![0; 33 * 33], vec![0; 6000]);
/// let exact = encode(&heights, shape, Precision::Within(0.2), (&mut work, &mut bytes)).unwrap();
/// let best = encode_within(&heights, shape, 0.2, (&mut work, &mut bytes)).unwrap();
/// assert!(best.max_error <= 0.2 && best.bytes <= exact.bytes);
/// ```
///
/// # Errors
/// As [`encode`].
pub fn encode_within(
    heights: &[f32],
    shape: Shape,
    bound: f32,
    (work, out): (&mut [i32], &mut [u8]),
) -> Result<Encoded, CodecError> {
    let exact = exactly_within(heights, shape, (bound, Precision::Within), (work, out))?;
    let mut best: Option<(f32, Encoded)> = None;
    // the largest error is some 1.5 to 4 steps, nearly in proportion
    let (mut fine, mut coarse) = (0.05 * bound, 4.0 * bound);
    let mut step = 0.4 * bound;
    for _ in 0..TRIALS {
        let shorter = exact.bytes.min(out.len());
        let lent = (&mut *work, &mut out[..shorter]);
        match encode(heights, shape, Precision::Step(step), lent) {
            Ok(lossy) => {
                if lossy.max_error > bound {
                    coarse = step;
                } else {
                    fine = step;
                    if best.is_none_or(|(_, b)| lossy.bytes < b.bytes) {
                        best = Some((step, lossy));
                    }
                }
                step *= 0.98 * bound / lossy.max_error.max(0.01 * bound);
            }
            Err(CodecError::Full | CodecError::TooFine(_)) => {
                fine = step;
                step *= 2.0;
            }
            Err(error) => return Err(error),
        }
        if !(step > fine && step < coarse) {
            step = math::sqrt(fine * coarse);
        }
    }
    match best {
        Some((step, lossy)) if lossy.bytes < exact.bytes => {
            encode(heights, shape, Precision::Step(step), (work, out))
        }
        _ => exactly_within(heights, shape, (bound, Precision::Within), (work, out)),
    }
}

/// Every known height within `bound` metres, packed for speed.
///
/// ```
/// use rugosa_fractal::codec::{decode, encode_quickly};
/// use rugosa_fractal::surfaces::Shape;
/// let heights: [f32; 81] = core::array::from_fn(|i| (i % 9) as f32 * 0.37);
/// let (mut work, mut bytes, mut back) = ([0; 81], [0; 600], [0.0; 81]);
/// let told = encode_quickly(&heights, Shape::new(9, 9), 0.01, (&mut work, &mut bytes)).unwrap();
/// decode(&bytes[..told.bytes], (&mut work, &mut back)).unwrap();
/// assert!(heights.iter().zip(back).all(|(a, b)| (a - b).abs() <= 0.01)); // metres
/// ```
///
/// # Errors
/// As [`encode`].
pub fn encode_quickly(
    heights: &[f32],
    shape: Shape,
    bound: f32,
    lent: (&mut [i32], &mut [u8]),
) -> Result<Encoded, CodecError> {
    exactly_within(heights, shape, (bound, Precision::Quick), lent)
}

/// The quantum shrinks a little if the rounding of f32 carried an error over the bound.
fn exactly_within(
    heights: &[f32],
    shape: Shape,
    (bound, precisely): (f32, fn(f32) -> Precision),
    (work, out): (&mut [i32], &mut [u8]),
) -> Result<Encoded, CodecError> {
    let mut precision = bound;
    for _ in 0..8 {
        let encoded = encode(heights, shape, precisely(precision), (work, out))?;
        if encoded.max_error <= bound {
            return Ok(encoded);
        }
        precision *= 0.97;
    }
    // heights so far from zero that f32 cannot hold them within the bound
    Err(CodecError::TooFine(bound))
}

/// Best quality in at most `bytes` bytes.
///
/// ```
/// use rugosa_fractal::codec::{CodecError, encode_to_size};
/// use rugosa_fractal::surfaces::Shape;
/// let shape = Shape::new(33, 33);
/// let heights: Vec<f32> = (0..33 * 33).map(|i| (0.01 * (i % 33 * i) as f32).sin()).collect();
/// let (mut work, mut bytes) = (vec![0; 33 * 33], vec![0; 6000]);
/// let mut coded = |size| encode_to_size(&heights, shape, size, (&mut work, &mut bytes));
/// let (small, large) = (coded(200).unwrap(), coded(800).unwrap());
/// assert!(small.bytes <= 200 && large.bytes <= 800);
/// assert!(large.mean_square < small.mean_square);
/// assert_eq!(coded(20), Err(CodecError::Unreachable(20)));
/// ```
///
/// # Errors
/// As [`encode`]; [`CodecError::Unreachable`] if even a nearly flat map is longer.
pub fn encode_to_size(
    heights: &[f32],
    shape: Shape,
    bytes: usize,
    (work, out): (&mut [i32], &mut [u8]),
) -> Result<Encoded, CodecError> {
    let limit = bytes.min(out.len());
    if limit < HEADER + TRAILER {
        return Err(CodecError::Unreachable(bytes));
    }
    let out = &mut out[..limit];
    let relief = relief(heights).max(1e-6);
    let mut best: Option<(f32, Encoded)> = None;
    let mut fits = |step: f32| match encode(heights, shape, Precision::Step(step), (work, out)) {
        Ok(encoded) => {
            if best.is_none_or(|(_, b)| encoded.mean_square <= b.mean_square) {
                best = Some((step, encoded));
            }
            Ok(true)
        }
        Err(CodecError::Full | CodecError::TooFine(_)) => Ok(false),
        Err(error) => Err(error),
    };
    let (mut fine, mut coarse) = interval(relief, &mut fits)?;
    for _ in 0..HALVINGS {
        let step = math::sqrt(fine * coarse);
        if fits(step)? {
            coarse = step;
        } else {
            fine = step;
        }
    }
    let (step, _) = best.ok_or(CodecError::Unreachable(bytes))?;
    encode(heights, shape, Precision::Step(step), (work, out))
}

/// A step that is too fine and one that fits, a factor apart, if there are any.
fn interval(
    relief: f32,
    fits: &mut impl FnMut(f32) -> Result<bool, CodecError>,
) -> Result<(f32, f32), CodecError> {
    let (finest, coarsest) = (relief * 1e-5, relief * 4.0);
    let mut step = relief / 32.0;
    if fits(step)? {
        while step > finest {
            if !fits(step / STRIDE)? {
                break;
            }
            step /= STRIDE;
        }
        return Ok((step / STRIDE, step));
    }
    while step < coarsest {
        if fits(step * STRIDE)? {
            break;
        }
        step *= STRIDE;
    }
    Ok((step, step * STRIDE))
}

fn relief(heights: &[f32]) -> f32 {
    let known = heights.iter().filter(|z| z.is_finite());
    let (low, high) = known.fold((f32::MAX, f32::MIN), |m, &z| (m.0.min(z), m.1.max(z)));
    if high > low { high - low } else { 0.0 }
}
