//! What the app asks of a board.

use crate::design_parameters::PORTS;
use embedded_io::{Read, ReadReady};

/// A serial port with queues in both directions.
pub trait Port: Read + ReadReady {
    /// Takes as many of the bytes as it can without waiting and says how many that are.
    fn try_write(&mut self, bytes: &[u8]) -> usize;
    /// Received bytes that were dropped because nobody had read the ones before.
    fn dropped(&self) -> u32;
    /// Most bytes that have waited to be read.
    fn fullest(&self) -> u32;
}

/// A board.
pub trait Platform {
    /// Its serial ports.
    type Port: Port;

    /// Its name.
    const NAME: &'static str;

    /// The serial ports.
    fn ports(&mut self) -> &mut [Self::Port; PORTS];
    /// Microseconds since the start.
    fn now_us(&mut self) -> u64;
    /// The counter of [`Platform::cost`], wrapping.
    fn count(&self) -> u32;
    /// Instructions (emulator) or cycles (silicon) in so many counts.
    fn cost(&self, counts: u32) -> u32;
    /// Sleeps until a byte has come in, some ten milliseconds at most.
    fn sleep(&mut self);
    /// Still alive; the processor is reset when this is not heard for some seconds.
    fn feed_watchdog(&mut self);
    /// Most bytes of stack that were in use so far.
    fn stack_high_water(&self) -> u32;
    /// A number that differs between starts, powered off or not.
    fn session(&mut self) -> u32;
    /// Resets so far, by cause.
    fn restarts(&self) -> Restarts;
    /// Resets the processor.
    fn restart(&mut self) -> !;
}

/// Resets since power-up, by cause.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Restarts {
    /// the watchdog, or the reset pin
    pub watchdog: u32,
    /// a failed check of the program itself
    pub panic: u32,
    /// [`Platform::restart`]
    pub command: u32,
}

impl Restarts {
    /// Resets of any cause.
    pub fn total(&self) -> u32 {
        self.watchdog + self.panic + self.command
    }
}
