//! The firmware.
#![no_std]
#![no_main]

use board::{Board, reset};
use core::panic::PanicInfo;
use cortex_m_rt::entry;
use rugosa_app::design_parameters::Map;
use static_cell::StaticCell;

static MAP: StaticCell<Map> = StaticCell::new();

#[entry]
fn main() -> ! {
    let Some(board) = Board::start() else {
        reset::restart(reset::Cause::Panic)
    };
    rugosa_app::run(board, MAP.init_with(Map::new))
}

#[panic_handler]
fn panic(info: &PanicInfo) -> ! {
    if let Some(place) = info.location() {
        defmt::error!("panic at {=str}:{=u32}", place.file(), place.line());
    }
    reset::restart(reset::Cause::Panic)
}
