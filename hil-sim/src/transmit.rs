//! The scanner's end of the link.
//!
//! [`Transmitter::run`] greets, describes the scanner after every connection, then sends
//! messages when they are due and the peer has room, answers self-tests, and counts. It
//! outlives its port: when that fails, `run` returns the error, the caller opens the
//! port again ([`Transmitter::reopen`]) and calls `run` again; nothing that was not sent
//! is forgotten.
//!
//! Ports must return from `read` and `write` at once or within some milliseconds
//! (serial ports: a timeout of 0); `TimedOut`, `WouldBlock` and `Interrupted` mean "not
//! now".

use std::collections::VecDeque;
use std::io::{self, ErrorKind, Read, Write};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use anyhow::{Result, anyhow, bail};
use rugosa_wire::{Event, Hello, Link, MAX_FRAME, Message, SelfTest, Unsent};

use crate::clock::{Clock, Pace};
use crate::stream::Stamped;

const NAP: Duration = Duration::from_micros(500);
/// While it sends, the transmitter listens this often.
const LISTEN: Duration = Duration::from_millis(2);

/// What was sent so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Sent {
    /// bytes of all frames
    pub bytes: u64,
    /// scan line messages
    pub lines: u64,
    /// scan line messages that came too late to be sent
    pub skipped: u64,
    /// poses
    pub poses: u64,
    /// completed sweeps
    pub sweeps: u32,
    /// connections made
    pub connections: u32,
    /// times a line had to wait for credit
    pub waits: u64,
    /// how late the latest message was \[µs\]
    pub worst_late_us: u64,
}

/// How messages are sent.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sending {
    /// at their time, or as fast as the link takes them
    pub pace: Pace,
    /// lines that are later than this are skipped and counted, as a scanner without
    /// memory does; `None`: never
    pub patience: Option<Duration>,
}

impl Sending {
    /// As fast as the link takes it, nothing skipped.
    pub const UNLIMITED: Sending = Sending {
        pace: Pace::Unlimited,
        patience: None,
    };
    /// In real time, nothing skipped.
    pub const REAL_TIME: Sending = Sending {
        pace: Pace::Times(1.0),
        patience: None,
    };
}

/// A scanner that speaks to whoever is at the other end of a port.
pub struct Transmitter<P, C> {
    port: P,
    clock: C,
    link: Link,
    description: Vec<Message>,
    /// of the description, what the peer has not been told yet
    untold: VecDeque<Message>,
    tests: SelfTest,
    sent: Sent,
    /// taken from the stream, not sent yet
    pending: Option<Stamped>,
    /// the clock and the scanner's time when the first message was due
    start: Option<(Duration, u64)>,
    listened: Duration,
}

impl<P: Read + Write, C: Clock> Transmitter<P, C> {
    /// Greets as `hello` in a session that differs from those before.
    pub fn new(port: P, clock: C, hello: Hello, session: u32) -> Self {
        Transmitter {
            port,
            clock,
            link: Link::new(hello, session),
            description: Vec::new(),
            untold: VecDeque::new(),
            tests: SelfTest::default(),
            sent: Sent::default(),
            pending: None,
            start: None,
            listened: Duration::ZERO,
        }
    }

    /// What to say first in every connection.
    pub fn describe(mut self, description: Vec<Message>) -> Self {
        self.description = description;
        self
    }

    /// What was sent so far.
    pub fn sent(&self) -> Sent {
        self.sent
    }

    /// The link, with its counters.
    pub fn link(&self) -> &Link {
        &self.link
    }

    /// Goes on with another port.
    pub fn reopen(&mut self, port: P) {
        self.port = port;
        self.link.reopen();
    }

    /// Sends all `messages`, or until `stop`; `watch` is called after every sweep.
    pub fn run(
        &mut self,
        messages: &mut impl Iterator<Item = Stamped>,
        sending: Sending,
        stop: &AtomicBool,
        watch: &mut dyn FnMut(&Sent),
    ) -> Result<Sent> {
        while !stop.load(Ordering::Relaxed) {
            let Some(next) = self.pending.take().or_else(|| messages.next()) else {
                break;
            };
            let sweeps = self.sent.sweeps;
            if let Err(error) = self.deliver(&next, sending, stop) {
                self.pending = Some(next);
                return Err(error);
            }
            if self.sent.sweeps != sweeps {
                watch(&self.sent);
            }
        }
        self.flush()?;
        Ok(self.sent)
    }

    /// Only listens and answers, for `time`: keeps the connection while nothing is sent.
    pub fn idle(&mut self, time: Duration) -> Result<()> {
        let end = self.clock.now() + time;
        while self.clock.now() < end {
            self.listen()?;
            self.nap();
        }
        Ok(())
    }

    fn deliver(&mut self, next: &Stamped, sending: Sending, stop: &AtomicBool) -> Result<()> {
        while !stop.load(Ordering::Relaxed) {
            if self.clock.now() >= self.listened + LISTEN || !self.link.is_connected() {
                self.listen()?;
            }
            let late = self.late(next, sending.pace);
            let is_line = matches!(next.message, Message::Line(_));
            if is_line
                && late
                    .zip(sending.patience)
                    .is_some_and(|(late, most)| late > most)
            {
                self.sent.skipped += 1;
                return Ok(());
            }
            if late.is_some() && self.untold.is_empty() && self.try_send(next, late)? {
                return Ok(());
            }
            self.nap();
            self.listen()?;
        }
        self.pending = Some(next.clone());
        Ok(())
    }

    /// How late the message is; `None`: it is not due, or nobody was ever there.
    fn late(&mut self, next: &Stamped, pace: Pace) -> Option<Duration> {
        if self.start.is_none() && self.link.is_connected() {
            self.start = Some((self.clock.now(), next.stamp_us));
        }
        let (started, first_us) = self.start?;
        let since = Duration::from_micros(next.stamp_us.saturating_sub(first_us));
        match pace {
            Pace::Unlimited => Some(Duration::ZERO),
            Pace::Times(speed) => self.clock.now().checked_sub(started + since.div_f64(speed)),
        }
    }

    fn try_send(&mut self, next: &Stamped, late: Option<Duration>) -> Result<bool> {
        let mut buffer = [0; MAX_FRAME];
        let now_us = self.now_us();
        let length = match self.link.send(&next.message, now_us, &mut buffer) {
            Ok(length) => length,
            Err(Unsent::NotConnected) => return Ok(false),
            Err(Unsent::NoCredit) => {
                self.sent.waits += 1;
                return Ok(false);
            }
            Err(error) => return Err(error.into()),
        };
        self.write(&buffer[..length])?;
        let late_us = late.map_or(0, |late| late.as_micros() as u64);
        self.sent.worst_late_us = self.sent.worst_late_us.max(late_us);
        match next.message {
            Message::Line(_) => self.sent.lines += 1,
            Message::Pose(_) => self.sent.poses += 1,
            Message::SweepEnd(_) => self.sent.sweeps += 1,
            _ => {}
        }
        Ok(true)
    }

    /// Takes what the peer says and answers it.
    fn listen(&mut self) -> Result<()> {
        self.listened = self.clock.now();
        let mut chunk = [0; 512];
        loop {
            let taken = self.read(&mut chunk)?;
            let mut bytes = &chunk[..taken];
            while let Some(event) = self.link.receive(&mut bytes, self.now_us()) {
                self.handle(event)?;
            }
            if taken < chunk.len() {
                break;
            }
        }
        self.tend()?;
        self.tell()
    }

    fn handle(&mut self, event: Event) -> Result<()> {
        match event {
            Event::Connected { .. } => {
                self.sent.connections += 1;
                self.untold = self.description.iter().cloned().collect();
            }
            Event::Refused(refusal) => bail!(refusal),
            Event::Message(frame) => {
                self.tests.take(&frame.message);
            }
            Event::Silent | Event::Broken(_) => {}
        }
        Ok(())
    }

    /// Goes on with the description as far as the peer has room.
    fn tell(&mut self) -> Result<()> {
        let mut buffer = [0; MAX_FRAME];
        while let Some(message) = self.untold.front() {
            match self.link.send(message, self.now_us(), &mut buffer) {
                Ok(length) => self.write(&buffer[..length])?,
                Err(Unsent::BufferFull) => bail!(Unsent::BufferFull),
                Err(_) => break, // goes on when there is room, or afresh with the next connection
            }
            self.untold.pop_front();
        }
        Ok(())
    }

    fn tend(&mut self) -> Result<()> {
        let mut buffer = [0; MAX_FRAME];
        loop {
            let now_us = self.now_us();
            match self.link.tend(now_us, &mut buffer) {
                0 => break,
                length => self.write(&buffer[..length])?,
            }
        }
        match self.link.is_connected().then(|| self.tests.due()).flatten() {
            Some(answer) => self.say(&answer),
            None => Ok(()),
        }
    }

    fn say(&mut self, message: &Message) -> Result<()> {
        let mut buffer = [0; MAX_FRAME];
        let now_us = self.now_us();
        match self.link.send(message, now_us, &mut buffer) {
            Ok(length) => self.write(&buffer[..length]),
            Err(_) => Ok(()), // the connection has just gone: said again in the next
        }
    }

    fn read(&mut self, chunk: &mut [u8]) -> Result<usize> {
        match self.port.read(chunk) {
            Err(error) if is_not_now(&error) => Ok(0),
            result => result.map_err(|error| anyhow!("the port cannot be read: {error}")),
        }
    }

    fn write(&mut self, mut bytes: &[u8]) -> Result<()> {
        self.sent.bytes += bytes.len() as u64;
        while !bytes.is_empty() {
            match self.port.write(bytes) {
                Ok(0) => bail!("the port takes no more bytes"),
                Ok(n) => bytes = &bytes[n..],
                Err(error) if is_not_now(&error) => self.nap(),
                Err(error) => bail!("the port cannot be written: {error}"),
            }
        }
        Ok(())
    }

    fn flush(&mut self) -> Result<()> {
        match self.port.flush() {
            Err(error) if !is_not_now(&error) => bail!("the port cannot be flushed: {error}"),
            _ => Ok(()),
        }
    }

    fn now_us(&self) -> u64 {
        self.clock.now().as_micros() as u64
    }

    fn nap(&self) {
        self.clock.wait_until(self.clock.now() + NAP);
    }
}

fn is_not_now(error: &io::Error) -> bool {
    matches!(
        error.kind(),
        ErrorKind::TimedOut | ErrorKind::WouldBlock | ErrorKind::Interrupted
    )
}

#[cfg(test)]
#[path = "transmit_tests.rs"]
mod tests;
