//! Time and counting, on CMSDK timers 0 and 1 (25 MHz) and the SysTick.
//!
//! - Timer 0 runs down freely from its greatest value; it is both the clock and the
//!   instruction counter. Under QEMU's `-icount shift=N` an instruction takes 2^N ns of
//!   virtual time and a count 40 ns, so that the same work always takes the same count.
//! - Timer 1 has no interrupt. Its expiry makes the emulator's main loop look at the
//!   serial ports again, which the emulated UART forgets to ask for (see [`wake_port`]).
//! - SysTick ends a sleep at least every 10 ms and drives a watchdog.

use crate::{register::Register, watchdog};
use cortex_m::peripheral::{SYST, syst::SystClkSource};
use cortex_m_rt::exception;

/// Counts per second of the timers, and cycles per second of the SysTick.
pub const CLOCK_HZ: u32 = 25_000_000;

/// Longest sleep.
const TICK_US: u32 = 10_000;

const ENABLE: u32 = 1;

struct Timer {
    control: Register,
    value: Register,
    reload: Register,
}

const fn timer(base: usize) -> Timer {
    // SAFETY: CMSDK APB timers, Arm DAI0386 table 3-2
    unsafe {
        Timer {
            control: Register::at(base),
            value: Register::at(base + 4),
            reload: Register::at(base + 8),
        }
    }
}

const COUNTER: Timer = timer(0x4000_0000);
const WAKER: Timer = timer(0x4000_1000);

/// Starts everything here.
pub fn start(systick: &mut SYST) {
    COUNTER.reload.write(u32::MAX);
    COUNTER.value.write(u32::MAX);
    COUNTER.control.write(ENABLE);
    WAKER.reload.write(CLOCK_HZ / 1000);
    WAKER.value.write(CLOCK_HZ / 1000);
    WAKER.control.write(ENABLE);
    systick.set_clock_source(SystClkSource::Core);
    systick.set_reload(CLOCK_HZ / 1_000_000 * TICK_US - 1);
    systick.clear_current();
    systick.enable_counter();
    systick.enable_interrupt();
}

/// Counts since the start, modulo 2^32 (172 s).
#[inline]
pub fn count() -> u32 {
    !COUNTER.value.read()
}

/// Has to follow every byte that is read from a UART: lets timer 1 expire in a
/// microsecond, upon which QEMU delivers the next byte.
#[inline]
pub fn wake_port() {
    WAKER.value.write(CLOCK_HZ / 1_000_000);
}

#[exception]
fn SysTick() {
    watchdog::tick();
}

/// Turns the wrapping count into microseconds since the start.
#[derive(Default)]
pub struct Clock {
    last: u32,
    counts: u64,
}

impl Clock {
    /// Microseconds since the start; to be asked at least once in 172 s.
    pub fn now_us(&mut self) -> u64 {
        let count = count();
        self.counts += u64::from(count.wrapping_sub(self.last));
        self.last = count;
        self.counts / u64::from(CLOCK_HZ / 1_000_000)
    }
}
