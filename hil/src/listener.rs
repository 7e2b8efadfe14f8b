//! The host's side: what the module reports, and requests to it.

use crate::sent_map::SentMap;
use rugosa_wire::{Ack, Event, Hello, Link, MAX_FRAME, Message, Role, Status, counter};
use std::collections::VecDeque;

/// Everything the module has told.
pub struct Listener {
    link: Link,
    requests: VecDeque<Message>,
    /// counters after each sweep and every second, with the number of complete sweeps
    pub statuses: Vec<Status>,
    /// answers to requests
    pub acks: Vec<Ack>,
    /// answers to echoes
    pub echoes: Vec<Vec<u8>>,
    /// sinks that came
    pub sinks: u32,
    /// the map as the module has sent it since it was started
    pub map: SentMap,
}

impl Listener {
    /// A host that greets in `session`.
    pub fn new(session: u32) -> Self {
        Listener {
            link: Link::new(
                Hello::new(Role::Host, "hil", env!("CARGO_PKG_VERSION")),
                session,
            ),
            requests: VecDeque::new(),
            statuses: Vec::new(),
            acks: Vec::new(),
            echoes: Vec::new(),
            sinks: 0,
            map: SentMap::default(),
        }
    }

    /// Its link.
    pub fn link(&self) -> &Link {
        &self.link
    }

    /// The session of the module, once it has greeted.
    pub fn module_session(&self) -> Option<u32> {
        self.link.peer().map(|peer| peer.session)
    }

    /// Asks the module for something.
    pub fn request(&mut self, message: Message) {
        self.requests.push_back(message);
    }

    /// The last status.
    pub fn status(&self) -> Option<&Status> {
        self.statuses.last()
    }

    /// A counter of the last status; 0 before the first.
    pub fn counter(&self, index: usize) -> u32 {
        let counters = self.status().map(|status| &status.counters);
        counters
            .and_then(|all| all.get(index))
            .copied()
            .unwrap_or(0)
    }

    /// Complete sweeps of the last status.
    pub fn sweeps(&self) -> u32 {
        self.counter(counter::SWEEPS)
    }

    /// Statuses since the module was started last.
    pub fn statuses_of_this_session(&self) -> &[Status] {
        let starts = self
            .statuses
            .windows(2)
            .rposition(|pair| pair[1].uptime_us < pair[0].uptime_us);
        &self.statuses[starts.map_or(0, |at| at + 1)..]
    }

    /// Returns in the lines of the last complete sweep.
    pub fn returns_of_last_sweep(&self) -> u32 {
        let at = |status: &Status, index: usize| status.counters.get(index).copied().unwrap_or(0);
        let sweeps = self.sweeps();
        let mut before = self.statuses_of_this_session().iter().rev();
        let before = before.find(|status| at(status, counter::SWEEPS) != sweeps);
        let before = before.map_or(0, |status| at(status, counter::RETURNS_RECEIVED));
        self.counter(counter::RETURNS_RECEIVED).wrapping_sub(before)
    }

    /// Takes bytes of the module.
    pub fn receive(&mut self, mut bytes: &[u8], now_us: u64) {
        while let Some(event) = self.link.receive(&mut bytes, now_us) {
            match event {
                Event::Message(frame) => self.take(frame.message),
                Event::Connected { resumed: false } => self.map = SentMap::default(),
                _ => {}
            }
        }
    }

    fn take(&mut self, message: Message) {
        match message {
            Message::Status(status) => self.statuses.push(status),
            Message::Patch(patch) => self.map.place(&patch),
            Message::Ack(ack) => self.acks.push(ack),
            Message::EchoReply(bytes) => self.echoes.push(bytes.to_vec()),
            Message::Sink { .. } => self.sinks += 1,
            _ => {}
        }
    }

    /// The next frame to the module; empty: none.
    pub fn next_frame(&mut self, now_us: u64) -> Vec<u8> {
        let mut buffer = [0; MAX_FRAME];
        let mut length = self.link.tend(now_us, &mut buffer);
        if length == 0
            && self.link.is_connected()
            && let Some(request) = self.requests.pop_front()
        {
            length = self.link.send(&request, now_us, &mut buffer).unwrap_or(0);
        }
        buffer[..length].to_vec()
    }
}
