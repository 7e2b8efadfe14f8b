//! Maps a recording and says what each sweep cost, in exact instructions.
//!
//! Reads frames from the file `frames.bin` in the emulator's folder, so no serial port
//! disturbs the count, and uses the firmware's own stages. One line of log per sweep;
//! ends with exit code 0, or 101.
#![no_std]
#![no_main]

use board::Board;
use core::panic::PanicInfo;
use cortex_m_rt::entry;
use rugosa::{Config, Mapper};
use rugosa_app::mapping::Costs;
use rugosa_app::memory;
use rugosa_app::platform::Platform;
use rugosa_wire::{Decoder, counter};
use semihosting::fs::File;
use semihosting::io::Read;
use semihosting::process;

#[panic_handler]
fn panic(info: &PanicInfo) -> ! {
    if let Some(place) = info.location() {
        defmt::error!("panic at {=str}:{=u32}", place.file(), place.line());
    }
    process::exit(101)
}

#[entry]
fn main() -> ! {
    let (Some(board), Ok(file)) = (Board::start(), File::open(c"frames.bin")) else {
        panic!("no file");
    };
    match Mapper::new(Config::default(), memory::take()) {
        Ok(mapper) => map(board, file, mapper),
        Err(_) => panic!("memory"),
    }
    process::exit(0)
}

fn map(mut board: Board, mut file: File, mut mapper: Mapper) {
    let (mut decoder, mut costs) = (Decoder::new(), Costs::default());
    let mut buffer = [0; 256]; // as much as the firmware takes at a time
    while let Ok(length @ 1..) = file.read(&mut buffer) {
        let mut bytes = &buffer[..length];
        loop {
            let start = board.count();
            let frame = decoder.pull(&mut bytes);
            costs.receive = costs
                .receive
                .wrapping_add(board.count().wrapping_sub(start));
            let Some(frame) = frame else { break };
            if frame.is_ok_and(|frame| costs.take(&board, &mut mapper, &frame.message)) {
                print(&mapper, board.stack_high_water());
            }
        }
        board.feed_watchdog();
    }
}

fn print(mapper: &Mapper, stack: u32) {
    let at = |index| mapper.counters().get(index);
    defmt::info!(
        "sweep {=u32} returns {=u32} receive {=u32} lines {=u32} counters {=u32} roughness {=u32} reconstruction {=u32} traversability {=u32} digest {=u32} stack {=u32}",
        at(counter::SWEEPS),
        at(counter::RETURNS_RECEIVED),
        at(counter::COST_RECEIVE),
        at(counter::COST_LINES),
        at(counter::COST_COUNTERS),
        at(counter::COST_ROUGHNESS),
        at(counter::COST_RECONSTRUCTION),
        at(counter::COST_TRAVERSABILITY),
        at(counter::MAP_DIGEST),
        stack
    );
}
