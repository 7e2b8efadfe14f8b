//! The precision that meets a bound or a size.
//!
//! Both try encodings; each costs one encode. Only the best one's bytes stay in the output.

use super::{CodecError, Encoded, Precision, encode};
use crate::surfaces::Shape;
use rugosa_grid::math;

/// Trials of a search for a step.
const TRIALS: u32 = 14;

/// Fewest bytes with every known height within `bound` metres: exact to the quantum, or
/// coefficients rounded as coarsely as the bound allows, whichever is smaller.
///
/// # Errors
/// As [`encode`].
pub fn encode_within(
    heights: &[f32],
    shape: Shape,
    bound: f32,
    (work, out): (&mut [i32], &mut [u8]),
) -> Result<Encoded, CodecError> {
    let exact = exactly_within(heights, shape, bound, (work, out))?;
    let mut best: Option<(f32, Encoded)> = None;
    // the largest error is some 2 to 4 steps; the search is in its logarithm
    let (mut fine, mut coarse) = (0.1 * bound, 4.0 * bound);
    for _ in 0..TRIALS / 2 {
        let step = math::sqrt(fine * coarse);
        match encode(heights, shape, Precision::Step(step), (work, out)) {
            Ok(lossy) if lossy.max_error <= bound => {
                if best.is_none_or(|(_, b)| lossy.bytes < b.bytes) {
                    best = Some((step, lossy));
                }
                fine = step;
            }
            Ok(_) => coarse = step,
            Err(CodecError::Full | CodecError::TooFine(_)) => fine = step,
            Err(error) => return Err(error),
        }
    }
    match best {
        Some((step, lossy)) if lossy.bytes < exact.bytes => {
            encode(heights, shape, Precision::Step(step), (work, out))
        }
        _ => exactly_within(heights, shape, bound, (work, out)),
    }
}

/// The quantum shrinks a little if the rounding of f32 carried an error over the bound.
fn exactly_within(
    heights: &[f32],
    shape: Shape,
    bound: f32,
    (work, out): (&mut [i32], &mut [u8]),
) -> Result<Encoded, CodecError> {
    let mut precision = bound;
    for _ in 0..8 {
        let encoded = encode(heights, shape, Precision::Within(precision), (work, out))?;
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
/// # Errors
/// As [`encode`]; [`CodecError::Unreachable`] if even a nearly flat map is longer.
pub fn encode_to_size(
    heights: &[f32],
    shape: Shape,
    bytes: usize,
    (work, out): (&mut [i32], &mut [u8]),
) -> Result<Encoded, CodecError> {
    let limit = bytes.min(out.len());
    if limit < super::HEADER + super::TRAILER {
        return Err(CodecError::Unreachable(bytes));
    }
    let out = &mut out[..limit];
    let relief = relief(heights).max(1e-6);
    let (mut fine, mut coarse) = (relief * 1e-5, relief * 4.0);
    let mut best: Option<(f32, Encoded)> = None;
    for _ in 0..TRIALS + 4 {
        let step = math::sqrt(fine * coarse);
        match encode(heights, shape, Precision::Step(step), (work, out)) {
            Ok(encoded) => {
                if best.is_none_or(|(_, b)| encoded.mean_square <= b.mean_square) {
                    best = Some((step, encoded));
                }
                coarse = step;
            }
            Err(CodecError::Full | CodecError::TooFine(_)) => fine = step,
            Err(error) => return Err(error),
        }
    }
    let (step, _) = best.ok_or(CodecError::Unreachable(bytes))?;
    encode(heights, shape, Precision::Step(step), (work, out))
}

fn relief(heights: &[f32]) -> f32 {
    let known = heights.iter().filter(|z| z.is_finite());
    let (low, high) = known.fold((f32::MAX, f32::MIN), |m, &z| (m.0.min(z), m.1.max(z)));
    if high > low { high - low } else { 0.0 }
}
