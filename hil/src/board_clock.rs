//! The time of the emulated board.

use anyhow::Result;
use rugosa_hil_sim::qemu::Emulator;
use std::time::{Duration, Instant};

/// Value of CMSDK timer 0, which the firmware lets run down from its greatest value;
/// 0 before.
const TIMER: u32 = 0x4000_0004;
const COUNTS_PER_US: u64 = 25;
/// What looks like a longer jump (43 s) is a timer that was started again.
const LONGEST: u32 = 1 << 30;

/// Clock of the board as seen from outside; to be asked at least every 43 s of it.
///
/// It is the emulator's: a computer that is slow makes it slow, and whatever goes by it
/// keeps in step with the processor. A reset of the module does not set it back.
#[derive(Clone, Copy, Debug, Default)]
pub struct BoardClock {
    last: u32,
    counts: u64,
    asked: Option<Instant>,
}

/// Each question stops the emulator for a moment.
const BETWEEN_QUESTIONS: Duration = Duration::from_millis(1);

impl BoardClock {
    /// Time since the module was switched on.
    pub fn now(&mut self, emulator: &Emulator) -> Result<Duration> {
        if self
            .asked
            .is_none_or(|at| at.elapsed() >= BETWEEN_QUESTIONS)
        {
            self.take(emulator.word(TIMER)?);
            self.asked = Some(Instant::now());
        }
        Ok(Duration::from_micros(self.counts / COUNTS_PER_US))
    }

    fn take(&mut self, timer: u32) {
        let count = if timer == 0 { 0 } else { !timer };
        let passed = count.wrapping_sub(self.last);
        self.counts += u64::from(if passed > LONGEST { count } else { passed });
        self.last = count;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_goes_on_through_wraps_and_resets() {
        let mut clock = BoardClock::default();
        let mut counts = |timer| {
            clock.take(timer);
            clock.counts
        };
        assert_eq!(counts(0), 0, "not started");
        assert_eq!(counts(u32::MAX), 0);
        assert_eq!(counts(u32::MAX - 100), 100);
        assert_eq!(counts(0), 100, "reset");
        assert_eq!(counts(u32::MAX - 7), 107);
        for timer in [3 << 30, 2 << 30, 1 << 30, 1] {
            counts(timer);
        }
        assert_eq!(counts(u32::MAX - 1), (1 << 32) + 101, "wrapped");
    }
}
