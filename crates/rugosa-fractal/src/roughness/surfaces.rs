//! Tests of the on-board estimate on exact surfaces.

extern crate std;
use super::*;
use crate::synthesis::exact_fbm;
use rand_core::{Rng, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;
use rugosa_grid::{Cell, Sample, Tile, Tiles, Window};
use std::vec;
use std::vec::Vec;

const SIDE: usize = 129;
const STEP: f32 = 0.0005;
const RESOLUTION: f32 = 0.1;

/// A fully or partly seen surface: σ = 0.1 m at 1 m, heights in steps.
struct Ground {
    window: Window,
    samples: Vec<Sample>,
}

impl Ground {
    fn new(hurst: f64, seen: f64, noise: f32, seed: u64) -> Self {
        let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
        let scale = 0.1 * f64::from(RESOLUTION).powf(hurst);
        let heights = exact_fbm(SIDE, hurst, seed);
        let mut uniform = || (random.next_u64() >> 11) as f64 / (1u64 << 53) as f64;
        let mut normal =
            || (-2.0 * (1.0 - uniform()).ln()).sqrt() * (std::f64::consts::TAU * uniform()).cos();
        let variance = (noise / STEP).powi(2) as u16;
        let sample = |z: &f32| {
            let height = f64::from(*z) * scale + f64::from(noise) * normal();
            Sample::measured((height / f64::from(STEP)).round() as i16, variance, 0, 0, 0)
        };
        let mut samples: Vec<Sample> = heights.iter().map(sample).collect();
        for sample in &mut samples {
            if (random.next_u64() >> 11) as f64 / (1u64 << 53) as f64 >= seen {
                *sample = Sample::default();
            }
        }
        Ground {
            window: Window::new(SIDE, Cell::new(0, 0)),
            samples,
        }
    }

    /// Roughness of nine blocks of 3 × 3 tiles far apart, and of the whole.
    fn estimates(
        &mut self,
        settings: &Settings,
    ) -> (Vec<Result<Roughness, Reason>>, Result<Roughness, Reason>) {
        let mut tiles = vec![TileSums::default(); StructureFunction::tiles_needed(SIDE)];
        let mut block = Block::new();
        let mut structure = StructureFunction::new(SIDE, &mut tiles, &mut block);
        for cell in self.window.cells() {
            structure.replaced(&self.window, &self.samples, cell, &Sample::default());
        }
        structure.commit(&self.window, &mut self.samples);
        let ring = Tiles::of(&self.window);
        let at = |i: i32| Tile::new(2 + i % 3 * 5, 1 + i / 3 * 5);
        let locals = (0..9)
            .map(|i| estimate(&Pool::around(structure.tiles(), &ring, at(i)), settings))
            .collect();
        (locals, estimate(&Pool::of_all(structure.tiles()), settings))
    }
}

struct Statistics {
    bias: f64,
    deviation: f64,
    stated: f64,
    failed: usize,
}

fn statistics(results: &[Result<Roughness, Reason>], truth: f64) -> Statistics {
    let good: Vec<&Roughness> = results.iter().filter_map(|r| r.as_ref().ok()).collect();
    let count = good.len() as f64;
    let mean = good.iter().map(|r| f64::from(r.hurst)).sum::<f64>() / count;
    let square = good
        .iter()
        .map(|r| (f64::from(r.hurst) - mean).powi(2))
        .sum::<f64>()
        / (count - 1.0);
    let stated = good
        .iter()
        .map(|r| f64::from(r.standard_error).powi(2))
        .sum::<f64>()
        / count;
    Statistics {
        bias: mean - truth,
        deviation: square.sqrt(),
        stated: stated.sqrt(),
        failed: results.len() - good.len(),
    }
}

fn trials(hurst: f64, seen: f64, noise: f32, settings: &Settings) -> (Statistics, Statistics) {
    let (mut local, mut whole) = (Vec::new(), Vec::new());
    for seed in 0..8 {
        let (locals, all) = Ground::new(hurst, seen, noise, seed).estimates(settings);
        local.extend(locals);
        whole.push(all);
    }
    (statistics(&local, hurst), statistics(&whole, hurst))
}

#[test]
fn whole_surfaces_have_their_hurst_exponent() {
    let settings = Settings {
        trend: Trend::Keep,
        ..Settings::new(RESOLUTION, STEP)
    };
    for (hurst, tolerance) in [(0.2, 0.01), (0.5, 0.02), (0.8, 0.05)] {
        for (seen, noise) in [(1.0, 0.0), (0.2, 0.02)] {
            let (_, whole) = trials(hurst, seen, noise, &settings);
            assert!(
                whole.bias.abs() < tolerance,
                "H {hurst}: {:+.3} ± {:.3} (stated {:.3})",
                whole.bias,
                whole.deviation,
                whole.stated
            );
            assert_eq!(whole.failed, 0);
        }
    }
}
