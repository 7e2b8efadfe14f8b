//! The CMSDK watchdog: resets the processor when it is not fed for a second.
//!
//! Its first expiry raises an interrupt that is not enabled here, the second one, a
//! period later, resets.

use crate::{register::Register, timer::CLOCK_HZ};

// SAFETY: CMSDK APB watchdog, Arm DAI0386 table 3-2
const LOAD: Register = unsafe { Register::at(0x4000_8000) };
// SAFETY: as above
const CONTROL: Register = unsafe { Register::at(0x4000_8008) };
// SAFETY: as above
const CLEAR: Register = unsafe { Register::at(0x4000_800c) };

const COUNT_AND_RESET: u32 = 0b11;

/// Starts it.
pub fn start() {
    LOAD.write(CLOCK_HZ / 2);
    CONTROL.write(COUNT_AND_RESET);
}

/// Starts its period afresh.
pub fn feed() {
    CLEAR.write(1);
}
