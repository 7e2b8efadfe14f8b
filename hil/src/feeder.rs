//! The scanner's side: a link, its description, and messages at the scanner's rate, or as
//! fast as the module takes them.

use crate::fingerprint;
use crate::schedule::Schedule;
use rugosa_wire::{Event, Hello, Link, MAX_FRAME, Message, Role, Unsent};
use std::collections::{HashSet, VecDeque};

/// Sends the messages of `M` and counts.
pub struct Feeder<M> {
    link: Link,
    description: Vec<Message>,
    /// what goes out before the next message
    first: VecDeque<Message>,
    messages: M,
    is_finished: bool,
    /// when lines are due; `None`: as soon as the module takes them
    pub schedule: Option<Schedule>,
    /// does it say nothing at all?
    pub is_muted: bool,
    /// scan lines sent
    pub lines: u64,
    /// fingerprints of the lines sent
    pub known: HashSet<u64>,
    /// sweeps sent to their end
    pub sweeps: u32,
    /// bytes sent
    pub bytes: u64,
}

impl<M: Iterator<Item = Message>> Feeder<M> {
    /// A scanner that says `description` in every session and then goes on with
    /// `messages`.
    pub fn new(description: Vec<Message>, messages: M) -> Self {
        Feeder {
            link: Link::new(
                Hello::new(Role::Scanner, "simulated", env!("CARGO_PKG_VERSION")),
                1,
            ),
            description,
            first: VecDeque::new(),
            messages,
            is_finished: false,
            schedule: None,
            is_muted: false,
            lines: 0,
            known: HashSet::new(),
            sweeps: 0,
            bytes: 0,
        }
    }

    /// Its link.
    pub fn link(&self) -> &Link {
        &self.link
    }

    /// Has everything been sent?
    pub fn is_finished(&self) -> bool {
        self.is_finished && self.first.is_empty()
    }

    /// Puts a message before the others.
    pub fn push(&mut self, message: Message) {
        self.first.push_back(message);
    }

    /// Takes bytes of the module; `true`: it has greeted in a session of its own.
    pub fn receive(&mut self, mut bytes: &[u8], now_us: u64) -> bool {
        let before = self.module_session();
        while let Some(event) = self.link.receive(&mut bytes, now_us) {
            if let Event::Connected { .. } = event {
                self.describe();
            }
        }
        self.module_session() != before
    }

    /// Says the description again: after each greeting and before each sweep, as it may
    /// get lost like anything else.
    fn describe(&mut self) {
        self.first.extend(self.description.iter().cloned());
    }

    /// The session of the module, once it has greeted.
    pub fn module_session(&self) -> Option<u32> {
        self.link.peer().map(|peer| peer.session)
    }

    /// Looks at the clock, as often as possible: which lines are due?
    pub fn look(&mut self, now_us: u64) {
        self.schedule.iter_mut().for_each(|s| s.look(now_us));
    }

    /// The next frame; empty: nothing may be sent now.
    pub fn next_frame(&mut self, now_us: u64) -> Vec<u8> {
        if self.is_muted {
            return Vec::new();
        }
        let mut buffer = [0; MAX_FRAME];
        let mut length = self.link.tend(now_us, &mut buffer);
        if length == 0 {
            length = self.send_next(now_us, &mut buffer);
        }
        self.bytes += length as u64;
        buffer[..length].to_vec()
    }

    fn send_next(&mut self, now_us: u64, buffer: &mut [u8]) -> usize {
        if !self.link.is_connected() {
            return 0;
        }
        let Some(message) = self.first.pop_front().or_else(|| self.messages.next()) else {
            self.is_finished = true;
            return 0;
        };
        if let (Message::Line(_), Some(schedule)) = (&message, &self.schedule)
            && !schedule.is_due()
        {
            self.first.push_front(message);
            return 0;
        }
        match self.link.send(&message, now_us, buffer) {
            Ok(length) => {
                if let Message::Line(line) = &message {
                    self.lines += 1;
                    self.known.insert(fingerprint::of_line(line));
                    self.schedule.iter_mut().for_each(|s| s.sent(now_us));
                }
                if let Message::SweepEnd(_) = &message {
                    self.sweeps += 1;
                    self.describe();
                }
                length
            }
            Err(Unsent::NoCredit | Unsent::NotConnected | Unsent::BufferFull) => {
                self.first.push_front(message);
                0
            }
        }
    }
}
