//! Scaling range by elongation (Yokoya et al. 1989, as stated by Fang et al. 2004).
//!
//! I(k) = √(4 s_xy² + (s_xx − s_yy)²) / (s_xx + s_yy) of the first k points is 1 where they
//! lie on a line. The range ends at the first k ≥ 4 with I(k−1) < I(k) > I(k+1), or takes
//! all points; differences below 1e-12, the rounding of an exact line, do not count. Measured: the first maximum of a noisy line is at 4 to 10 of 40 points,
//! wherever its end; for comparison only.

/// Elongations closer than this are equal.
const ROUNDING: f64 = 1e-12;

/// Number of points up to the first maximum of the elongation.
pub(super) fn first_maximum(x: &[f64], y: &[f64]) -> usize {
    let n = x.len();
    let is_peak = |k: usize| {
        let [before, here, after] = [k - 1, k, k + 1].map(|k| elongation(&x[..k], &y[..k]));
        before < here - ROUNDING && here > after + ROUNDING
    };
    (4..n).find(|&k| is_peak(k)).unwrap_or(n)
}

fn elongation(x: &[f64], y: &[f64]) -> f64 {
    let n = x.len() as f64;
    let (mx, my) = (x.iter().sum::<f64>() / n, y.iter().sum::<f64>() / n);
    let mut s = [0.0; 3];
    for (x, y) in x.iter().zip(y) {
        let (u, v) = (x - mx, y - my);
        s = [s[0] + u * u / n, s[1] + u * v / n, s[2] + v * v / n];
    }
    let [xx, xy, yy] = s;
    libm::sqrt(4.0 * xy * xy + (xx - yy) * (xx - yy)) / (xx + yy)
}
