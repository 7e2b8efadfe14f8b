//! The CMSDK watchdog: resets the processor when it is not fed for eight seconds, longer
//! than all that follows a sweep.
//!
//! Its first expiry raises the non-maskable interrupt, the second one, a period later,
//! resets.

use crate::{register::Register, timer::CLOCK_HZ};
use cortex_m_rt::exception;

// SAFETY: CMSDK APB watchdog, Arm DAI0386 table 3-2
const LOAD: Register = unsafe { Register::at(0x4000_8000) };
// SAFETY: as above
const CONTROL: Register = unsafe { Register::at(0x4000_8008) };
// SAFETY: as above
const CLEAR: Register = unsafe { Register::at(0x4000_800c) };

const COUNT_AND_RESET: u32 = 0b11;

/// Starts it.
pub fn start() {
    LOAD.write(4 * CLOCK_HZ);
    CONTROL.write(COUNT_AND_RESET);
}

/// The warning before the reset; whoever hangs does not hear it.
#[exception]
unsafe fn NonMaskableInt() {}

/// Starts its period afresh.
pub fn feed() {
    CLEAR.write(1);
}
