//! Why the processor was started, and starting it again.
//!
//! A record in memory that the start-up code leaves alone survives a reset. Its first
//! word tells a reset from a power-up, where the memory holds anything.

use core::mem::MaybeUninit;
use cortex_m::peripheral::SCB;
use rugosa_app::platform::Restarts;

/// Why the processor is about to be reset.
#[derive(Clone, Copy)]
#[repr(u32)]
pub enum Cause {
    /// nobody said: the watchdog, or the reset pin
    Watchdog = 2,
    /// a panic
    Panic = 3,
    /// it was asked for
    Command = 4,
}

const VALID: u32 = 0x7275_676f;
const CAUSE: usize = 1;
const WORDS: usize = 5;

/// `VALID`, the cause of the next reset, and a counter per cause.
type Record = [u32; WORDS];

#[unsafe(link_section = ".uninit.restarts")]
static mut RECORD: MaybeUninit<Record> = MaybeUninit::uninit();

fn load() -> Record {
    // SAFETY: any bits make a Record; only the one thread there is and the panic
    // handler, which does not return to it, come here
    let record = unsafe { (&raw const RECORD).cast::<Record>().read_volatile() };
    if record[0] == VALID {
        record
    } else {
        [VALID, 0, 0, 0, 0]
    }
}

fn store(record: Record) {
    // SAFETY: as above
    unsafe { (&raw mut RECORD).cast::<Record>().write_volatile(record) }
}

/// Counts the reset that led here. To be called once, at the start.
pub fn count() {
    let mut record = load();
    let cause = record[CAUSE] as usize;
    if (Cause::Watchdog as usize..WORDS).contains(&cause) {
        record[cause] += 1;
    }
    record[CAUSE] = Cause::Watchdog as u32;
    store(record);
}

/// Resets so far.
pub fn restarts() -> Restarts {
    let [_, _, watchdog, panic, command] = load();
    Restarts {
        watchdog,
        panic,
        command,
    }
}

/// Resets the processor.
pub fn restart(cause: Cause) -> ! {
    let mut record = load();
    record[CAUSE] = cause as u32;
    store(record);
    SCB::sys_reset()
}
