//! Two watchdogs that reset the processor when the loop does not come round.
//!
//! - The first counts ticks of the SysTick, one every 10 ms, and resets after four
//!   seconds of them, longer than all that follows a sweep. It counts ticks that were
//!   *handled*: when the emulator's computer stands still for a while, the emulated
//!   clocks jump by that time and all timers expire at once, but only one tick is
//!   handled. A stall of the host is no failure of the firmware.
//! - The second is the CMSDK watchdog, for a loop that hangs with interrupts masked. Its
//!   first expiry raises the non-maskable interrupt, the second one, a period later,
//!   resets; two minutes, because it would take a jump of the clocks for a failure.

use crate::{register::Register, timer::CLOCK_HZ};
use core::sync::atomic::{AtomicU32, Ordering};
use cortex_m::peripheral::SCB;
use cortex_m_rt::exception;

// SAFETY: CMSDK APB watchdog, Arm DAI0386 table 3-2
const LOAD: Register = unsafe { Register::at(0x4000_8000) };
// SAFETY: as above
const CONTROL: Register = unsafe { Register::at(0x4000_8008) };
// SAFETY: as above
const CLEAR: Register = unsafe { Register::at(0x4000_800c) };

const COUNT_AND_RESET: u32 = 0b11;
const PERIOD: u32 = 60 * CLOCK_HZ;

/// Ticks of 10 ms without being fed.
const PATIENCE: u32 = 400;

static TICKS: AtomicU32 = AtomicU32::new(0);

/// Starts the second one; the first runs with the SysTick.
pub fn start() {
    LOAD.write(PERIOD);
    CONTROL.write(COUNT_AND_RESET);
}

/// Another tick.
#[inline]
pub fn tick() {
    if TICKS.fetch_add(1, Ordering::Relaxed) >= PATIENCE {
        SCB::sys_reset();
    }
}

/// The warning before the reset; whoever hangs does not hear it.
#[exception]
unsafe fn NonMaskableInt() {}

/// Starts both periods afresh.
pub fn feed() {
    TICKS.store(0, Ordering::Relaxed);
    CLEAR.write(1);
}
