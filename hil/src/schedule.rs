//! When the lines of a scanner with a rate of its own are due, and how late they went out.

use serde::Serialize;

/// Lines that did not go out at their time.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Lateness {
    /// lines that went out after the next one was due
    pub late: u64,
    /// the latest line \[µs\]; a line is due when its last return has been taken
    pub worst_us: u64,
}

/// A line every `period_us`, counted from the first one.
#[derive(Clone, Copy, Debug)]
pub struct Schedule {
    period_us: u64,
    next_us: Option<u64>,
    lateness: Lateness,
}

impl Schedule {
    /// A scanner that takes a line every `period_us`.
    pub fn new(period_us: u64) -> Self {
        Schedule {
            period_us,
            next_us: None,
            lateness: Lateness::default(),
        }
    }

    /// Has the next line been taken?
    pub fn is_due(&self, now_us: u64) -> bool {
        self.next_us.is_none_or(|next| now_us >= next)
    }

    /// The line has gone out.
    pub fn sent(&mut self, now_us: u64) {
        let due = self.next_us.unwrap_or(now_us);
        let late_us = now_us.saturating_sub(due);
        self.lateness.late += u64::from(late_us > self.period_us);
        self.lateness.worst_us = self.lateness.worst_us.max(late_us);
        self.next_us = Some(due + self.period_us);
    }

    /// How late lines were so far.
    pub fn lateness(&self) -> Lateness {
        self.lateness
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_is_late_when_the_next_one_was_due() {
        let mut schedule = Schedule::new(100);
        assert!(schedule.is_due(7));
        schedule.sent(7);
        assert!(!schedule.is_due(106) && schedule.is_due(107));
        schedule.sent(207); // as late as the next one is due: in time
        assert_eq!(
            schedule.lateness(),
            Lateness {
                late: 0,
                worst_us: 100
            }
        );
        schedule.sent(308); // due at 207
        assert_eq!(
            schedule.lateness(),
            Lateness {
                late: 1,
                worst_us: 101
            }
        );
        assert!(schedule.is_due(307), "it catches up");
    }
}
