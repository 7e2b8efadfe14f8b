//! Scaling range by iterative least squares (Arakawa and Krotkov 1996, § 2.5).
//!
//! A line through all points; while its rms residual exceeds the tolerance, the end point
//! with the larger residual is dropped (short lags may be smoothed or noisy, long ones
//! have few independent pairs). `None` if fewer than three points remain.

use super::LEAST_POINTS;
use super::least_squares::line;

pub(super) fn ends(x: &[f64], y: &[f64], tolerance: f64) -> Option<(usize, usize)> {
    let (mut first, mut last) = (0, x.len() - 1);
    while last + 1 >= first + LEAST_POINTS {
        let fit = line(&x[first..=last], &y[first..=last]);
        if fit.rss <= tolerance * tolerance * (last - first + 1) as f64 {
            return Some((first, last));
        }
        let [level, slope, ..] = fit.coefficients;
        let off = |i: usize| (y[i] - level - slope * x[i]).abs();
        if off(first) > off(last) {
            first += 1;
        } else {
            last -= 1;
        }
    }
    None
}
