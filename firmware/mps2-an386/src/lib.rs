//! Support for ARM's MPS2 board with the AN386 image, as QEMU emulates it: a
//! Cortex-M4F, two serial ports in use, timers, a watchdog.
#![no_std]

pub mod register;
pub mod timer;
pub mod uart;
pub mod watchdog;

use cortex_m::peripheral::Peripherals;
use defmt_semihosting as _;
use rugosa_app::design_parameters::PORTS;
use rugosa_app::platform::{Platform, Port, Restarts};
use rugosa_support::{reset, stack};
use semihosting::sys::arm_compat::sys_time;
use timer::Clock;
use uart::{Buffers, Uart};

/// Rate of both ports. The emulator has no rates; a bridge on the host paces the line.
const BAUD: u32 = 115_200;

/// The board with both ports started.
pub struct Board {
    ports: [Uart; PORTS],
    clock: Clock,
    scale: Scale,
}

impl Board {
    /// Starts everything. `None` the second time.
    pub fn start() -> Option<Self> {
        let mut core = Peripherals::take()?;
        reset::count();
        timer::start(&mut core.SYST);
        watchdog::start();
        let first = cortex_m::singleton!(: Buffers = Buffers::new())?;
        let second = cortex_m::singleton!(: Buffers = Buffers::new())?;
        Some(Board {
            ports: [Uart::start(0, BAUD, first), Uart::start(1, BAUD, second)],
            clock: Clock::default(),
            scale: Scale::measure(),
        })
    }
}

impl Port for Uart {
    fn try_write(&mut self, bytes: &[u8]) -> usize {
        Uart::try_write(self, bytes)
    }

    fn dropped(&self) -> u32 {
        Uart::dropped(self)
    }

    fn fullest(&self) -> u32 {
        Uart::fullest(self)
    }
}

impl Platform for Board {
    type Port = Uart;

    const NAME: &'static str = "mps2-an386 (emulated)";

    fn ports(&mut self) -> &mut [Uart; PORTS] {
        &mut self.ports
    }

    fn now_us(&mut self) -> u64 {
        self.clock.now_us()
    }

    #[inline]
    fn count(&self) -> u32 {
        timer::count()
    }

    fn cost(&self, counts: u32) -> u32 {
        self.scale.instructions(counts)
    }

    fn sleep(&mut self) {
        cortex_m::interrupt::disable();
        if !self.ports.iter().any(Uart::is_pending) {
            cortex_m::asm::wfi(); // an interrupt that is pending wakes, masked or not
        }
        // SAFETY: no critical section is open here
        unsafe { cortex_m::interrupt::enable() };
    }

    fn feed_watchdog(&mut self) {
        watchdog::feed();
    }

    fn stack_high_water(&self) -> u32 {
        stack::high_water()
    }

    fn session(&mut self) -> u32 {
        // the host's clock, as there is no source of chance on this board; always five
        // bytes on the link, so that costs do not depend on it
        let seconds = sys_time().map_or(0, |s| s as u32);
        1 << 31 | seconds.wrapping_add(self.restarts().total() << 24)
    }

    fn restarts(&self) -> Restarts {
        reset::restarts()
    }

    fn restart(&mut self) -> ! {
        reset::restart(reset::Cause::Command)
    }
}

/// Counts of the timer that a known number of instructions takes.
///
/// The firmware cannot know QEMU's `-icount shift`, so it measures it: an
/// instruction takes 1/40 count at shift 0, 1/5 at shift 3. Without icount the figure follows the host's clock and the
/// costs are estimates.
#[derive(Clone, Copy)]
pub struct Scale {
    counts: u32,
}

impl Scale {
    const LOOPS: u32 = 400_000;
    const INSTRUCTIONS: u32 = 2 * Self::LOOPS;

    /// Runs loops that differ by [`Scale::INSTRUCTIONS`] instructions.
    fn measure() -> Self {
        let time = |loops| {
            cortex_m::interrupt::free(|_| {
                let start = timer::count();
                cortex_m::asm::delay(loops); // two instructions per loop
                timer::count().wrapping_sub(start)
            })
        };
        Scale {
            counts: time(Self::LOOPS + 1).saturating_sub(time(1)).max(1),
        }
    }

    /// Instructions in so many counts.
    pub fn instructions(self, counts: u32) -> u32 {
        let scaled = u64::from(counts) * u64::from(Self::INSTRUCTIONS);
        (scaled / u64::from(self.counts)) as u32
    }
}
