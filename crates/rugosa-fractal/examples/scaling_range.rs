//! Monte Carlo comparison of the scaling-range methods on curves of 40 lags: median and
//! 10 %–90 % quantiles of the number of points found. H = 0.8, break at 13.
//!
//! `cargo run --release -p rugosa-fractal --features std --example scaling_range [-- DRAWS]`

use rand_core::{Rng, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;
use rugosa_fractal::roughness::scaling_range::{Method, fang, robust, scaling_range};

const LAGS: usize = 40;
const BREAK: f64 = 13.0;
const HURST: f64 = 0.8;

type Curve = fn(f64) -> f64;

fn main() {
    let draws: usize = std::env::args()
        .nth(1)
        .map_or(400, |a| a.parse().expect("a number"));
    let curves: [(&str, Curve, f64, bool); 11] = [
        ("pure line, 0", line, 0.0, false),
        ("pure line, iid 1 %", line, 0.01, false),
        ("pure line, iid 3 %", line, 0.03, false),
        ("pure line, correlated 1 %", line, 0.01, true),
        ("line then flat, 0", flat, 0.0, false),
        ("line then flat, 1 %", flat, 0.01, false),
        ("line then flat, 3 %", flat, 0.03, false),
        ("line then slope/4, 3 %", quarter, 0.03, false),
        ("line then downturn, 1 %", downturn, 0.01, false),
        ("smooth saturation, 1 %", saturation, 0.01, false),
        (
            "smooth saturation, 1 %, tolerance 4 %",
            saturation,
            0.01,
            false,
        ),
    ];
    println!(
        "| curve, noise on ln E | Fang, literal | Fang, guarded | elongation | polyline | least squares | robust |"
    );
    println!("|---|---|---|---|---|---|---|");
    for (name, curve, noise, correlated) in curves {
        eprint!("\r{name}            ");
        let tolerance = if name.contains("4 %") { 0.04 } else { 0.02 };
        print_row(
            name,
            curve,
            noise,
            correlated,
            tolerance,
            if noise > 0.0 { draws } else { 1 },
        );
    }
    eprintln!();
}

fn print_row(name: &str, curve: Curve, noise: f64, correlated: bool, tolerance: f64, draws: usize) {
    let mut random = Xoshiro256PlusPlus::seed_from_u64(7);
    let x: Vec<f64> = (1..=LAGS).map(|i| (i as f64).ln()).collect();
    let mut found = [const { Vec::new() }; 6];
    for _ in 0..draws {
        let noise = noises(noise, correlated, &mut random);
        let y: Vec<f64> = x
            .iter()
            .zip(noise)
            .map(|(x, n)| curve(x.exp()) + n)
            .collect();
        let points = |method| scaling_range(&x, &y, method).map_or(0, |range| range.points());
        let all = [
            fang(&x, &y, false).points,
            fang(&x, &y, true).points,
            points(Method::Elongation),
            points(Method::Polyline {
                tolerance: 2.0 * tolerance,
            }),
            points(Method::LeastSquares { tolerance }),
            robust(&x, &y, tolerance).points,
        ];
        found
            .iter_mut()
            .zip(all)
            .for_each(|(found, n)| found.push(n));
    }
    let cells: Vec<String> = found.iter_mut().map(|found| quantiles(found)).collect();
    println!("| {name} | {} |", cells.join(" | "));
}

fn quantiles(found: &mut [usize]) -> String {
    found.sort_unstable();
    let at = |q: f64| found[((found.len() - 1) as f64 * q).round() as usize];
    if at(0.1) == at(0.9) {
        format!("{}", at(0.5))
    } else {
        format!("{} [{}–{}]", at(0.5), at(0.1), at(0.9))
    }
}

/// Independent noise, or a moving average over five lags of the same deviation.
fn noises(std: f64, correlated: bool, random: &mut Xoshiro256PlusPlus) -> Vec<f64> {
    let mut uniform = || 1.0 - (random.next_u64() >> 11) as f64 / (1u64 << 53) as f64;
    let mut normal = || (-2.0 * uniform().ln()).sqrt() * (std::f64::consts::TAU * uniform()).cos();
    let white: Vec<f64> = (0..LAGS + 4).map(|_| std * normal()).collect();
    let width = if correlated { 5 } else { 1 };
    (0..LAGS)
        .map(|i| white[i..i + width].iter().sum::<f64>() / (width as f64).sqrt())
        .collect()
}

fn line(d: f64) -> f64 {
    HURST * d.ln()
}

fn flat(d: f64) -> f64 {
    HURST * d.min(BREAK).ln()
}

fn quarter(d: f64) -> f64 {
    flat(d) + HURST / 4.0 * (d / BREAK).max(1.0).ln()
}

fn downturn(d: f64) -> f64 {
    let beyond = (d / BREAK).max(1.0).ln();
    flat(d) - 0.8 * beyond * beyond
}

fn saturation(d: f64) -> f64 {
    0.5 * (1.0 - (-(d / BREAK).powf(2.0 * HURST)).exp()).ln()
}
