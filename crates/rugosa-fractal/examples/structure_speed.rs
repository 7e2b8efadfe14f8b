//! What the counters of the structure function cost: nanoseconds per changed cell, row by
//! row and pair by pair, on a map like that of a spinning lidar and on a full one.
//!
//! `cargo run --release -p rugosa-fractal --example structure_speed [--features simd]`

use rugosa_fractal::roughness::{Block, StructureFunction, TileSums};
use rugosa_grid::{Cell, Sample, Window};
use std::time::Instant;

const SIDE: usize = 257;

/// 9 848 of 66 049 cells in rings around the middle, as a spinning scanner sees them.
fn rings(cell: Cell) -> bool {
    let radius = f64::from(cell.x).hypot(f64::from(cell.y));
    let seen = radius / (4.0 + 0.045 * radius * radius);
    (8.0..75.0).contains(&radius) && (f64::from(noise(cell)) / 65_536.0) < 8.5 * seen.min(0.117)
}

fn noise(cell: Cell) -> u16 {
    let mut h =
        (cell.x as u32).wrapping_mul(0x9e37_79b1) ^ (cell.y as u32).wrapping_mul(0x85eb_ca77);
    h ^= h >> 15;
    h = h.wrapping_mul(0x2c1b_3c6d);
    (h >> 13) as u16
}

fn sample(cell: Cell) -> Sample {
    let wave = 300.0 * (f64::from(cell.x) * 0.08).sin() + 100.0 * (f64::from(cell.y) * 0.2).cos();
    let n = noise(cell);
    Sample::measured(
        wave as i16 + (n % 32) as i16,
        400,
        (n % 65) as i8 - 32,
        (n / 65 % 65) as i8 - 32,
        0,
    )
}

fn main() {
    let mut tiles = vec![TileSums::default(); StructureFunction::tiles_needed(SIDE)];
    let mut block = Block::new();
    let window = Window::around(SIDE, Cell::new(0, 0));
    for (name, seen) in [("rings", rings as fn(Cell) -> bool), ("full", |_| true)] {
        let mut best = f64::INFINITY;
        let mut report = Default::default();
        for _ in 0..15 {
            let mut samples = vec![Sample::default(); SIDE * SIDE];
            let mut structure = StructureFunction::new(SIDE, &mut tiles, &mut block);
            let start = Instant::now();
            for cell in window.cells().filter(|&cell| seen(cell)) {
                let slot = window.slot(cell).unwrap();
                let old = core::mem::replace(&mut samples[slot], sample(cell));
                structure.replaced(&window, &samples, cell, &old);
            }
            let filled = start.elapsed().as_secs_f64();
            report = structure.commit(&window, &mut samples);
            let all = start.elapsed().as_secs_f64();
            if all - filled < best {
                best = all - filled;
                println!("  fill {:.3} ms commit {:.3} ms", filled * 1e3, best * 1e3);
            }
        }
        let ns = best * 1e9;
        println!(
            "{name}: {report:?}, {:.3} ms, {:.0} ns per cell, {:.0} ns per tile",
            best * 1e3,
            ns / f64::from(report.added),
            ns / f64::from(report.recomputed)
        );
    }
}
