//! Time that can be waited for, real or virtual.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// A clock that starts at 0.
pub trait Clock {
    /// Time since the start.
    fn now(&self) -> Duration;

    /// Returns when `time` has come.
    fn wait_until(&self, time: Duration);
}

/// The machine's clock.
#[derive(Clone, Copy, Debug)]
pub struct RealClock(Instant);

impl RealClock {
    /// Starts now.
    pub fn start() -> Self {
        RealClock(Instant::now())
    }
}

impl Clock for RealClock {
    fn now(&self) -> Duration {
        self.0.elapsed()
    }

    fn wait_until(&self, time: Duration) {
        std::thread::sleep(time.saturating_sub(self.now()));
    }
}

/// A clock that moves only when somebody waits; clones show the same time.
#[derive(Clone, Debug, Default)]
pub struct VirtualClock(Arc<AtomicU64>);

impl Clock for VirtualClock {
    fn now(&self) -> Duration {
        Duration::from_nanos(self.0.load(Ordering::SeqCst))
    }

    fn wait_until(&self, time: Duration) {
        self.0.fetch_max(time.as_nanos() as u64, Ordering::SeqCst);
    }
}

/// How fast stamped things are passed on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Pace {
    /// at their stamps, this many times as fast (1 = real time)
    Times(f64),
    /// as fast as they are taken
    Unlimited,
}

impl Pace {
    /// Waits until something that happened `since_start` after the first is due;
    /// `started` is when the first was passed on.
    pub fn wait(&self, clock: &impl Clock, started: Duration, since_start: Duration) {
        if let Pace::Times(speed) = self {
            clock.wait_until(started + since_start.div_f64(*speed));
        }
    }
}
