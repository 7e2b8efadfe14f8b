//! Exact fractional Brownian surfaces by intrinsic embedding.
//!
//! Stein (2002), "Fast and exact simulation of fractional Brownian surfaces", J. Comp.
//! Graph. Stat. 11: a stationary field with the covariance ρ(r), r in units of the
//! largest distance wanted,
//!
//! ```text
//! ρ(r) = c₀ − r^{2H} + c₂ r²            r ≤ 1
//!      = β (R − r)³ / r                 1 < r ≤ R
//! ```
//!
//! is periodic on a torus of edge 2R with a non-negative spectrum (H ≤ 3/4: R = 1, β =
//! 0, c₂ = H; else R = 2), so two FFTs draw it; adding a random plane of variance 2 c₂
//! per axis turns its structure function into 2 r^{2H} exactly. Its real and imaginary
//! parts are two independent surfaces.
//!
//! Output: side × side heights, row by row, zero at the first node, with
//! E Δz² = d^{2H}, d in cells. Cost: an FFT of (2 R √2 side)² points in double
//! precision, 32 bytes each: about 18 MB (R = 1) and 72 MB (R = 2) at 257².
//! Accuracy: exact up to rounding, `structure_function_is_the_power_law` below.

use super::normal;
use rand_core::SeedableRng;
use rand_xoshiro::Xoshiro128PlusPlus;
use rustfft::{Fft, FftPlanner, num_complex::Complex64};
use std::{sync::Arc, vec, vec::Vec};

/// One exact fBm surface; see [`exact_fbm_pair`].
///
/// ```
/// use rugosa_fractal::synthesis::exact_fbm;
/// let z = exact_fbm(128, 0.5, 1);
/// assert_eq!((z.len(), z[0]), (128 * 128, 0.0));
/// // mean square of the differences within a row: d^2H, d in cells
/// let square = |lag: usize| {
///     let rows = z.chunks(128).flat_map(|row| row.iter().zip(&row[lag..]));
///     rows.map(|(a, b)| (b - a).powi(2)).sum::<f32>() / (128 * (128 - lag)) as f32
/// };
/// assert!((square(1) - 1.0).abs() < 0.05 && (square(4) / 4.0 - 1.0).abs() < 0.1);
/// ```
pub fn exact_fbm(side: usize, hurst: f64, seed: u64) -> Vec<f32> {
    exact_fbm_pair(side, hurst, seed)[0].clone()
}

/// Two independent exact fBm surfaces of side × side nodes, E Δz² = d^{2H}, d in cells.
///
/// ```
/// use rugosa_fractal::synthesis::{exact_fbm, exact_fbm_pair};
/// let [first, second] = exact_fbm_pair(64, 0.5, 7);
/// assert_eq!(first, exact_fbm(64, 0.5, 7)); // the same seed, the same surface
/// // the steps of the two surfaces along their rows are not correlated
/// let rows = first.chunks(64).zip(second.chunks(64));
/// let steps = rows.flat_map(|(a, b)| a.windows(2).zip(b.windows(2)));
/// let products = steps.map(|(a, b)| (a[1] - a[0]) * (b[1] - b[0]));
/// assert!((products.sum::<f32>() / (64.0 * 63.0)).abs() < 0.1);
/// ```
///
/// # Panics
/// If `hurst` is not inside (0, 1) or `side` is 0.
pub fn exact_fbm_pair(side: usize, hurst: f64, seed: u64) -> [Vec<f32>; 2] {
    assert!(hurst > 0.0 && hurst < 1.0, "hurst must lie in (0, 1)");
    assert!(side > 0, "a surface has at least one node");
    let torus = Torus::new(side, hurst);
    let mut rng = Xoshiro128PlusPlus::seed_from_u64(seed);
    let mut field = torus.amplitudes();
    for a in &mut field {
        let re = f64::from(normal(&mut rng));
        *a = Complex64::new(re, f64::from(normal(&mut rng))) * a.re;
    }
    torus.transform(&mut field, side);
    let slopes: [f64; 4] = core::array::from_fn(|_| f64::from(normal(&mut rng)));
    [
        torus.surface(&field, |z| z.re, [slopes[0], slopes[1]]),
        torus.surface(&field, |z| z.im, [slopes[2], slopes[3]]),
    ]
}

/// The torus of the embedding: its covariance and its transform.
struct Torus {
    side: usize,
    edge: usize,
    step: f64,
    hurst: f64,
    radius: f64,
    beta: f64,
    c0: f64,
    c2: f64,
    fft: Arc<dyn Fft<f64>>,
}

impl Torus {
    fn new(side: usize, hurst: f64) -> Self {
        let cells = fast_size((side as f64 * 2f64.sqrt()).ceil() as usize + 1);
        let alpha = 2.0 * hurst;
        let (radius, beta, c0, c2) = if alpha <= 1.5 {
            (1.0, 0.0, 1.0 - alpha / 2.0, alpha / 2.0)
        } else {
            let r: f64 = 2.0;
            let beta = alpha * (2.0 - alpha) / (3.0 * r * (r * r - 1.0));
            let c2 = (alpha - beta * (r - 1.0).powi(2) * (r + 2.0)) / 2.0;
            (r, beta, beta * (r - 1.0).powi(3) + 1.0 - c2, c2)
        };
        let edge = 2 * radius as usize * cells;
        Torus {
            side,
            edge,
            step: 1.0 / cells as f64,
            hurst,
            radius,
            beta,
            c0,
            c2,
            fft: FftPlanner::new().plan_fft_forward(edge),
        }
    }

    fn covariance(&self, r: f64) -> f64 {
        if r <= 1.0 {
            self.c0 - r.powf(2.0 * self.hurst) + self.c2 * r * r
        } else if r <= self.radius {
            self.beta * (self.radius - r).powi(3) / r
        } else {
            0.0
        }
    }

    /// Square roots of the eigenvalues over the number of nodes.
    fn amplitudes(&self) -> Vec<Complex64> {
        let fold = |i: usize| i.min(self.edge - i) as f64 * self.step;
        let mut field = Vec::with_capacity(self.edge * self.edge);
        for y in 0..self.edge {
            for x in 0..self.edge {
                let r = fold(x).hypot(fold(y));
                field.push(Complex64::new(self.covariance(r), 0.0));
            }
        }
        self.transform(&mut field, self.edge);
        let count = field.len() as f64;
        for a in &mut field {
            *a = Complex64::new((a.re.max(0.0) / count).sqrt(), 0.0);
        }
        field
    }

    /// Two-dimensional transform; the result is right in the first `columns` rows only
    /// and stands transposed.
    fn transform(&self, field: &mut [Complex64], columns: usize) {
        self.fft.process(field);
        transpose(field, self.edge);
        self.fft.process(&mut field[..columns * self.edge]);
    }

    fn surface(
        &self,
        field: &[Complex64],
        part: impl Fn(&Complex64) -> f64,
        slope: [f64; 2],
    ) -> Vec<f32> {
        let tilt = (2.0 * self.c2).sqrt() * self.step;
        let scale = self.step.powf(-self.hurst) / 2f64.sqrt();
        let first = part(&field[0]);
        let mut heights = vec![0.0; self.side * self.side];
        for (i, z) in heights.iter_mut().enumerate() {
            let (y, x) = (i / self.side, i % self.side);
            let plane = tilt * (slope[0] * x as f64 + slope[1] * y as f64);
            *z = (scale * (part(&field[y * self.edge + x]) - first + plane)) as f32;
        }
        heights
    }
}

fn transpose(field: &mut [Complex64], edge: usize) {
    for y in 0..edge {
        for x in 0..y {
            field.swap(y * edge + x, x * edge + y);
        }
    }
}

/// Smallest number not below `at_least` with no prime factor above 5.
fn fast_size(at_least: usize) -> usize {
    let smooth = |mut n: usize| {
        for p in [2, 3, 5] {
            while n.is_multiple_of(p) {
                n /= p;
            }
        }
        n == 1
    };
    (at_least.max(1)..).find(|&n| smooth(n)).unwrap_or(at_least)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn structure(z: &[f32], side: usize, dx: usize, dy: usize) -> f64 {
        let mut sum = 0.0;
        for y in 0..side - dy {
            for x in 0..side - dx {
                let d = z[(y + dy) * side + x + dx] - z[y * side + x];
                sum += f64::from(d) * f64::from(d);
            }
        }
        sum / ((side - dx) * (side - dy)) as f64
    }

    /// Mean over surfaces of S²(h) / |h|^{2H} against its own standard error.
    #[test]
    fn structure_function_is_the_power_law() {
        let side = 65;
        for hurst in [0.1, 0.5, 0.75, 0.9] {
            let surfaces: Vec<Vec<f32>> = (0..60)
                .flat_map(|seed| exact_fbm_pair(side, hurst, seed))
                .collect();
            for (dx, dy) in [(1, 0), (0, 1), (1, 1), (4, 0), (0, 8), (16, 0), (32, 32)] {
                let d = ((dx * dx + dy * dy) as f64).sqrt();
                let ratio: Vec<f64> = surfaces
                    .iter()
                    .map(|z| structure(z, side, dx, dy) / d.powf(2.0 * hurst))
                    .collect();
                let count = ratio.len() as f64;
                let mean = ratio.iter().sum::<f64>() / count;
                let var = ratio.iter().map(|r| (r - mean).powi(2)).sum::<f64>() / count;
                let error = (var / count).sqrt();
                assert!(
                    (mean - 1.0).abs() < 4.0 * error + 1e-3,
                    "H {hurst} lag ({dx}, {dy}): {mean} ± {error}"
                );
            }
        }
    }

    #[test]
    fn spectrum_is_not_negative() {
        for hurst in [0.05, 0.5, 0.75, 0.76, 0.9, 0.98] {
            let torus = Torus::new(33, hurst);
            let mut field: Vec<Complex64> = Vec::new();
            let fold = |i: usize| i.min(torus.edge - i) as f64 * torus.step;
            for i in 0..torus.edge * torus.edge {
                let r = fold(i % torus.edge).hypot(fold(i / torus.edge));
                field.push(Complex64::new(torus.covariance(r), 0.0));
            }
            torus.transform(&mut field, torus.edge);
            let (low, high) = field.iter().fold((0f64, 0f64), |(low, high), z| {
                (low.min(z.re), high.max(z.re))
            });
            assert!(low > -1e-9 * high, "H {hurst}: {low} of {high}");
        }
    }

    #[test]
    fn seeds_and_parts_differ() {
        let [a, b] = exact_fbm_pair(9, 0.5, 7);
        assert_ne!(a, b);
        assert_eq!(a, exact_fbm(9, 0.5, 7));
        assert_ne!(a, exact_fbm(9, 0.5, 8));
        assert_eq!(a[0], 0.0);
    }
}
