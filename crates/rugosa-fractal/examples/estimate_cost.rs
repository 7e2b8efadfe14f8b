//! One estimate after another from the pools of a full 65² map, to be counted:
//! `valgrind --tool=callgrind --toggle-collect='*estimate_all*' target/release/examples/estimate_cost`
//! gives the instructions of 81 tiles (x86; a Cortex-M4F needs about as many).

use rugosa_fractal::roughness::{
    Block, Pool, Roughness, Settings, StructureFunction, TileSums, estimate,
};
use rugosa_grid::{Cell, Sample, Tiles, Window};

const SIDE: usize = 65;

fn main() {
    let mut tiles = vec![TileSums::default(); StructureFunction::tiles_needed(SIDE)];
    let mut block = Block::new();
    let mut structure = StructureFunction::new(SIDE, &mut tiles, &mut block);
    let window = Window::new(SIDE, Cell::new(0, 0));
    let mut samples = vec![Sample::default(); SIDE * SIDE];
    let (mut seed, mut height) = (1u32, 0i16);
    for cell in window.cells() {
        seed = seed.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
        height = height / 8 * 7 + (seed >> 26) as i16 - 32;
        samples[window.slot(cell).unwrap()] = Sample::measured(height, 9, 0, 0, 0);
        structure.replaced(&window, &samples, cell, &Sample::default());
    }
    structure.commit(&window, &mut samples);
    let found = estimate_all(&window, structure.tiles());
    println!("{} of 81 tiles have a roughness", found);
}

#[inline(never)]
fn estimate_all(window: &Window, sums: &[TileSums]) -> usize {
    let ring = Tiles::of(window);
    let settings = Settings::new(0.1, 0.0005);
    let all = ring
        .tiles()
        .map(|tile| estimate(&Pool::around(sums, &ring, tile), &settings));
    all.filter(|r| matches!(r, Ok(Roughness { .. }))).count()
}
