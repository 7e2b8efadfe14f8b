//! How deep the stack has been.

use cortex_m_rt::STACK_PAINT_VALUE;

unsafe extern "C" {
    static _stack_start: u32;
    static _stack_end: u32;
}

/// Bytes between the end of the static variables and the top of the memory.
pub fn size() -> u32 {
    (&raw const _stack_start as u32) - (&raw const _stack_end as u32)
}

/// Most bytes that were in use at any time: what of the paint of the start is gone.
pub fn high_water() -> u32 {
    let (mut address, top) = (&raw const _stack_end, &raw const _stack_start);
    // SAFETY: whole words between two symbols of the linker, all of them RAM
    while address < top && unsafe { address.read_volatile() } == STACK_PAINT_VALUE {
        address = address.wrapping_add(1);
    }
    top as u32 - address as u32
}
