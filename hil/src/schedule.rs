//! When the lines of a scanner with a rate of its own are due, and how long they had to wait.

use serde::Serialize;
use std::collections::VecDeque;

/// Lines that did not go out at their time.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Lateness {
    /// lines that waited for line and module for longer than a line's period
    pub late: u64,
    /// the longest wait \[µs\], from the first look at the clock at which the line was due
    pub worst_us: u64,
    /// the longest time between two looks \[µs\]: the board went on while the program that
    /// plays the scanner had to wait for the computer. Of such a time no more than
    /// [`ATTENDED_US`] counts as waiting
    pub away_us: u64,
}

/// Longest time between two looks \[µs\] in which the scanner is taken to have been there.
pub const ATTENDED_US: u64 = 5000;

/// A line every `period_us`, counted from the first one.
#[derive(Clone, Debug)]
pub struct Schedule {
    period_us: u64,
    /// of the first line that is not due yet; `None` before the first has gone out
    next_us: Option<u64>,
    looked_us: Option<u64>,
    /// time in which the scanner was there
    attended_us: u64,
    /// of it: when each line that is due was first seen to be
    seen_us: VecDeque<u64>,
    lateness: Lateness,
}

impl Schedule {
    /// A scanner that takes a line every `period_us`.
    pub fn new(period_us: u64) -> Self {
        Schedule {
            period_us,
            next_us: None,
            looked_us: None,
            attended_us: 0,
            seen_us: VecDeque::new(),
            lateness: Lateness::default(),
        }
    }

    /// To be called as often as possible: notes what has become due.
    pub fn look(&mut self, now_us: u64) {
        let Some(next_us) = &mut self.next_us else {
            return;
        };
        let away_us = now_us.saturating_sub(self.looked_us.unwrap_or(now_us));
        self.lateness.away_us = self.lateness.away_us.max(away_us);
        self.attended_us += away_us.min(ATTENDED_US);
        self.looked_us = Some(now_us);
        while *next_us <= now_us {
            self.seen_us.push_back(self.attended_us);
            *next_us += self.period_us;
        }
    }

    /// Has the next line been taken?
    pub fn is_due(&self) -> bool {
        self.next_us.is_none() || !self.seen_us.is_empty()
    }

    /// The line has gone out, at the last look.
    pub fn sent(&mut self, now_us: u64) {
        self.next_us.get_or_insert(now_us + self.period_us);
        let seen_us = self.seen_us.pop_front().unwrap_or(self.attended_us);
        let waited_us = self.attended_us - seen_us;
        self.lateness.late += u64::from(waited_us > self.period_us);
        self.lateness.worst_us = self.lateness.worst_us.max(waited_us);
    }

    /// How late lines were so far.
    pub fn lateness(&self) -> Lateness {
        self.lateness
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A scanner of a line every 100 µs whose first line went out at 7.
    fn begun() -> Schedule {
        let mut schedule = Schedule::new(100);
        assert!(schedule.is_due());
        schedule.sent(7);
        schedule
    }

    #[test]
    fn a_line_is_late_when_the_next_one_was_due() {
        let mut schedule = begun();
        schedule.look(106);
        assert!(!schedule.is_due());
        schedule.look(107);
        assert!(schedule.is_due());
        for now in 108..=207 {
            schedule.look(now);
        }
        schedule.sent(207); // as late as the next one is due: in time
        let lateness = schedule.lateness();
        assert_eq!((lateness.late, lateness.worst_us), (0, 100));
        for now in 208..=308 {
            schedule.look(now);
        }
        schedule.sent(308); // due at 207
        let lateness = schedule.lateness();
        assert_eq!((lateness.late, lateness.worst_us), (1, 101));
        assert!(schedule.is_due(), "it catches up");
        schedule.sent(308); // due at 307
        assert!(!schedule.is_due());
    }

    #[test]
    fn who_does_not_look_makes_no_line_late() {
        let mut schedule = begun();
        schedule.look(10);
        schedule.look(450); // lines were due at 107, 207, 307 and 407
        for _ in 0..4 {
            assert!(schedule.is_due());
            schedule.sent(450);
        }
        assert!(!schedule.is_due());
        schedule.look(510); // due at 507
        schedule.look(90_000);
        schedule.sent(90_000);
        let told = Lateness {
            late: 1,
            worst_us: ATTENDED_US,
            away_us: 89_490,
        };
        assert_eq!(schedule.lateness(), told);
    }
}
