//! What every Cortex-M board needs: why it was reset, and how deep its stack has been.
#![no_std]

pub mod reset;
pub mod stack;

use core::panic::PanicInfo;

/// What a board's panic handler does: says where, counts, starts afresh.
pub fn panicked(info: &PanicInfo) -> ! {
    if let Some(place) = info.location() {
        defmt::error!("panic at {=str}:{=u32}", place.file(), place.line());
    }
    reset::restart(reset::Cause::Panic)
}
