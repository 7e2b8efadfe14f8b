//! Successive random addition as published: the generator of the 1996 paper.
//!
//! Voss (1988), as in Saupe's chapter of "The Science of Fractal Images", algorithm
//! MidPointFM2D with additions; Arakawa & Krotkov (1996) use it for all their synthetic
//! terrain. From the four corners, each stage halves the spacing in two half steps
//! (centres of squares, then centres of edges, the latter by the mean of their three or
//! four neighbours) and adds noise to *every* node, of a standard deviation that shrinks
//! by 2^{−H/2} each half step.
//!
//! Its structure function is only roughly a power law, flatter at short lags: the slope
//! over 1–16 cells is up to 0.12 below H (`the_slope_is_near_the_hurst_exponent`);
//! [`super::pyramid`] is better and
//! [`super::exact_fbm`] exact. Cost: two normal numbers per node and more. No memory but
//! the output.

use super::normal;
use crate::pyramid::Error;
use rand_core::Rng;
use rugosa_grid::math;

/// Fills `out` (side² elements, side = 2^k + 1) with a surface of Hurst exponent
/// `hurst`, scaled so that an elevation difference over the whole side has a standard
/// deviation of roughly side^H, that over one cell of 1 to 2 (1.5 at H = 0.5).
///
/// ```
/// use rand_core::SeedableRng;
/// use rugosa_fractal::{pyramid::Error, synthesis::classic};
/// # let mut rng = rand_xoshiro::Xoshiro128PlusPlus::seed_from_u64(1);
/// let mut z = vec![0.0; 129 * 129];
/// classic(129, 0.5, &mut rng, &mut z).unwrap();
/// // mean square of the differences within a row
/// let square = |lag: usize| {
///     let rows = z.chunks(129).flat_map(|row| row.iter().zip(&row[lag..]));
///     rows.map(|(a, b)| (b - a).powi(2)).sum::<f32>() / (129 * (129 - lag)) as f32
/// };
/// assert!((1.0..3.0).contains(&square(1)));
/// assert!((2.5..4.5).contains(&(square(4) / square(1)))); // roughly 4^2H
/// assert_eq!(classic(128, 0.5, &mut rng, &mut z), Err(Error::Side(128)));
/// ```
///
/// # Errors
/// A side that is not 2^k + 1; `hurst` outside (0, 1); `out` too small.
pub fn classic(side: usize, hurst: f32, rng: &mut impl Rng, out: &mut [f32]) -> Result<(), Error> {
    if side < 3 || !(side - 1).is_power_of_two() {
        return Err(Error::Side(side));
    }
    if !(hurst > 0.0 && hurst < 1.0) {
        return Err(Error::Hurst(hurst));
    }
    let z = out
        .get_mut(..side * side)
        .ok_or(Error::Memory(side * side))?;
    let shrink = math::exp2(-0.5 * hurst);
    // differences have twice the variance of their ends
    let half = core::f32::consts::FRAC_1_SQRT_2;
    let mut deviation = half * math::powf((side - 1) as f32, hurst);
    let mut step = side - 1;
    add(z, (side, step), deviation, rng, true);
    while step > 1 {
        deviation *= shrink;
        centres(z, side, step);
        add_stage(z, (side, step), deviation, rng);
        deviation *= shrink;
        edges(z, side, step / 2);
        step /= 2;
        add(z, (side, step), deviation, rng, false);
    }
    Ok(())
}

/// Noise on the nodes of a lattice of spacing `step`; the first time it sets them.
fn add(z: &mut [f32], (side, step): (usize, usize), sd: f32, rng: &mut impl Rng, set: bool) {
    for y in (0..side).step_by(step) {
        for x in (0..side).step_by(step) {
            let before = if set { 0.0 } else { z[y * side + x] };
            z[y * side + x] = before + sd * normal(rng);
        }
    }
}

/// Noise on the lattice and on the centres of its squares.
fn add_stage(z: &mut [f32], (side, step): (usize, usize), sd: f32, rng: &mut impl Rng) {
    add(z, (side, step), sd, rng, false);
    for y in (step / 2..side).step_by(step) {
        for x in (step / 2..side).step_by(step) {
            z[y * side + x] += sd * normal(rng);
        }
    }
}

/// Centres of squares: mean of the four corners.
fn centres(z: &mut [f32], side: usize, step: usize) {
    let half = step / 2;
    for y in (half..side).step_by(step) {
        for x in (half..side).step_by(step) {
            let at = |dy: usize, dx: usize| z[(y + dy - half) * side + x + dx - half];
            z[y * side + x] = 0.25 * (at(0, 0) + at(0, step) + at(step, 0) + at(step, step));
        }
    }
}

/// Centres of edges: mean of the three or four neighbours at `half`.
fn edges(z: &mut [f32], side: usize, half: usize) {
    for y in (0..side).step_by(half) {
        let start = if (y / half).is_multiple_of(2) {
            half
        } else {
            0
        };
        for x in (start..side).step_by(2 * half) {
            let (mut sum, mut count) = (0.0, 0.0);
            for (dy, dx) in [(0, 1), (1, 0), (1, 2), (2, 1)] {
                let (v, u) = (y + dy * half, x + dx * half);
                if v >= half && u >= half && v < side + half && u < side + half {
                    sum += z[(v - half) * side + u - half];
                    count += 1.0;
                }
            }
            z[y * side + x] = sum / count;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_core::SeedableRng;
    use rand_xoshiro::Xoshiro128PlusPlus;
    use std::vec;

    fn slope(hurst: f32) -> f64 {
        let side = 129;
        let mut z = vec![f32::NAN; side * side];
        let mut rng = Xoshiro128PlusPlus::seed_from_u64(3);
        let mut square = [0.0f64; 2];
        for _ in 0..20 {
            classic(side, hurst, &mut rng, &mut z).unwrap();
            for (sum, lag) in square.iter_mut().zip([1, 16]) {
                for i in (0..side * side).filter(|i| i % side + lag < side) {
                    *sum += f64::from(z[i + lag] - z[i]).powi(2) / (side - lag) as f64;
                }
            }
        }
        0.5 * (square[1] / square[0]).log2() / 4.0
    }

    #[test]
    fn the_slope_is_near_the_hurst_exponent() {
        for hurst in [0.3, 0.5, 0.7] {
            let found = slope(hurst);
            let error = found - f64::from(hurst);
            assert!((-0.13..0.05).contains(&error), "H {hurst}: {found}");
        }
    }

    #[test]
    fn bad_parameters_are_named() {
        let mut rng = Xoshiro128PlusPlus::seed_from_u64(3);
        let mut z = [0.0; 25];
        assert_eq!(classic(4, 0.5, &mut rng, &mut z), Err(Error::Side(4)));
        assert_eq!(classic(5, 0.0, &mut rng, &mut z), Err(Error::Hurst(0.0)));
        assert_eq!(classic(9, 0.5, &mut rng, &mut z), Err(Error::Memory(81)));
    }
}
