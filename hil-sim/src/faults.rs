//! What a real serial line does to bytes: it takes its time, and it errs.
//!
//! A [`Line`] is one direction. Time is an argument, so the same line runs on the real
//! clock inside a [`crate::port::Cable`] and on a virtual one in tests. Faults are drawn
//! from the seed alone, position by position, whatever the chunks in which the bytes
//! come; everything injected is counted exactly:
//!
//! `bytes_out + waiting = bytes_in − dropped − cut + duplicated`.
//!
//! - *pacing*: 10 bits per byte (8N1), bytes queue for the line;
//! - *bit errors*: each bit of a byte is inverted with probability `bit_error_rate`;
//! - *drops*, *duplicates*: each byte, with a probability;
//! - *delay*, *jitter*: later by a constant, and up to `jitter` more; order is kept;
//! - *cuts*: stretches of bytes that are lost, e.g. a disconnection of a second at
//!   115 200 Bd is a cut of 11 520 bytes.
//!
//! Gaps between faults are geometric, ⌊ln U / ln(1 − p)⌋, so the cost per byte does not
//! depend on the rates.

use std::collections::VecDeque;
use std::io::{Read, Result, Write};
use std::ops::Range;
use std::time::Duration;

use crate::clock::Clock;
use crate::random::Random;

/// Bytes that wait for a paced line before the sender has to wait.
const BACKLOG: usize = 1024;
const BITS_PER_BYTE: u64 = 10;

/// What goes wrong in one direction. The default is a perfect line.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Faults {
    /// bits per second; `None`: as fast as it gets
    pub baud: Option<u32>,
    /// probability that a bit is inverted
    pub bit_error_rate: f64,
    /// probability that a byte is lost
    pub drop_rate: f64,
    /// probability that a byte comes twice
    pub duplicate_rate: f64,
    /// every byte is later by this
    pub delay: Duration,
    /// and by up to this
    pub jitter: Duration,
    /// bytes of these positions are lost, in ascending order
    pub cuts: Vec<Range<u64>>,
    /// decides where
    pub seed: u64,
}

impl Faults {
    /// A perfect line at a baud rate.
    pub fn paced(baud: u32) -> Self {
        Faults {
            baud: Some(baud),
            ..Faults::default()
        }
    }

    fn byte_time(&self) -> Duration {
        let nanos = |baud| BITS_PER_BYTE * 1_000_000_000 / u64::from(baud);
        Duration::from_nanos(self.baud.map_or(0, nanos))
    }
}

/// What was injected so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Injected {
    /// bytes that were sent into the line
    pub bytes_in: u64,
    /// bytes that came out
    pub bytes_out: u64,
    /// inverted bits
    pub bits_flipped: u64,
    /// bytes with one or more inverted bits
    pub bytes_damaged: u64,
    /// lost bytes
    pub dropped: u64,
    /// bytes that came twice
    pub duplicated: u64,
    /// bytes lost in cuts
    pub cut: u64,
}

/// Positions of random events.
struct Events {
    /// ln(1 − p), 0 for never
    log_miss: f64,
    next: u64,
}

impl Events {
    fn new(probability: f64, random: &mut Random) -> Self {
        let mut events = Events {
            log_miss: (-probability.clamp(0.0, 1.0)).ln_1p(),
            next: 0,
        };
        events.next = events.gap(random);
        events
    }

    fn gap(&self, random: &mut Random) -> u64 {
        match self.log_miss == 0.0 {
            true => u64::MAX,
            // 1 − U is never 0; the conversion saturates
            false => ((1.0 - random.uniform()).ln() / self.log_miss) as u64,
        }
    }

    /// Does it happen at this position? To be asked once per position, in order.
    fn at(&mut self, position: u64, random: &mut Random) -> bool {
        let now = position == self.next;
        if now {
            self.next = position.saturating_add(1).saturating_add(self.gap(random));
        }
        now
    }
}

/// One direction of a serial line.
pub struct Line {
    faults: Faults,
    injected: Injected,
    random: Random,
    bits: Events,
    drops: Events,
    duplicates: Events,
    /// when the line has sent all that it was given
    free_at: Duration,
    under_way: VecDeque<(Duration, u8)>,
}

impl Line {
    /// A line at rest.
    pub fn new(faults: Faults) -> Self {
        let mut random = Random::new(faults.seed);
        Line {
            bits: Events::new(faults.bit_error_rate, &mut random),
            drops: Events::new(faults.drop_rate, &mut random),
            duplicates: Events::new(faults.duplicate_rate, &mut random),
            faults,
            injected: Injected::default(),
            random,
            free_at: Duration::ZERO,
            under_way: VecDeque::new(),
        }
    }

    /// What was injected so far.
    pub fn injected(&self) -> Injected {
        self.injected
    }

    /// Bytes under way.
    pub fn waiting(&self) -> usize {
        self.under_way.len()
    }

    /// How many bytes may be pushed at `now`.
    pub fn room(&self, now: Duration) -> usize {
        let byte = self.faults.byte_time();
        if byte.is_zero() {
            return BACKLOG;
        }
        let queued = self.free_at.saturating_sub(now).as_nanos() / byte.as_nanos();
        BACKLOG.saturating_sub(queued as usize)
    }

    /// Sends bytes at `now`.
    pub fn push(&mut self, bytes: &[u8], now: Duration) {
        for &byte in bytes {
            let position = self.injected.bytes_in;
            self.injected.bytes_in += 1;
            self.free_at = self.free_at.max(now) + self.faults.byte_time();
            self.send(byte, position);
        }
    }

    /// Appends what has arrived by `now`.
    pub fn pull(&mut self, now: Duration, out: &mut Vec<u8>) {
        while self.under_way.front().is_some_and(|(due, _)| *due <= now) {
            out.extend(self.under_way.pop_front().map(|(_, byte)| byte));
            self.injected.bytes_out += 1;
        }
    }

    /// When the next byte arrives.
    pub fn next_due(&self) -> Option<Duration> {
        self.under_way.front().map(|(due, _)| *due)
    }

    fn send(&mut self, byte: u8, position: u64) {
        // all three are asked for every byte, so that one fault does not move the others
        let flips = self.flips(position);
        let dropped = self.drops.at(position, &mut self.random);
        let twice = self.duplicates.at(position, &mut self.random);
        if self.is_cut(position) {
            self.injected.cut += 1;
            return;
        }
        if dropped {
            self.injected.dropped += 1;
            return;
        }
        self.injected.bits_flipped += u64::from(flips.count_ones());
        self.injected.bytes_damaged += u64::from(flips != 0);
        self.injected.duplicated += u64::from(twice);
        for _ in 0..=u8::from(twice) {
            let due = self.due();
            self.under_way.push_back((due, byte ^ flips));
        }
    }

    fn flips(&mut self, position: u64) -> u8 {
        let bit = |k| u8::from(self.bits.at(position * 8 + k, &mut self.random)) << k;
        (0..8).map(bit).fold(0, |all, bit| all | bit)
    }

    fn is_cut(&self, position: u64) -> bool {
        self.faults.cuts.iter().any(|cut| cut.contains(&position))
    }

    fn due(&mut self) -> Duration {
        let jitter = match self.faults.jitter.is_zero() {
            true => Duration::ZERO,
            false => self.faults.jitter.mul_f64(self.random.uniform()),
        };
        let due = self.free_at + self.faults.delay + jitter;
        self.under_way
            .back()
            .map_or(due, |(last, _)| due.max(*last))
    }
}

/// A port whose written bytes pass through a [`Line`]: for tests without a second
/// thread. A write returns when its bytes have reached the port behind.
pub struct Faulty<P, C> {
    port: P,
    line: Line,
    clock: C,
}

impl<P, C: Clock> Faulty<P, C> {
    /// Puts a line in front of `port`.
    pub fn new(port: P, faults: Faults, clock: C) -> Self {
        Faulty {
            port,
            line: Line::new(faults),
            clock,
        }
    }

    /// What was injected so far.
    pub fn injected(&self) -> Injected {
        self.line.injected()
    }

    /// The port behind.
    pub fn into_inner(self) -> P {
        self.port
    }
}

impl<P: Write, C: Clock> Write for Faulty<P, C> {
    fn write(&mut self, bytes: &[u8]) -> Result<usize> {
        self.line.push(bytes, self.clock.now());
        let mut arrived = Vec::new();
        while let Some(due) = self.line.next_due() {
            self.clock.wait_until(due);
            self.line.pull(due, &mut arrived);
        }
        self.port.write_all(&arrived)?;
        Ok(bytes.len())
    }

    fn flush(&mut self) -> Result<()> {
        self.port.flush()
    }
}

impl<P: Read, C> Read for Faulty<P, C> {
    fn read(&mut self, buffer: &mut [u8]) -> Result<usize> {
        self.port.read(buffer)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clock::VirtualClock;

    fn through(faults: Faults, sent: &[u8]) -> (Vec<u8>, Injected, Duration) {
        let clock = VirtualClock::default();
        let mut port = Faulty::new(Vec::new(), faults, clock.clone());
        port.write_all(sent).unwrap();
        let injected = port.injected();
        (port.into_inner(), injected, clock.now())
    }

    fn bytes(n: usize) -> Vec<u8> {
        let mut random = Random::new(42);
        (0..n).map(|_| random.bits() as u8).collect()
    }

    #[test]
    fn a_perfect_line_changes_nothing() {
        let sent = bytes(10_000);
        let (got, injected, time) = through(Faults::default(), &sent);
        assert_eq!((got, time), (sent, Duration::ZERO));
        assert_eq!((injected.bytes_in, injected.bytes_out), (10_000, 10_000));
    }

    #[test]
    fn the_baud_rate_is_kept() {
        for baud in [9_600, 115_200, 3_000_000] {
            let (_, _, time) = through(Faults::paced(baud), &bytes(20_000));
            let wanted = 200_000.0 / f64::from(baud);
            assert!(
                (time.as_secs_f64() / wanted - 1.0).abs() < 1e-3,
                "{baud}: {time:?}"
            );
        }
    }

    #[test]
    fn a_paced_line_lets_the_sender_wait() {
        let mut line = Line::new(Faults::paced(115_200));
        assert_eq!(line.room(Duration::ZERO), BACKLOG);
        line.push(&[0; BACKLOG], Duration::ZERO);
        assert_eq!(line.room(Duration::ZERO), 0);
        let later = line.room(Duration::from_millis(10));
        assert!((114..=116).contains(&later), "{later}");
    }

    #[test]
    fn inverted_bits_are_counted_exactly_and_as_many_as_asked_for() {
        let sent = bytes(500_000);
        let faults = Faults {
            bit_error_rate: 1e-3,
            seed: 3,
            ..Faults::default()
        };
        let (got, injected, _) = through(faults, &sent);
        let flipped: u32 = sent
            .iter()
            .zip(&got)
            .map(|(a, b)| (a ^ b).count_ones())
            .sum();
        let damaged = sent.iter().zip(&got).filter(|(a, b)| a != b).count();
        assert_eq!(u64::from(flipped), injected.bits_flipped);
        assert_eq!(damaged as u64, injected.bytes_damaged);
        // 4000 ± 63
        assert!((3700..4300).contains(&flipped), "{flipped}");
    }

    #[test]
    fn lost_and_doubled_bytes_are_counted_exactly() {
        let faults = Faults {
            drop_rate: 0.01,
            duplicate_rate: 0.02,
            seed: 9,
            ..Faults::default()
        };
        let (got, n, _) = through(faults, &bytes(100_000));
        assert_eq!(got.len() as u64, 100_000 - n.dropped + n.duplicated);
        // 1000 ± 31 and 1980 ± 44
        assert!((850..1150).contains(&n.dropped), "{n:?}");
        assert!((1780..2180).contains(&n.duplicated), "{n:?}");
        let only = |drop_rate: f64, duplicate_rate: f64| {
            let faults = Faults {
                drop_rate,
                duplicate_rate,
                ..Faults::default()
            };
            through(faults, &[1, 2, 3]).0
        };
        assert_eq!(only(1.0, 0.0), []);
        assert_eq!(only(0.0, 1.0), [1, 1, 2, 2, 3, 3]);
    }

    #[test]
    fn cuts_take_exactly_their_bytes() {
        let sent: Vec<u8> = (0..100).collect();
        let faults = Faults {
            cuts: vec![10..20, 50..51],
            ..Faults::default()
        };
        let (got, injected, _) = through(faults, &sent);
        let wanted: Vec<u8> = sent
            .into_iter()
            .filter(|i| !(10..20).contains(i) && *i != 50)
            .collect();
        assert_eq!((got, injected.cut), (wanted, 11));
    }

    #[test]
    fn delay_and_jitter_keep_the_order() {
        let faults = Faults {
            delay: Duration::from_millis(5),
            jitter: Duration::from_millis(3),
            ..Faults::paced(115_200)
        };
        let sent = bytes(1_000);
        let (got, _, time) = through(faults, &sent);
        assert_eq!(got, sent);
        let over = time.as_secs_f64() - 10_000.0 / 115_200.0;
        assert!((0.005..0.008).contains(&over), "{over}");
    }

    #[test]
    fn chunks_do_not_matter_and_the_seed_decides() {
        let sent = bytes(50_000);
        let run = |seed, chunk| {
            let mut line = Line::new(Faults {
                bit_error_rate: 1e-4,
                drop_rate: 1e-3,
                duplicate_rate: 1e-3,
                seed,
                ..Faults::default()
            });
            let mut out = Vec::new();
            for part in sent.chunks(chunk) {
                line.push(part, Duration::ZERO);
                line.pull(Duration::ZERO, &mut out);
            }
            out
        };
        assert_eq!(run(1, 1), run(1, 777));
        assert_ne!(run(1, 777), run(2, 777));
    }
}
