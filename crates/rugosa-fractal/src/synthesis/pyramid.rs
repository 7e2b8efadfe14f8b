//! fBm as a draw from the calibrated pyramid prior, without a heap.
//!
//! u = Σ_l P_l (s_l ∘ w_l) + plane, w_l standard normal, the level variances s_l² from
//! [`Levels`]. A draw from the posterior without data, so there is no code of its own.
//!
//! Cost: a normal number and about 10 additions and multiplications per cell. Accuracy:
//! structure function within 3 % of the model's, `the_structure_function_is_a_power_law`.

use crate::pyramid::{Error, Posterior, Prior};
use rand_core::Rng;

/// Fills `out` (side² elements, row by row) with a surface \[m\] of zero mean level.
/// `memory` lends [`Posterior::need`] elements.
///
/// ```
/// use rand_core::SeedableRng;
/// use rugosa_fractal::pyramid::{Levels, Posterior};
/// use rugosa_fractal::synthesis::pyramid;
/// let prior = Levels::power_law(129, 0.5, 0.2).unwrap(); // 0.2 m over one cell
/// let mut rng = rand_xoshiro::Xoshiro128PlusPlus::seed_from_u64(2);
/// # let (mut memory, mut z) = (vec![0.0; Posterior::need(129).unwrap()], vec![0.0; 129 * 129]);
/// pyramid((129, &prior), &mut rng, &mut memory, &mut z).unwrap();
/// // mean square of the differences within a row [m²]
/// let square = |lag: usize| {
///     let rows = z.chunks(129).flat_map(|row| row.iter().zip(&row[lag..]));
///     rows.map(|(a, b)| (b - a).powi(2)).sum::<f32>() / (129 * (129 - lag)) as f32
/// };
/// assert!((square(1) / 0.04 - 1.0).abs() < 0.05 && (square(4) / 0.16 - 1.0).abs() < 0.1);
/// ```
///
/// # Errors
/// A side that is not 2^k + 1; too little memory.
pub fn pyramid(
    (side, prior): (usize, &impl Prior),
    rng: &mut impl Rng,
    memory: &mut [f32],
    out: &mut [f32],
) -> Result<(), Error> {
    let out = out
        .get_mut(..side * side)
        .ok_or(Error::Memory(side * side))?;
    let mut posterior = Posterior::new(side, memory)?;
    posterior.draw((prior, |_| None), 1.0, rng);
    posterior.realisation((prior, |_| None), 1.0, rng, out);
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pyramid::Levels;
    use rand_core::SeedableRng;
    use rand_xoshiro::Xoshiro128PlusPlus;
    use std::vec;

    fn square(z: &[f32], side: usize, dx: usize, dy: usize) -> f64 {
        let mut sum = 0.0;
        for y in 0..side - dy {
            for x in 0..side - dx {
                sum += f64::from(z[(y + dy) * side + x + dx] - z[y * side + x]).powi(2);
            }
        }
        sum / ((side - dx) * (side - dy)) as f64
    }

    #[test]
    fn the_structure_function_is_a_power_law() {
        let side = 65;
        let mut memory = vec![0.0; Posterior::need(side).unwrap()];
        let mut z = vec![0.0; side * side];
        for hurst in [0.1, 0.3, 0.5, 0.7, 0.9] {
            let levels = Levels::power_law(side, hurst, 3.0).unwrap();
            let mut rng = Xoshiro128PlusPlus::seed_from_u64(1);
            let lags = [
                (1, 0),
                (0, 1),
                (1, 1),
                (2, 0),
                (0, 4),
                (6, 3),
                (8, 8),
                (16, 0),
            ];
            let mut ratio = [(0.0, 0.0); 8];
            let count = 300.0;
            for _ in 0..count as usize {
                pyramid((side, &levels), &mut rng, &mut memory, &mut z).unwrap();
                for (r, (x, y)) in ratio.iter_mut().zip(lags) {
                    let power = 9.0 * ((x * x + y * y) as f64).powf(f64::from(hurst));
                    let value = square(&z, side, x, y) / power;
                    *r = (r.0 + value / count, r.1 + value * value / count);
                }
            }
            for ((mean, squares), lag) in ratio.into_iter().zip(lags) {
                let error = ((squares - mean * mean) / count).sqrt();
                let allowed = 0.03 + 3.5 * error;
                assert!(
                    (mean - 1.0).abs() < allowed,
                    "H {hurst} {lag:?}: {mean} ± {error}"
                );
            }
        }
    }

    #[test]
    fn the_same_bits_for_ever() {
        let levels = Levels::power_law(33, 0.6, 1.0).unwrap();
        let mut memory = vec![0.0; Posterior::need(33).unwrap()];
        let mut z = vec![0.0; 33 * 33];
        let mut rng = Xoshiro128PlusPlus::seed_from_u64(7);
        pyramid((33, &levels), &mut rng, &mut memory, &mut z).unwrap();
        assert!(z.iter().all(|v| v.is_finite() && v.abs() < 100.0), "{z:?}");
        let mix = z
            .iter()
            .fold(0u32, |sum, v| sum.rotate_left(5) ^ v.to_bits());
        assert_eq!(mix, 0xa17b_83a2, "{mix:#x}");
    }
}
