//! What the reconstruction reaches on exact fBm: tables of docs/results-reconstruction.md,
//! and times beside the method of 1996.
//!
//! `cargo run --release -p rugosa-fractal --features std --example reconstruction [-- SURFACES [SIDE]]`

#[path = "../tests/scene/mod.rs"]
mod scene;

use rugosa_fractal::ak96::{Ak96, KAPPA, Prior};
use rugosa_fractal::pyramid::{Draws, Levels, Posterior};
use scene::{Scene, dimension, rng, structure};
use std::time::Instant;

/// Share of the cells that are seen.
const SEEN: f32 = 0.05;

fn main() {
    let mut arguments = std::env::args()
        .skip(1)
        .map(|a| a.parse().expect("a number"));
    let surfaces: u64 = arguments.next().unwrap_or(10);
    let side = arguments.next().unwrap_or(257) as usize;
    roughness(side, surfaces);
    honesty(side, surfaces.min(4));
    speed(side);
}

/// |D of a realisation − D of the original| and structure function.
fn roughness(side: usize, surfaces: u64) {
    println!("## Roughness of realisations, {side}², 5 % seen, 20 iterations, {surfaces} surfaces");
    println!(
        "| D | SNR [dB] | mean abs error of D | largest | D of the mean | S² ratio at lags 1, 2, 4, 8 |"
    );
    println!("|---|---|---|---|---|---|");
    for tenth in 1..=9 {
        let d = 2.0 + f64::from(tenth) / 10.0;
        for decibel in [40.0, 20.0] {
            let (mut errors, mut means, mut ratios) = (Vec::new(), 0.0, [0.0; 4]);
            for seed in 0..surfaces {
                eprint!(
                    "\rroughness: D {d:.1}, {decibel} dB, surface {} of {surfaces}  ",
                    seed + 1
                );
                let scene = Scene::new(side, 3.0 - d, SEEN, decibel, seed);
                let z = scene.realisation(20, &mut rng(seed + 100));
                errors.push((dimension(&z, side) - dimension(&scene.truth, side)).abs());
                means += dimension(&scene.mean(20).0, side) / surfaces as f64;
                for (r, lag) in ratios.iter_mut().zip([1, 2, 4, 8]) {
                    let ratio = structure(&z, side, lag) / structure(&scene.truth, side, lag);
                    *r += ratio / surfaces as f64;
                }
            }
            let mean = errors.iter().sum::<f64>() / surfaces as f64;
            let largest = errors.iter().copied().fold(0.0, f64::max);
            let [a, b, c, e] = ratios;
            println!(
                "| {d:.1} | {decibel} | {mean:.4} | {largest:.4} | {means:.3} | {a:.3} {b:.3} {c:.3} {e:.3} |"
            );
        }
    }
    eprintln!();
}

/// Squared error over predicted variance, and coverage of 95 % intervals.
fn honesty(side: usize, surfaces: u64) {
    println!("\n## Honesty, {side}², 5 % seen, 64 draws, {surfaces} surfaces");
    println!("| D | SNR [dB] | error² / variance | inside 95 % |\n|---|---|---|---|");
    for d in [2.2, 2.5, 2.8] {
        for decibel in [40.0, 20.0] {
            let (mut squares, mut variance, mut inside, mut count) = (0.0, 0.0, 0.0, 0.0);
            for seed in 0..surfaces {
                eprint!(
                    "\rhonesty: D {d}, {decibel} dB, surface {} of {surfaces}  ",
                    seed + 1
                );
                let scene = Scene::new(side, 3.0 - d, SEEN, decibel, seed);
                let sd = deviation(&scene);
                let mean = scene.mean(20).0;
                for i in (0..sd.len()).filter(|&i| scene.data[i].is_none()) {
                    let (e, s) = (f64::from(mean[i] - scene.truth[i]), f64::from(sd[i]));
                    squares += e * e;
                    variance += s * s;
                    inside += f64::from(u8::from(e.abs() < 1.96 * s));
                    count += 1.0;
                }
            }
            println!(
                "| {d} | {decibel} | {:.3} | {:.3} |",
                squares / variance,
                inside / count
            );
        }
    }
    eprintln!();
}

fn deviation(scene: &Scene) -> Vec<f32> {
    let mut memory = vec![0.0; Posterior::need(scene.side).unwrap()];
    let mut posterior = Posterior::new(scene.side, &mut memory).unwrap();
    let mut out = vec![0.0; scene.side * scene.side];
    let draws = Draws {
        count: 64,
        iterations: 12,
    };
    posterior.standard_deviation(
        (&scene.levels(), scene.datum()),
        draws,
        &mut rng(5),
        &mut out,
    );
    out
}

/// A surface by the method of 1996: relaxed, then sampled.
fn gibbs(scene: &Scene, prior: &Prior, sweeps: usize, seed: u64) -> Vec<f32> {
    let mut memory = vec![0.0; Ak96::need(scene.side).unwrap()];
    let mut state = Ak96::new(scene.side, &mut memory).unwrap();
    state.observe(scene.datum(), 1e-6);
    let mut rng = rng(seed);
    for _ in 0..sweeps / 4 {
        state.relax(prior);
    }
    for _ in 0..sweeps {
        state.sample(prior, &mut rng);
    }
    let mut out = vec![0.0; scene.side * scene.side];
    state.surface(&mut out);
    out
}

const SWEEPS: usize = 40;

/// Ratios of times, all in this run.
fn speed(side: usize) {
    println!("\n## Speed, one thread");
    let scene = Scene::new(side, 0.5, SEEN, 40.0, 1);
    let mut memory = vec![0.0; Posterior::need(side).unwrap()];
    let mut out = vec![0.0; side * side];
    let levels = scene.levels();
    let mut posterior = Posterior::new(side, &mut memory).unwrap();
    let cold = best(|| {
        posterior.restart();
        posterior.observe(&levels, scene.datum());
        posterior.step(20);
        posterior.mean(&levels, scene.datum(), &mut out);
    });
    let draw = best(|| {
        let mut rng = rng(1);
        posterior.draw((&levels, scene.datum()), 1.0, &mut rng);
        posterior.step(20);
        posterior.realisation((&levels, scene.datum()), 1.0, &mut rng, &mut out);
    });
    posterior.restart();
    posterior.observe(&levels, scene.datum());
    posterior.step(20);
    // a twentieth of the data comes and goes
    let mut sweep = 0;
    let warm = best(|| {
        sweep += 1;
        let fresh = |i: usize| scene.data[i].filter(|_| i % 40 != sweep % 2);
        posterior.observe(&levels, fresh);
        let done = posterior.step(1).iterations;
        assert_eq!(done, 1, "nothing new");
    });
    let step = best(|| {
        posterior.restart();
        posterior.observe(&levels, scene.datum());
        posterior.step(10);
    });
    println!(
        "mean {:.1} ms, realisation {:.1} ms, warm update {:.1} ms ({:.2} of a mean), ten iterations {:.1} ms",
        cold * 1e3,
        draw * 1e3,
        warm * 1e3,
        warm / cold,
        step * 1e3
    );
    let prior = Prior::from_dimension(2.5, KAPPA);
    let old = best_of(1, || drop(gibbs(&scene, &prior, SWEEPS, 1)));
    println!(
        "1996, {SWEEPS} Gibbs sweeps: {:.2} s, {:.0} times a realisation",
        old,
        old / draw
    );
    let per_cell = cold / (side * side) as f64;
    let large = 4 * (side - 1) + 1;
    let big = Scene {
        side: large,
        hurst: 0.5,
        truth: Vec::new(),
        data: (0..large * large)
            .map(|i| scene.data[i * 7 % scene.data.len()])
            .collect(),
    };
    let mut memory = vec![0.0; Posterior::need(large).unwrap()];
    let mut out = vec![0.0; large * large];
    let levels = Levels::power_law(large, 0.5, 1.0).unwrap();
    let mut posterior = Posterior::new(large, &mut memory).unwrap();
    let time = best_of(7, || {
        posterior.restart();
        posterior.observe(&levels, big.datum());
        posterior.step(20);
        posterior.mean(&levels, big.datum(), &mut out);
    });
    println!(
        "cost per cell at {large}²: {:.2} of that at {side}²",
        time / (large * large) as f64 / per_cell
    );
}

fn best(f: impl FnMut()) -> f64 {
    best_of(7, f)
}

/// Shortest of some runs \[s\].
fn best_of(count: usize, mut f: impl FnMut()) -> f64 {
    (0..count)
        .map(|_| {
            let start = Instant::now();
            f();
            start.elapsed().as_secs_f64()
        })
        .fold(f64::INFINITY, f64::min)
}
