//! Tests of the on-board estimate on exact surfaces.

extern crate std;
use super::*;
use crate::synthesis::exact_fbm_pair;
use rand_core::{Rng, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;
use rugosa_grid::{Cell, Sample, Tile, Tiles, Window};
use std::vec;
use std::vec::Vec;

const SIDE: usize = 129;
const SURFACES: u64 = 10;
const STEP: f32 = 0.0005;
const RESOLUTION: f32 = 0.1;

/// A fully or partly seen surface: σ = 0.1 m at 1 m, heights in steps.
struct Ground {
    window: Window,
    samples: Vec<Sample>,
}

impl Ground {
    fn new(heights: &[f32], hurst: f64, (seen, noise): (f64, f32), seed: u64) -> Self {
        let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
        let scale = 0.1 * f64::from(RESOLUTION).powf(hurst);
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

fn surfaces(hurst: f64) -> Vec<Vec<f32>> {
    (0..SURFACES / 2)
        .flat_map(|seed| exact_fbm_pair(SIDE, hurst, seed))
        .collect()
}

/// Local and whole estimates of surfaces of which a part is seen, with some noise.
fn trials(
    surfaces: &[Vec<f32>],
    hurst: f64,
    seen: (f64, f32),
    settings: &Settings,
) -> [Statistics; 2] {
    let (mut local, mut whole) = (Vec::new(), Vec::new());
    for (seed, heights) in surfaces.iter().enumerate() {
        let (locals, all) = Ground::new(heights, hurst, seen, seed as u64).estimates(settings);
        local.extend(locals);
        whole.push(all);
    }
    [statistics(&local, hurst), statistics(&whole, hurst)]
}

#[test]
fn whole_surfaces_have_their_hurst_exponent() {
    let settings = Settings::new(RESOLUTION, STEP);
    for (hurst, tolerance) in [(0.2, 0.01), (0.5, 0.02), (0.8, 0.05)] {
        let surfaces = surfaces(hurst);
        for seen in [(1.0, 0.0), (0.2, 0.02)] {
            let [_, whole] = trials(&surfaces, hurst, seen, &settings);
            let Statistics {
                bias, deviation, ..
            } = whole;
            assert!(
                bias.abs() < tolerance,
                "H {hurst}: {bias:+.3} ± {deviation:.3}"
            );
            assert_eq!(whole.failed, 0);
        }
    }
}

#[test]
fn stated_errors_are_right_within_30_percent() {
    let settings = Settings {
        trend: Trend::Keep,
        ..Settings::new(RESOLUTION, STEP)
    };
    for hurst in [0.1, 0.3, 0.5, 0.7, 0.9] {
        let surfaces = surfaces(hurst);
        for (seen, noise) in [(1.0, 0.0), (0.3, 0.02), (0.1, 0.0)] {
            let [local, _] = trials(&surfaces, hurst, (seen, noise), &settings);
            let Statistics {
                bias,
                deviation,
                stated,
                failed,
            } = local;
            let ratio = stated / deviation;
            std::println!(
                "seen {seen} noise {noise} H {hurst}: {bias:+.3} ± {deviation:.3}, stated × {ratio:.2}"
            );
            assert!(
                (0.7..1.43).contains(&ratio),
                "seen {seen} H {hurst}: stated × {ratio:.2}"
            );
            assert!(failed <= 2);
        }
    }
}

#[test]
fn the_tilt_of_smooth_surfaces_is_kept() {
    let settings = Settings::new(RESOLUTION, STEP);
    for hurst in [0.3, 0.6, 0.9] {
        let mut flattened = 0;
        for heights in surfaces(hurst) {
            let (locals, _) = Ground::new(&heights, hurst, (1.0, 0.0), 1).estimates(&settings);
            flattened += locals.into_iter().flatten().filter(|r| r.detrended).count();
        }
        assert!(flattened <= 3, "H {hurst}: {flattened} of {}", 9 * SURFACES);
    }
}

#[test]
fn the_tilt_of_a_rough_slope_is_taken_off() {
    let keep = Settings {
        trend: Trend::Keep,
        ..Settings::new(RESOLUTION, STEP)
    };
    let settings = Settings::new(RESOLUTION, STEP);
    let mut ground = Ground::new(&exact_fbm_pair(SIDE, 0.3, 5)[0], 0.3, (1.0, 0.0), 5);
    for cell in ground.window.cells() {
        let sample = &mut ground.samples[ground.window.slot(cell).unwrap()];
        let slope = (0.6 * RESOLUTION / STEP * cell.x as f32) as i16;
        *sample = Sample::measured(sample.height + slope, 0, 0, 0, 0);
    }
    let kept = ground.estimates(&keep).1.map_or(1.0, |r| r.hurst);
    let fresh = ground
        .samples
        .iter()
        .map(|s| Sample::measured(s.height, 0, 0, 0, 0))
        .collect();
    ground.samples = fresh;
    let taken = ground.estimates(&settings).1.unwrap();
    assert!(kept > 0.6 && taken.detrended);
    assert!((taken.hurst - 0.3).abs() < 0.05, "{taken:?}");
}

#[test]
fn noise_is_accounted_for_with_both_moments() {
    let surfaces = surfaces(0.5);
    for method in [Method::Pentland, Method::Yokoya] {
        let settings = Settings {
            method,
            ..Settings::new(RESOLUTION, STEP)
        };
        let [_, whole] = trials(&surfaces, 0.5, (0.5, 0.03), &settings);
        assert!(whole.bias.abs() < 0.03, "{method:?} {:+.3}", whole.bias);
    }
}

#[test]
fn nothing_is_made_up() {
    let settings = Settings::new(RESOLUTION, STEP);
    assert_eq!(estimate(&Pool::new(), &settings), Err(Reason::TooFewPairs));
    let flat = |noise: u16| {
        let samples = vec![Sample::measured(40, noise, 0, 0, 0); SIDE * SIDE];
        Ground {
            window: Window::new(SIDE, Cell::new(0, 0)),
            samples,
        }
        .estimates(&settings)
        .1
    };
    assert_eq!(flat(0), Err(Reason::Noise));
    assert_eq!(flat(9), Err(Reason::Noise));
}
