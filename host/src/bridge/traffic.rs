//! Rates and latencies of a stream of lines.

use crate::link::Latency;
use serde::Serialize;

/// Mean and greatest of a series.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Extent {
    /// mean \[ms\]
    pub mean: f64,
    /// greatest \[ms\]
    pub max: f64,
    #[serde(skip)]
    count: u64,
}

impl Extent {
    /// Adds a value \[µs\].
    pub fn add(&mut self, micros: u64) {
        let ms = micros as f64 / 1000.0;
        self.count += 1;
        self.mean += (ms - self.mean) / self.count as f64;
        self.max = self.max.max(ms);
    }
}

/// What came in, how fast and how late.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Traffic {
    /// time of the first line and of the last, our clock \[µs\]
    first_us: Option<u64>,
    last_us: u64,
    /// lines that came
    pub lines: u64,
    /// least difference of our clock and the scanner's \[µs\]
    least_offset_us: Option<i64>,
    /// how much later than the quickest line a line came
    pub delay: Extent,
    /// from the arrival of a sweep's end to its map
    pub sweep: Extent,
    /// round trips of the link
    pub round_trip: Latency,
    /// the last values, for the progress line
    recent: (u64, u64),
    rate: f64,
}

/// Time over which the shown rate is taken \[µs\].
const RATE_WINDOW_US: u64 = 1_000_000;

impl Traffic {
    /// A line that was measured at `stamp_us` of the scanner's clock came at `now_us`.
    pub fn line(&mut self, stamp_us: u64, now_us: u64) {
        self.lines += 1;
        self.first_us.get_or_insert(now_us);
        self.last_us = now_us;
        let offset = now_us.wrapping_sub(stamp_us) as i64;
        let least = self
            .least_offset_us
            .map_or(offset, |least| least.min(offset));
        self.least_offset_us = Some(least);
        self.delay.add(offset.abs_diff(least));
        if now_us.saturating_sub(self.recent.0) >= RATE_WINDOW_US {
            let seconds = (now_us - self.recent.0) as f64 * 1e-6;
            self.rate = (self.lines - self.recent.1) as f64 / seconds;
            self.recent = (now_us, self.lines);
        }
    }

    /// Another session: the scanner's clock may have started afresh.
    pub fn new_session(&mut self) {
        self.least_offset_us = None;
    }

    /// Lines per second over the last second.
    pub fn rate(&self) -> f64 {
        self.rate
    }

    /// Seconds from the first line to the last.
    pub fn seconds(&self) -> f64 {
        self.last_us
            .saturating_sub(self.first_us.unwrap_or(self.last_us)) as f64
            * 1e-6
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn delays_are_measured_against_the_quickest_line() {
        let mut traffic = Traffic::default();
        for (stamp, now) in [(1000, 500_000), (2000, 501_000), (3000, 504_000)] {
            traffic.line(stamp, now);
        }
        assert_eq!((traffic.delay.max, traffic.delay.mean), (2.0, 2.0 / 3.0));
        assert_eq!(traffic.seconds(), 0.004);
    }
}
