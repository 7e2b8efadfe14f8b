//! Plays recorded frames or messages into any port.
//!
//! A [`Recorded`] item is bytes and the time at which they came; [`play`] passes them on
//! in real time or at any pace, whole or cut into chunks, so that a receiver can be shown
//! not to depend on how the bytes arrive. [`frames`] turns messages into such items.

use std::io::Write;
use std::time::Duration;

use anyhow::{Context, Result};
use rugosa_wire::{Header, MAX_FRAME, Message, encode};

use crate::clock::{Clock, Pace};
use crate::random::Random;

/// Bytes that came at a time \[µs\].
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Recorded {
    /// when
    pub stamp_us: u64,
    /// what, usually one frame with its delimiter
    pub bytes: Vec<u8>,
}

/// How bytes are cut before they are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Chunks {
    /// one write per item
    Whole,
    /// this many at a time, across items
    Of(usize),
    /// 1 to `most` at a time, across items
    Random {
        /// longest chunk
        most: usize,
        /// decides the lengths
        seed: u64,
    },
}

/// Frames of a session, numbered from 0, of stamped messages.
pub fn frames(
    session: u32,
    messages: impl IntoIterator<Item = (u64, Message)>,
) -> impl Iterator<Item = Recorded> {
    let number = move |(i, (stamp_us, message)): (usize, (u64, Message))| {
        let header = Header {
            session,
            sequence: i as u16,
        };
        let mut buffer = [0; MAX_FRAME];
        // MAX_FRAME bytes hold any message
        let length = encode(&header, &message, &mut buffer).unwrap_or(0);
        Recorded {
            stamp_us,
            bytes: buffer[..length].to_vec(),
        }
    };
    messages.into_iter().enumerate().map(number)
}

/// Writes all items; returns the bytes written. The last bytes of a chunk that is not
/// full are written at the end.
pub fn play(
    items: impl IntoIterator<Item = Recorded>,
    port: &mut impl Write,
    chunks: Chunks,
    (pace, clock): (Pace, &impl Clock),
) -> Result<u64> {
    let mut cutter = Cutter::new(chunks);
    let (mut first, mut total, started) = (None, 0, clock.now());
    for item in items {
        let first_us = *first.get_or_insert(item.stamp_us);
        let since = Duration::from_micros(item.stamp_us.saturating_sub(first_us));
        pace.wait(clock, started, since);
        total += item.bytes.len() as u64;
        cutter.write(&item.bytes, port)?;
    }
    port.write_all(&cutter.kept)
        .context("the last bytes cannot be played")?;
    port.flush().context("the played bytes cannot be flushed")?;
    Ok(total)
}

struct Cutter {
    chunks: Chunks,
    random: Random,
    length: usize,
    kept: Vec<u8>,
}

impl Cutter {
    fn new(chunks: Chunks) -> Self {
        let seed = match chunks {
            Chunks::Random { seed, .. } => seed,
            _ => 0,
        };
        let mut cutter = Cutter {
            chunks,
            random: Random::new(seed),
            length: 1,
            kept: Vec::new(),
        };
        cutter.length = cutter.next_length();
        cutter
    }

    fn next_length(&mut self) -> usize {
        match self.chunks {
            Chunks::Whole => 1,
            Chunks::Of(n) => n.max(1),
            Chunks::Random { most, .. } => {
                1 + (self.random.uniform() * most.max(1) as f64) as usize
            }
        }
    }

    fn write(&mut self, bytes: &[u8], port: &mut impl Write) -> Result<()> {
        if self.chunks == Chunks::Whole {
            return port.write_all(bytes).context("a frame cannot be played");
        }
        self.kept.extend_from_slice(bytes);
        while self.kept.len() >= self.length {
            port.write_all(&self.kept[..self.length])
                .context("a chunk cannot be played")?;
            self.kept.drain(..self.length);
            self.length = self.next_length();
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clock::VirtualClock;
    use rugosa_wire::{Decoder, Heartbeat};

    fn beats(n: u32) -> Vec<(u64, Message)> {
        let beat = |i: u32| {
            let uptime_us = u64::from(i) * 20_000;
            (
                uptime_us,
                Message::Heartbeat(Heartbeat {
                    uptime_us,
                    lines: i,
                }),
            )
        };
        (0..n).map(beat).collect()
    }

    /// Remembers the length of every write.
    #[derive(Default)]
    struct Writes(Vec<u8>, Vec<usize>);

    impl Write for Writes {
        fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
            self.0.extend_from_slice(bytes);
            self.1.push(bytes.len());
            Ok(bytes.len())
        }
        fn flush(&mut self) -> std::io::Result<()> {
            Ok(())
        }
    }

    #[test]
    fn chunks_change_the_writes_but_not_the_bytes() {
        let whole: Vec<u8> = frames(3, beats(50)).flat_map(|item| item.bytes).collect();
        let ways = [
            Chunks::Whole,
            Chunks::Of(1),
            Chunks::Of(7),
            Chunks::Random { most: 90, seed: 1 },
        ];
        for chunks in ways {
            let (mut port, clock) = (Writes::default(), VirtualClock::default());
            let total = play(
                frames(3, beats(50)),
                &mut port,
                chunks,
                (Pace::Unlimited, &clock),
            );
            assert_eq!(total.unwrap(), whole.len() as u64);
            assert_eq!(port.0, whole, "{chunks:?}");
            let longest = *port.1.iter().max().unwrap();
            match chunks {
                Chunks::Whole => assert_eq!(port.1.len(), 50),
                Chunks::Of(n) => assert_eq!(longest, n),
                Chunks::Random { most, .. } => assert!(longest <= most && longest > most / 2),
            }
        }
        let (mut decoder, mut bytes, mut n) = (Decoder::new(), &whole[..], 0);
        while let Some(frame) = decoder.pull(&mut bytes) {
            assert_eq!(u32::from(frame.unwrap().header.sequence), n);
            n += 1;
        }
        assert_eq!(n, 50);
    }

    #[test]
    fn stamps_are_kept_at_any_pace() {
        for (pace, seconds) in [
            (Pace::Times(1.0), 0.98),
            (Pace::Times(4.0), 0.245),
            (Pace::Unlimited, 0.0),
        ] {
            let clock = VirtualClock::default();
            play(
                frames(3, beats(50)),
                &mut Writes::default(),
                Chunks::Whole,
                (pace, &clock),
            )
            .unwrap();
            assert!(
                (clock.now().as_secs_f64() - seconds).abs() < 1e-6,
                "{pace:?}"
            );
        }
    }
}
