//! Accuracy of the dimension of irregular points: 5 % of the nodes of exact 512² surfaces,
//! lags 2–30, for D = 2.1 … 2.9, without noise and at 30, 25, 20 and 10 dB, noise known and
//! fitted. Prints the tables of docs/results-roughness.md.
//!
//! `cargo run --release -p rugosa-fractal --features std --example accuracy [-- SURFACES [SIDE [FIRST]]]`
//!
//! FIRST: number of the first pair of surfaces, 0 unless given; another gives other surfaces.

use rand_core::{Rng, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;
use rugosa_fractal::roughness::Method;
use rugosa_fractal::roughness::irregular::{Noise, Options, estimate_points};
use rugosa_fractal::roughness::scaling_range;
use rugosa_fractal::synthesis::exact_fbm_pair;

const DIMENSIONS: [f64; 9] = [2.1, 2.2, 2.3, 2.4, 2.5, 2.6, 2.7, 2.8, 2.9];

/// SNR in dB (none: infinite) and whether the noise is known.
const CASES: [(Option<f64>, bool); 10] = [
    (None, true),
    (None, false),
    (Some(30.0), true),
    (Some(30.0), false),
    (Some(25.0), true),
    (Some(25.0), false),
    (Some(20.0), true),
    (Some(20.0), false),
    (Some(10.0), true),
    (Some(10.0), false),
];

fn main() {
    let mut arguments = std::env::args()
        .skip(1)
        .map(|a| a.parse().expect("a number"));
    let surfaces: usize = arguments.next().unwrap_or(20);
    let side: usize = arguments.next().unwrap_or(512);
    let first: usize = arguments.next().unwrap_or(0);
    let estimators = [
        (
            "Pentland, all lags",
            Method::Pentland,
            scaling_range::Method::Whole,
        ),
        (
            "Yokoya, all lags",
            Method::Yokoya,
            scaling_range::Method::Whole,
        ),
        (
            "Pentland, robust range",
            Method::Pentland,
            scaling_range::Method::default(),
        ),
    ];
    let mut errors = vec![vec![vec![Vec::new(); DIMENSIONS.len()]; CASES.len()]; estimators.len()];
    for (d, dimension) in DIMENSIONS.iter().enumerate() {
        for pair in first..first + surfaces.div_ceil(2) {
            eprint!("\rD {dimension}: {} of {surfaces} ", 2 * (pair - first));
            for (half, heights) in exact_fbm_pair(side, 3.0 - dimension, 1000 + pair as u64)
                .iter()
                .enumerate()
            {
                let mut random =
                    Xoshiro256PlusPlus::seed_from_u64((1000 * d + 2 * pair + half) as u64);
                let points = sample(heights, side, &mut random);
                for (c, &(snr, known)) in CASES.iter().enumerate() {
                    let (noisy, std) = with_noise(&points, snr, &mut random.clone());
                    let noise = if known {
                        Noise::Known(std)
                    } else {
                        Noise::Fitted
                    };
                    for (e, &(_, method, range)) in estimators.iter().enumerate() {
                        let options = Options {
                            min_lag: Some(2.0),
                            max_lag: Some(30.0),
                            noise,
                            method,
                            range,
                        };
                        let law = estimate_points(&noisy, &options).law;
                        errors[e][c][d]
                            .push(law.map(|law| (law.dimension - dimension, law.standard_error)));
                    }
                }
            }
        }
    }
    eprintln!();
    for (errors, (name, ..)) in errors.iter().zip(estimators) {
        println!("\n{name}: bias ± deviation (stated error / true error)");
        for (errors, (snr, known)) in errors.iter().zip(CASES) {
            print_case(errors, snr, known);
        }
    }
}

type Errors<E> = Vec<Vec<Result<(f64, f64), E>>>;

fn print_case<E: std::fmt::Debug>(errors: &Errors<E>, snr: Option<f64>, known: bool) {
    let snr = snr.map_or("∞".into(), |snr| format!("{snr}"));
    print!(
        "{snr:>3} dB noise {:6}",
        if known { "known" } else { "fitted" }
    );
    let (mut biases, mut squares, mut failed) = (0.0, 0.0, 0);
    let (mut all_stated, mut all_true) = (0.0, 0.0);
    for errors in errors {
        let good: Vec<(f64, f64)> = errors
            .iter()
            .filter_map(|e| e.as_ref().ok().copied())
            .collect();
        failed += errors.len() - good.len();
        let n = good.len() as f64;
        let bias = good.iter().map(|e| e.0).sum::<f64>() / n;
        let square = good.iter().map(|e| e.0 * e.0).sum::<f64>() / n;
        let stated = (good.iter().map(|e| e.1 * e.1).sum::<f64>() / n).sqrt();
        let deviation = ((square - bias * bias) * n / (n - 1.0)).sqrt();
        print!(" {bias:+.3}±{deviation:.3}({:.2})", stated / deviation);
        all_stated += stated * stated;
        all_true += deviation * deviation;
        biases += bias.abs() / DIMENSIONS.len() as f64;
        squares += square / DIMENSIONS.len() as f64;
    }
    println!(
        " | mean |bias| {biases:.4} rms {:.4} stated / true {:.2} failed {failed}",
        squares.sqrt(),
        (all_stated / all_true).sqrt()
    );
}

/// 5 % of the nodes.
fn sample(heights: &[f32], side: usize, random: &mut Xoshiro256PlusPlus) -> Vec<[f64; 3]> {
    let mut nodes: Vec<usize> = (0..side * side).collect();
    let count = side * side / 20;
    for i in 0..count {
        let j = i + (random.next_u64() % (nodes.len() - i) as u64) as usize;
        nodes.swap(i, j);
    }
    nodes.truncate(count);
    nodes
        .iter()
        .map(|&i| [(i % side) as f64, (i / side) as f64, f64::from(heights[i])])
        .collect()
}

/// Adds white noise of 10^(−SNR/20) of the heights' standard deviation; returns its own.
fn with_noise(
    points: &[[f64; 3]],
    snr: Option<f64>,
    random: &mut Xoshiro256PlusPlus,
) -> (Vec<[f64; 3]>, f64) {
    let n = points.len() as f64;
    let mean = points.iter().map(|p| p[2]).sum::<f64>() / n;
    let variance = points.iter().map(|p| (p[2] - mean).powi(2)).sum::<f64>() / n;
    let std = snr.map_or(0.0, |snr| variance.sqrt() * 10f64.powf(-snr / 20.0));
    let mut uniform = || 1.0 - (random.next_u64() >> 11) as f64 / (1u64 << 53) as f64;
    let mut normal = || (-2.0 * uniform().ln()).sqrt() * (std::f64::consts::TAU * uniform()).cos();
    (
        points
            .iter()
            .map(|p| [p[0], p[1], p[2] + std * normal()])
            .collect(),
        std,
    )
}
