//! What the reconstruction reaches on exact fBm, beside the method of 1996. Prints the
//! tables of docs/results-reconstruction.md.
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
    temperatures(129.min(side), surfaces.min(4));
    from_dimension(side, surfaces.min(4));
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

/// Table 3 of the paper: the temperature at which D comes out right (eq. 11).
fn temperatures(side: usize, surfaces: u64) {
    println!("\n## 1996, temperature by trial (eq. 11, Table 3), {side}², 5 % seen, 40 dB");
    println!("| D | temperature / S²(1) | mean abs error of D |\n|---|---|---|");
    for tenth in 2..=8 {
        let d = 2.0 + f64::from(tenth) / 10.0;
        let (mut logs, mut error) = (0.0, 0.0);
        for seed in 0..surfaces {
            let scene = Scene::new(side, 3.0 - d, SEEN, 40.0, seed);
            let truth = dimension(&scene.truth, side);
            let (mut low, mut high) = (-12.0f32, 6.0f32);
            let mut off = 0.0;
            for step in 0..7 {
                eprint!(
                    "\rtemperatures: D {d:.1}, surface {} of {surfaces}, step {step}  ",
                    seed + 1
                );
                let middle = 0.5 * (low + high);
                let prior = Prior::empirical(d as f32, middle.exp2());
                off = dimension(&gibbs(&scene, &prior, SWEEPS, seed), side) - truth;
                if off > 0.0 {
                    high = middle
                } else {
                    low = middle
                }
            }
            logs += f64::from(0.5 * (low + high)) / surfaces as f64;
            error += off.abs() / surfaces as f64;
        }
        println!("| {d:.1} | {:.3} | {error:.4} |", logs.exp2());
    }
    eprintln!();
}

/// The paper's Table 4: the temperatures of its finest layer.
const PAPER: [f64; 7] = [4.4e-6, 1.5e-5, 4.5e-5, 1.4e-4, 4.1e-4, 1.3e-3, 3.8e-3];

/// Table 4: temperatures from D (eqs 12–13).
fn from_dimension(side: usize, surfaces: u64) {
    println!(
        "\n## 1996, temperatures from D (eqs 12–13, Table 4), {side}², 5 % seen, 40 dB, κ = {KAPPA}"
    );
    println!(
        "| D | T_0 in the paper | ours, same unit | 1996: abs error of D | pyramid |\n|---|---|---|---|---|"
    );
    for (i, paper) in PAPER.iter().enumerate() {
        let d = 2.2 + 0.1 * i as f64;
        let (mut old, mut new) = (0.0, 0.0);
        for seed in 0..surfaces {
            eprint!(
                "\rfrom dimension: D {d:.1}, surface {} of {surfaces}  ",
                seed + 1
            );
            let scene = Scene::new(side, 3.0 - d, SEEN, 40.0, seed);
            let truth = dimension(&scene.truth, side);
            let prior = Prior::from_dimension(d as f32, KAPPA);
            old += (dimension(&gibbs(&scene, &prior, SWEEPS, seed), side) - truth).abs();
            new += (dimension(&scene.realisation(20, &mut rng(seed)), side) - truth).abs();
        }
        // in units of the paper's variance at the coarsest scale, matched at D = 2.5
        let law = |d: f64| 2f64.powf(-16.0 * (3.0 - d));
        let ours = PAPER[3] * law(d) / law(2.5);
        let share = 1.0 / surfaces as f64;
        println!(
            "| {d:.1} | {paper:.1e} | {ours:.1e} | {:.4} | {:.4} |",
            old * share,
            new * share
        );
    }
    eprintln!();
}

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
    let warm = best(|| {
        posterior.observe(&levels, scene.datum());
        posterior.step(2);
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
    let time = best_of(2, || {
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
