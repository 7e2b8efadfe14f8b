//! The firmware of rugosa, apart from the board.
//!
//! A board implements [`Platform`] and calls [`run`]. The app
//! has no heap, waits for nobody, and is made of the same crates as the host's tools:
//! what it maps is bit for bit what they map from the same bytes.
#![no_std]
#![forbid(unsafe_code)]

pub mod channel;
pub mod design_parameters;
pub mod mapping;
pub mod memory;
pub mod module;
pub mod platform;
pub mod report;

use design_parameters::{LINES_GRANTED, RECEIVE_QUEUE};
use module::Module;
use platform::Platform;
use rugosa::{Config, Mapper};

/// Runs for ever.
pub fn run<P: Platform>(platform: P) -> ! {
    let restarts = platform.restarts();
    let (watchdog, panic, command) = (restarts.watchdog, restarts.panic, restarts.command);
    defmt::info!(
        "rugosa {=str} on {=str}",
        env!("CARGO_PKG_VERSION"),
        P::NAME
    );
    defmt::info!(
        "restarts: watchdog {=u32}, panic {=u32}, command {=u32}",
        watchdog,
        panic,
        command
    );
    match Mapper::new(Config::default(), memory::take()) {
        Ok(mapper) => {
            print(&platform, &mapper);
            Module::new(platform, mapper).run()
        }
        Err(_) => panic!("the map's memory does not fit its parameters"),
    }
}

fn print<P: Platform>(platform: &P, mapper: &Mapper) {
    let side = mapper.window().side();
    let resolution = mapper.config().resolution;
    defmt::info!(
        "map {=usize} x {=usize} cells of {=f32} m, {=usize} bytes",
        side,
        side,
        resolution,
        memory::BYTES
    );
    defmt::info!(
        "receive queue {=usize} bytes, {=u16} lines granted",
        RECEIVE_QUEUE,
        LINES_GRANTED
    );
    defmt::info!(
        "a count of the clock is {=u32} instructions or cycles / 1000",
        platform.cost(1000)
    );
}
