//! The firmware.
#![no_std]
#![no_main]

use board::Board;
use core::panic::PanicInfo;
use cortex_m_rt::entry;
use rugosa_support::{panicked, reset};

#[entry]
fn main() -> ! {
    let Some(board) = Board::start() else {
        reset::restart(reset::Cause::Panic)
    };
    rugosa_app::run(board)
}

#[panic_handler]
fn panic(info: &PanicInfo) -> ! {
    panicked(info)
}
