//! The pyramid prior's constants: see src/pyramid/levels.rs for the formulas.

#[path = "../src/pyramid/nnls.rs"]
mod nnls;

use std::{collections::BTreeSet, fmt::Write};

/// Levels above the finest one that the tables cover, and Hurst exponents in steps.
const MAX_LEVELS: usize = 12;
const MIN_LEVELS: usize = 4;
const STEPS: usize = 20;

/// Composite kernel of `j` cubic B-spline refinements of a single node.
fn kernel(j: usize) -> Vec<f64> {
    let mut k = vec![1.0];
    for _ in 0..j {
        let mut next = vec![0.0; 2 * k.len() + 3];
        for (i, &v) in k.iter().enumerate() {
            for (m, mask) in [1.0, 4.0, 6.0, 4.0, 1.0].iter().enumerate() {
                next[2 * i + m] += v * mask / 8.0;
            }
        }
        k = next;
    }
    k
}

/// Autocorrelation of the kernel at lag `h` per node, ρ_j(h).
fn rho(kernel: &[f64], j: usize, h: usize) -> f64 {
    let sum: f64 = kernel
        .iter()
        .zip(kernel.iter().skip(h))
        .map(|(a, b)| a * b)
        .sum();
    sum / (1u64 << j) as f64
}

/// The lags of the fit on a grid of 2^levels cells: all directions, up to half of it.
/// (Up to a quarter, the mean at H = 0.9 errs by 1.8 % more than kriging, not 0.9 %.)
fn lags(levels: usize) -> Vec<(usize, usize)> {
    let steps = |first: usize, per_octave: usize| {
        (1..first).chain((0..4 * MAX_LEVELS).map(move |i| {
            let octave = first << (i / per_octave);
            octave + octave * (i % per_octave) / per_octave
        }))
    };
    let half = 1 << (levels - 1);
    let mut all = Vec::new();
    for x in steps(4, 4).take_while(|&x| x <= half) {
        for y in [0].into_iter().chain(steps(4, 2)).take_while(|&y| y <= x) {
            all.push((x, y));
        }
    }
    all
}

/// Level variances, finest first, and the plane's, for E Δz² = |h|^{2H}.
fn calibrate(
    structure: &dyn Fn(usize, usize, usize) -> f64,
    hurst: f64,
    levels: usize,
) -> Vec<f64> {
    let rows: Vec<Vec<f64>> = lags(levels)
        .into_iter()
        .map(|(x, y)| {
            let square = (x * x + y * y) as f64;
            let target = libm::pow(square, hurst);
            (0..levels)
                .map(|j| structure(j, x, y) / target)
                .chain([square / target])
                .collect()
        })
        .collect();
    let n = levels + 1;
    let mut gram = [[0.0; nnls::MAX]; nnls::MAX];
    let mut right = [0.0; nnls::MAX];
    for row in &rows {
        for a in 0..n {
            right[a] += row[a];
            for b in 0..n {
                gram[a][b] += row[a] * row[b];
            }
        }
    }
    nnls::solve(&gram, &right, n).to_vec()
}

/// The tables as Rust source.
pub fn tables() -> String {
    let kernels: Vec<Vec<f64>> = (0..MAX_LEVELS).map(kernel).collect();
    let width = 1 << MAX_LEVELS;
    let mut correlation = vec![vec![f64::NAN; width]; MAX_LEVELS];
    let lengths: BTreeSet<usize> = lags(MAX_LEVELS)
        .into_iter()
        .flat_map(|(x, y)| [x, y])
        .collect();
    for &h in &lengths {
        for (j, row) in correlation.iter_mut().enumerate() {
            row[h] = rho(&kernels[j], j, h);
        }
    }
    let structure = |j: usize, x: usize, y: usize| {
        let r: &[f64] = &correlation[j];
        2.0 * (r[0] * r[0] - r[x] * r[y])
    };
    let mut out = String::new();
    let mut push = |text: std::fmt::Arguments| out.write_fmt(text).expect("a String takes all");
    push(format_args!(
        "const MIN_LEVELS: usize = {MIN_LEVELS};\nconst STEPS: usize = {STEPS};\n\
         /// Most levels a pyramid can have.\npub const MAX_LEVELS: usize = {MAX_LEVELS};\n\
         static POWER: [f32; {}] = [\n",
        (STEPS + 1) * (MIN_LEVELS..=MAX_LEVELS).map(|l| l + 1).sum::<usize>()
    ));
    for levels in MIN_LEVELS..=MAX_LEVELS {
        for step in 0..=STEPS {
            let hurst = (step as f64 / STEPS as f64).clamp(0.01, 0.99);
            let fit = calibrate(&structure, hurst, levels);
            for (j, variance) in fit.iter().enumerate().take(levels) {
                let share = (variance * libm::pow(4.0, -hurst * j as f64)) as f32;
                push(format_args!("{share:?}, "));
            }
            let octaves = levels as f64;
            let slope = (fit[levels] * libm::pow(4.0, (1.0 - hurst) * octaves)) as f32;
            push(format_args!("{slope:?},\n"));
        }
    }
    push(format_args!("];\n"));
    let distances: Vec<usize> = lengths.into_iter().filter(|&h| h > 0).collect();
    push(format_args!(
        "/// Lags along an axis at which the levels' structure functions are tabulated.\n\
         static LAGS: [u16; {0}] = {distances:?};\n\
         static STRUCTURE: [[f32; {0}]; MAX_LEVELS] = [\n",
        distances.len()
    ));
    for j in 0..MAX_LEVELS {
        let row: Vec<f32> = distances
            .iter()
            .map(|&d| structure(j, d, 0) as f32)
            .collect();
        push(format_args!("{row:?},\n"));
    }
    push(format_args!("];\n"));
    out
}
