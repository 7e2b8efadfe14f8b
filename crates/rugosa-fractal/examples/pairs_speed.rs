//! Time of the structure function of irregular points, against a plain cell list with a
//! square root per pair, in one run: lags 2–30 on a 512 × 512 region.
//!
//! `cargo run --release -p rugosa-fractal --features std --example pairs_speed`

use rand_core::{Rng, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;
use rugosa_fractal::roughness::irregular::pairs::{Bins, sums};
use rugosa_fractal::roughness::irregular::{Options, estimate_points};
use std::time::Instant;

const BINS: Bins = Bins {
    low: 1.5,
    width: 1.0,
    count: 29,
};

fn main() {
    for count in [10_000, 19_600] {
        let mut random = Xoshiro256PlusPlus::seed_from_u64(count);
        let mut place = || (random.next_u64() % 512) as f64;
        let points: Vec<[f64; 3]> = (0..count)
            .map(|_| [place(), place(), place() / 100.0])
            .collect();
        let options = Options {
            min_lag: Some(2.0),
            max_lag: Some(30.0),
            ..Options::default()
        };
        let [mut whole, mut ours, mut plain] = [f64::INFINITY; 3];
        for _ in 0..9 {
            whole = whole.min(time(|| drop(estimate_points(&points, &options))));
            ours = ours.min(time(|| assert!(sums(&points, &BINS)[0].pairs > 0.0)));
            plain = plain.min(time(|| assert!(cell_list(&points)[0][0] > 0.0)));
        }
        let pairs: f64 = sums(&points, &BINS).iter().map(|s| s.pairs).sum();
        let listed: f64 = cell_list(&points).iter().map(|s| s[0]).sum();
        assert_eq!(pairs, listed);
        println!(
            "{count} points, {pairs} pairs: whole estimate {:.2} ms, sums {:.2} ms ({:.1} ns per pair), plain cell list {:.2} ms, ratio {:.2}",
            whole * 1e3,
            ours * 1e3,
            ours / pairs * 1e9,
            plain * 1e3,
            plain / whole
        );
    }
}

fn time(run: impl FnOnce()) -> f64 {
    let start = Instant::now();
    run();
    start.elapsed().as_secs_f64()
}

/// The textbook cell list: cells as large as the greatest lag, linked by index.
fn cell_list(points: &[[f64; 3]]) -> Vec<[f64; 4]> {
    let reach = BINS.high();
    let side = (512.0 / reach) as usize + 1;
    let mut cells = vec![Vec::new(); side * side];
    for p in points {
        cells[(p[1] / reach) as usize * side + (p[0] / reach) as usize].push(*p);
    }
    let mut sums = vec![[0.0; 4]; BINS.count];
    for (at, cell) in cells.iter().enumerate() {
        for (i, p) in cell.iter().enumerate() {
            cell[i + 1..].iter().for_each(|q| add(&mut sums, p, q));
            for (dx, dy) in [(1, 0), (-1, 1), (0, 1), (1, 1)] {
                let (column, row) = ((at % side) as isize + dx, at / side + dy);
                if (0..side as isize).contains(&column) && row < side {
                    cells[row * side + column as usize]
                        .iter()
                        .for_each(|q| add(&mut sums, p, q));
                }
            }
        }
    }
    sums
}

#[inline]
fn add(sums: &mut [[f64; 4]], p: &[f64; 3], q: &[f64; 3]) {
    let (dx, dy) = (p[0] - q[0], p[1] - q[1]);
    let square = dx * dx + dy * dy;
    if square >= BINS.low * BINS.low && square < BINS.high() * BINS.high() {
        let dz = (p[2] - q[2]).abs();
        let sum = &mut sums[((square.sqrt() - BINS.low) / BINS.width) as usize];
        *sum = [sum[0] + 1.0, sum[1] + dz, sum[2] + dz * dz, sum[3] + square];
    }
}
