//! One 32-bit register of a peripheral.

use core::ptr::{read_volatile, write_volatile};

/// A register at a fixed address.
#[derive(Clone, Copy)]
pub struct Register(usize);

impl Register {
    /// The register at `address`.
    ///
    /// # Safety
    /// The address is that of a 32-bit register of this board, reading and writing of
    /// which has no effect on memory.
    pub const unsafe fn at(address: usize) -> Self {
        Register(address)
    }

    /// Reads it.
    #[inline]
    pub fn read(self) -> u32 {
        // SAFETY: the constructor's promise
        unsafe { read_volatile(self.0 as *const u32) }
    }

    /// Writes it.
    #[inline]
    pub fn write(self, value: u32) {
        // SAFETY: the constructor's promise
        unsafe { write_volatile(self.0 as *mut u32, value) }
    }
}
