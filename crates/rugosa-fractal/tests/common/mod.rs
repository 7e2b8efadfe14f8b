<<<<<<< HEAD
//! Shared by the tests of surfaces and codec: oracles, the real DEM, noise, figures.
#![allow(dead_code)]

use rand_xoshiro::Xoshiro128PlusPlus;
use rand_xoshiro::rand_core::{Rng, SeedableRng};
use std::path::PathBuf;

fn data(folder: &str, name: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
        .join("../../tests")
        .join(folder)
        .join(name)
}

/// An oracle of `tests/oracles`.
pub fn oracle(name: &str) -> serde_json::Value {
    let text = std::fs::read_to_string(data("oracles", name)).unwrap();
    serde_json::from_str(&text).unwrap()
}

/// All numbers of a nested array, in order.
pub fn values(json: &serde_json::Value) -> Vec<f32> {
    values64(json).into_iter().map(|v| v as f32).collect()
}

/// The same in f64.
pub fn values64(json: &serde_json::Value) -> Vec<f64> {
    match json.as_array() {
        Some(array) => array.iter().flat_map(values64).collect(),
        None => vec![json.as_f64().unwrap()],
    }
}

/// `side × side` samples of the Jacksboro DEM from (row, column).
pub fn crop(row: usize, column: usize, side: usize) -> Vec<f32> {
    let bytes = std::fs::read(data("data", "jacksboro.npy")).unwrap();
    let body = &bytes[bytes.len() - 344 * 403 * 4..];
    let at = |i: usize| f32::from_le_bytes(body[4 * i..4 * i + 4].try_into().unwrap());
    (0..side * side)
        .map(|i| at((row + i / side) * 403 + column + i % side))
        .collect()
}

/// Standard normal numbers (Box–Muller).
pub fn normal(seed: u64) -> impl FnMut() -> f32 {
    let mut rng = Xoshiro128PlusPlus::seed_from_u64(seed);
    let mut uniform = move || (f64::from(rng.next_u32()) + 0.5) / 4294967296.0;
    move || ((-2.0 * uniform().ln()).sqrt() * (std::f64::consts::TAU * uniform()).cos()) as f32
}

/// Bilinear interpolation of `side²` nodes, `step` samples per tile.
pub fn bilinear(nodes: &[f32], side: usize, step: usize) -> Vec<f32> {
    let fine = (side - 1) * step + 1;
    (0..fine * fine)
        .map(|i| {
            let split = |k: usize| {
                let n = (k / step).min(side - 2);
                (n, (k - n * step) as f32 / step as f32)
            };
            let ((r, u), (c, v)) = (split(i / fine), split(i % fine));
            let at = |r: usize, c: usize| nodes[r * side + c];
            (1.0 - u) * ((1.0 - v) * at(r, c) + v * at(r, c + 1))
                + u * ((1.0 - v) * at(r + 1, c) + v * at(r + 1, c + 1))
        })
        .collect()
}

/// Root mean square difference.
pub fn rmse(a: &[f32], b: &[f32]) -> f64 {
    let sum: f64 = a
        .iter()
        .zip(b)
        .map(|(a, b)| (f64::from(*a) - f64::from(*b)).powi(2))
        .sum();
    (sum / b.len() as f64).sqrt()
}

/// Peak signal to noise \[dB\], peak = relief of the original `b`.
pub fn psnr(a: &[f32], b: &[f32]) -> f64 {
    let (low, high) = b
        .iter()
        .fold((f32::MAX, f32::MIN), |m, v| (m.0.min(*v), m.1.max(*v)));
    20.0 * (f64::from(high - low) / rmse(a, b)).log10()
}

/// Largest absolute difference.
pub fn max_error(a: &[f32], b: &[f32]) -> f32 {
    a.iter().zip(b).fold(0.0, |m, (a, b)| m.max((a - b).abs()))
}
=======
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
>>>>>>> d687654 (Pyramid prior and its posterior: mean, realisations and deviation from sparse elevations)
