//! What the parts of a reconstruction cost, in exact instructions.
//!
//! A map of which every third cell is measured, at random places, on ground that is as
//! rough as the prior says; one line of log with the costs of taking the data in, of one
//! iteration and of the mean, and the residual after ten iterations in parts per
//! million. Ends with exit code 0, or 101.
#![no_std]
#![no_main]

use board::Board;
use core::panic::PanicInfo;
use cortex_m_rt::entry;
use rugosa_app::platform::Platform;
use rugosa_app::{design_parameters::SIDE, memory};
use rugosa_fractal::pyramid::{Datum, Levels, Posterior};
use semihosting::process;

const ITERATIONS: usize = 10;

#[panic_handler]
fn panic(_: &PanicInfo) -> ! {
    process::exit(101)
}

#[entry]
fn main() -> ! {
    let Some(mut board) = Board::start() else {
        process::exit(101)
    };
    let planes = memory::take();
    let (Ok(prior), Ok(posterior)) = (
        Levels::power_law(SIDE, 0.5, 0.05),
        Posterior::new(SIDE, planes.solver),
    ) else {
        process::exit(101)
    };
    measure(&mut board, &prior, posterior);
    process::exit(0)
}

fn measure(board: &mut Board, prior: &Levels, mut posterior: Posterior) {
    let start = board.count();
    posterior.observe(prior, datum);
    let observed = board.count();
    posterior.step(1);
    let stepped = board.count();
    let progress = posterior.step(ITERATIONS - 1);
    let solved = board.count();
    posterior.mean_in_place(prior, datum);
    let ended = board.count();
    let cost = |from: u32, to: u32| board.cost(to.wrapping_sub(from));
    defmt::info!(
        "observe {=u32} iteration {=u32} others {=u32} mean {=u32} ppm {=u32}",
        cost(start, observed),
        cost(observed, stepped),
        cost(stepped, solved),
        cost(solved, ended),
        (progress.residual * 1e6) as u32
    );
}

/// A random walk of elevations along each row, one datum in three cells.
fn datum(i: usize) -> Option<Datum> {
    let chance = |salt: u32| {
        let mut x = (i as u32).wrapping_mul(0x9e37_79b9) ^ salt;
        x = (x ^ x >> 16).wrapping_mul(0x21f0_aaad);
        (x ^ x >> 15).wrapping_mul(0x735a_2d97) >> 8
    };
    let (x, y) = ((i % SIDE) as f32, (i / SIDE) as f32);
    let height = 0.02 * x - 0.01 * y + 0.05 * (chance(1) as f32 / 16_777_216.0 - 0.5);
    chance(2).is_multiple_of(3).then_some(Datum {
        height,
        variance: 1e-4,
    })
}
