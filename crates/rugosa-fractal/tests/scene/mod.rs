//! What the tests of the reconstruction share.
#![allow(dead_code)]

use rand_core::{Rng, SeedableRng};
use rand_xoshiro::Xoshiro128PlusPlus;
use rugosa_fractal::pyramid::{Datum, Levels, Posterior};
use rugosa_fractal::synthesis::{exact_fbm, normal, uniform};

pub fn rng(seed: u64) -> Xoshiro128PlusPlus {
    Xoshiro128PlusPlus::seed_from_u64(seed)
}

/// Structure function at a lag of `d` cells, mean of both axes.
pub fn structure(z: &[f32], side: usize, d: usize) -> f64 {
    let mut sum = 0.0;
    for y in 0..side {
        for x in 0..side - d {
            let across = f64::from(z[y * side + x + d] - z[y * side + x]);
            let along = f64::from(z[(x + d) * side + y] - z[x * side + y]);
            sum += across * across + along * along;
        }
    }
    sum / (2 * side * (side - d)) as f64
}

/// D of a full grid: slope of log S² over lags 1, 2, 4, 8, 16.
pub fn dimension(z: &[f32], side: usize) -> f64 {
    let points: Vec<(f64, f64)> = [1usize, 2, 4, 8, 16]
        .iter()
        .map(|&d| ((d as f64).ln(), structure(z, side, d).ln()))
        .collect();
    let n = points.len() as f64;
    let (mx, my) = points
        .iter()
        .fold((0.0, 0.0), |(a, b), p| (a + p.0 / n, b + p.1 / n));
    let (sxy, sxx) = points.iter().fold((0.0, 0.0), |(a, b), p| {
        (a + (p.0 - mx) * (p.1 - my), b + (p.0 - mx) * (p.0 - mx))
    });
    3.0 - 0.5 * sxy / sxx
}

/// Standard deviation of a surface.
pub fn relief(z: &[f32]) -> f64 {
    let n = z.len() as f64;
    let mean = z.iter().map(|&v| f64::from(v)).sum::<f64>() / n;
    (z.iter()
        .map(|&v| (f64::from(v) - mean).powi(2))
        .sum::<f64>()
        / n)
        .sqrt()
}

/// A surface, seen in part.
pub struct Scene {
    pub side: usize,
    pub hurst: f64,
    pub truth: Vec<f32>,
    pub data: Vec<Option<Datum>>,
}

impl Scene {
    /// Exact fBm, a share of the cells seen at a signal to noise ratio \[dB\].
    pub fn new(side: usize, hurst: f64, seen: f32, decibel: f64, seed: u64) -> Self {
        let truth = exact_fbm(side, hurst, seed);
        let noise = (relief(&truth) * 10f64.powf(-decibel / 20.0)) as f32;
        let mut rng = rng(seed ^ 0x5eed);
        let data = truth
            .iter()
            .map(|z| {
                (uniform(&mut rng) < seen).then(|| Datum {
                    height: z + noise * normal(&mut rng),
                    variance: noise * noise,
                })
            })
            .collect();
        Scene {
            side,
            hurst,
            truth,
            data,
        }
    }

    pub fn levels(&self) -> Levels {
        Levels::power_law(self.side, self.hurst as f32, 1.0).unwrap()
    }

    pub fn datum(&self) -> impl Fn(usize) -> Option<Datum> + Copy + '_ {
        |i| self.data[i]
    }

    pub fn mean(&self, iterations: usize) -> (Vec<f32>, f32) {
        let mut memory = vec![0.0; Posterior::need(self.side).unwrap()];
        let mut posterior = Posterior::new(self.side, &mut memory).unwrap();
        let levels = self.levels();
        posterior.observe(&levels, self.datum());
        let progress = posterior.step(iterations);
        let mut out = vec![0.0; self.side * self.side];
        posterior.mean(&levels, self.datum(), &mut out);
        (out, progress.residual)
    }

    pub fn realisation(&self, iterations: usize, rng: &mut impl Rng) -> Vec<f32> {
        let mut memory = vec![0.0; Posterior::need(self.side).unwrap()];
        let mut posterior = Posterior::new(self.side, &mut memory).unwrap();
        let levels = self.levels();
        posterior.draw((&levels, self.datum()), 1.0, rng);
        posterior.step(iterations);
        let mut out = vec![0.0; self.side * self.side];
        posterior.realisation((&levels, self.datum()), 1.0, rng, &mut out);
        out
    }

    /// Root mean square error over the cells that were not seen.
    pub fn error(&self, z: &[f32]) -> f64 {
        let (mut sum, mut count) = (0.0, 0.0);
        for (i, t) in self.truth.iter().enumerate() {
            if self.data[i].is_none() {
                sum += f64::from(z[i] - t).powi(2);
                count += 1.0;
            }
        }
        (sum / count).sqrt()
    }
}
