//! Times of the surface models and the codec, as ratios within one run.
//!
//! `cargo run --release -p rugosa-fractal --features alloc --example surface_times [-- ifs|fis|codec]`
//!
//! The dense Levenberg–Marquardt is what one writes first: the whole Jacobian, JᵀJ that skips
//! zeros, Cholesky. Both fits run the same seven iterations on crops of the Jacksboro DEM.

use nalgebra::{DMatrix, DVector};
use rugosa_fractal::codec::{self, Precision};
use rugosa_fractal::surfaces::Shape;
use rugosa_fractal::surfaces::ifs::{Ifs, Options, Variant, fit};
use rugosa_fractal::surfaces::rectangular::{Scale, Surface};
use std::hint::black_box;
use std::time::Instant;

fn crop(row: usize, column: usize, side: usize) -> Vec<f32> {
    let path = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../../tests/data/jacksboro.npy"
    );
    let bytes = std::fs::read(path).expect("tests/data/jacksboro.npy");
    let body = bytes[bytes.len() - 344 * 403 * 4..].as_chunks::<4>().0;
    let at = |i: usize| f32::from_le_bytes(body[(row + i / side) * 403 + column + i % side]);
    (0..side * side).map(at).collect()
}

/// The least of `runs` times [s].
fn least(runs: u32, mut work: impl FnMut()) -> f64 {
    (0..runs)
        .map(|_| {
            let start = Instant::now();
            work();
            start.elapsed().as_secs_f64()
        })
        .fold(f64::MAX, f64::min)
}

fn main() {
    let wanted = std::env::args().nth(1);
    let parts: [(&str, fn()); 3] = [("ifs", fitting), ("fis", interpolation), ("codec", coding)];
    for (name, part) in parts {
        if wanted.as_deref().is_none_or(|w| w == name) {
            part();
        }
    }
}

/// Structured against dense Levenberg–Marquardt.
fn fitting() {
    for (depth, side, runs) in [(4, 82, 3), (5, 244, 1)] {
        let data: Vec<f64> = crop(50, 60, side).into_iter().map(f64::from).collect();
        let options = Options {
            iterations: 7,
            tolerance: 0.0,
            ..Options::default()
        };
        let mut found = 0.0;
        let structured = least(runs, || {
            found = *fit(&data, &options, &[], &mut |_| {})
                .expect("a fit")
                .psnr
                .last()
                .expect("a start");
        });
        let mut dense_found = 0.0;
        let dense = least(runs, || dense_found = dense_fit(&data, depth));
        println!(
            "projected IFS, {side}², 7 iterations: structured {structured:.4} s ({found:.2} dB), dense {dense:.4} s ({dense_found:.2} dB), ratio {:.2}",
            structured / dense
        );
    }
}

/// Seven Levenberg–Marquardt iterations with the dense Jacobian, ridge 1e-5.
fn dense_fit(data: &[f64], depth: u32) -> f64 {
    let (low, high) = data
        .iter()
        .fold((f64::MAX, f64::MIN), |m, v| (m.0.min(*v), m.1.max(*v)));
    let unit: Vec<f64> = data.iter().map(|v| (v - low) / (high - low)).collect();
    let side = (unit.len() as f64).sqrt() as usize;
    let step = (side - 1) / 3;
    let mut ifs = Ifs::bilinear(
        Variant::Tied,
        &core::array::from_fn(|i| unit[i / 4 * step * side + i % 4 * step]),
    );
    let prior = ifs.parameters().to_vec();
    let penalty = 1e-5 * unit.len() as f64;
    let cost = |ifs: &Ifs| -> f64 {
        let squares: f64 = ifs
            .tabulate(depth)
            .iter()
            .zip(&unit)
            .map(|(a, b)| (a - b) * (a - b))
            .sum();
        squares
            + penalty
                * ifs
                    .parameters()
                    .iter()
                    .zip(&prior)
                    .skip(16)
                    .map(|(w, p)| (w - p) * (w - p))
                    .sum::<f64>()
    };
    let (mut now, mut damping) = (cost(&ifs), 1e-3);
    for _ in 0..7 {
        let (matrix, right) = dense_equations(&ifs, depth, &unit, (penalty, &prior));
        let largest = matrix.diagonal().max();
        let diagonal = matrix.diagonal().map(|d| d.max(1e-9 * largest));
        for _ in 0..12 {
            let mut damped = matrix.clone();
            damped.set_diagonal(&(matrix.diagonal() + damping * &diagonal));
            let Some(factor) = damped.cholesky() else {
                break;
            };
            let delta = factor.solve(&right);
            let next = ifs
                .parameters()
                .iter()
                .zip(delta.iter())
                .map(|(p, d)| p + d)
                .collect();
            let next = Ifs::from_parameters(Variant::Tied, next).expect("finite");
            let next_cost = cost(&next);
            if next_cost < now {
                let predicted = delta.dot(&(damping * delta.component_mul(&diagonal) + &right));
                let factor = 2.0 * (now - next_cost) / predicted - 1.0;
                damping *= (1.0 - factor * factor * factor).max(0.1);
                (ifs, now) = (next, next_cost);
                break;
            }
            damping *= 4.0;
        }
    }
    let squares: f64 = ifs
        .tabulate(depth)
        .iter()
        .zip(&unit)
        .map(|(a, b)| (a - b) * (a - b))
        .sum();
    -10.0 * (squares / unit.len() as f64).log10()
}

fn dense_equations(
    ifs: &Ifs,
    depth: u32,
    unit: &[f64],
    (penalty, prior): (f64, &[f64]),
) -> (DMatrix<f64>, DVector<f64>) {
    let count = ifs.parameters().len();
    let (table, rows) = ifs.jacobian(depth);
    let (mut matrix, mut right) = (DMatrix::zeros(count, count), DVector::zeros(count));
    for ((row, t), z) in rows.chunks(count).zip(&table).zip(unit) {
        for (j, &value) in row.iter().enumerate().filter(|(_, v)| **v != 0.0) {
            right[j] += value * (z - t);
            let column = &mut matrix.as_mut_slice()[j * count + j..(j + 1) * count];
            column
                .iter_mut()
                .zip(&row[j..])
                .for_each(|(m, v)| *m += value * v);
        }
    }
    matrix.fill_upper_triangle_with_lower_triangle();
    for i in 16..count {
        matrix[(i, i)] += penalty;
        right[i] -= penalty * (ifs.parameters()[i] - prior[i]);
    }
    (matrix, right)
}

fn interpolation() {
    let truth = crop(0, 0, 257);
    for step in [8, 16] {
        let n = 256 / step + 1;
        let nodes: Vec<f32> = (0..n * n)
            .map(|i| truth[i / n * step * 257 + i % n * step])
            .collect();
        let surface = Surface::new(
            &nodes,
            Shape::new(n, n),
            (step, step),
            Scale::Constant(0.05),
        )
        .expect("valid");
        let mut out = vec![0.0; 257 * 257];
        let flat = least(200, || surface.write_bilinear(black_box(&mut out)));
        let fractal = least(200, || {
            surface.evaluate(black_box(&mut out)).expect("large enough");
        });
        println!(
            "fractal interpolation, 257² from every {step}th node: {:.3} ms, bilinear {:.3} ms, ratio {:.2}",
            fractal * 1e3,
            flat * 1e3,
            fractal / flat
        );
    }
}

fn coding() {
    let heights = crop(0, 0, 257);
    let shape = Shape::new(257, 257);
    let cells = shape.len() as f64;
    let (mut work, mut out, mut back) = (
        vec![0; shape.len()],
        vec![0; 8 * shape.len()],
        vec![0.0; shape.len()],
    );
    // the steps that give the bytes of 17² and 33² samples
    let mut step_of = |bytes| {
        codec::encode_to_size(&heights, shape, bytes, (&mut work, &mut out)).expect("fits");
        64.0 * codec::Header::read(&out).expect("a header").quantum
    };
    let steps = [step_of(586), step_of(2186)];
    for precision in [
        Precision::Step(steps[0]),
        Precision::Step(steps[1]),
        Precision::Step(30.0),
        Precision::Within(5.0),
        Precision::Within(0.5),
        Precision::Quick(5.0),
        Precision::Quick(0.5),
    ] {
        let mut told = None;
        let encode = least(40, || {
            told = Some(
                codec::encode(black_box(&heights), shape, precision, (&mut work, &mut out))
                    .expect("fits"),
            );
        });
        let told = told.expect("40 runs");
        let decode = least(40, || {
            codec::decode(black_box(&out[..told.bytes]), (&mut work, &mut back)).expect("good");
        });
        println!(
            "codec, 257², {precision:?}: {} bytes, largest error {:.2} m, encode {:.1} ns per cell, decode {:.1} ns per cell",
            told.bytes,
            told.max_error,
            encode / cells * 1e9,
            decode / cells * 1e9
        );
    }
}
