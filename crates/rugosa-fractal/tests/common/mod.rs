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
