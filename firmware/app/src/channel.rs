//! One port with its link: the chunk being read and the frame being written.
//!
//! Nothing here waits. A frame is made only when the one before has gone, so a slow
//! listener slows down what is made for it and nothing else.

use crate::design_parameters::{CHUNK, LINES_GRANTED, lines_granted};
use crate::platform::Port;
use core::ops::Range;
use rugosa_wire::{Event, Hello, Link, MAX_FRAME, Message, Role, SelfTest, Unsent};

/// State of one port.
pub struct Channel {
    /// the link
    pub link: Link,
    /// answers to self-tests
    pub self_test: SelfTest,
    input: [u8; CHUNK],
    unread: Range<usize>,
    output: [u8; MAX_FRAME],
    unsent: Range<usize>,
    errors: u32,
    /// of the lines and tables so far, bytes
    longest: usize,
}

impl Channel {
    /// A channel that will greet with `hello`.
    pub fn new(hello: Hello, session: u32) -> Self {
        let mut link = Link::new(hello, session);
        link.offer(LINES_GRANTED);
        Channel {
            link,
            self_test: SelfTest::default(),
            input: [0; CHUNK],
            unread: 0..0,
            output: [0; MAX_FRAME],
            unsent: 0..0,
            errors: 0,
            longest: 0,
        }
    }

    /// The next event, of bytes that are there already.
    pub fn receive(&mut self, port: &mut impl Port, now_us: u64) -> Option<Event> {
        if self.unread.is_empty() && port.read_ready().unwrap_or(false) {
            match port.read(&mut self.input) {
                Ok(length) => self.unread = 0..length,
                Err(_) => self.errors = self.errors.wrapping_add(1),
            }
        }
        let mut rest = &self.input[self.unread.clone()];
        let event = self.link.receive(&mut rest, now_us);
        self.unread.start = self.unread.end - rest.len();
        event
    }

    /// Offers room for as many lines as the queue holds: from the first line on, of the
    /// longest so far; before, of the longest there are.
    pub fn offer(&mut self, message: &Message) {
        self.longest = self.longest.max(long_bytes(message));
        if let Message::Line(_) = message {
            self.link.offer(lines_granted(self.longest));
        }
    }

    /// Another scanner may send longer lines.
    pub fn offer_afresh(&mut self) {
        self.longest = 0;
        self.link.offer(LINES_GRANTED);
    }

    /// Is it connected to a peer of this role?
    pub fn is_to(&self, role: Role) -> bool {
        let peer = self.link.peer().filter(|peer| peer.is_connected());
        peer.is_some_and(|peer| peer.hello.role == role)
    }

    /// Receive errors that the port has told of (framing, parity, overrun).
    pub fn errors(&self) -> u32 {
        self.errors
    }

    /// Has everything gone?
    pub fn is_idle(&self) -> bool {
        self.unsent.is_empty()
    }

    /// Hands over as much as the port takes without waiting.
    pub fn flush(&mut self, port: &mut impl Port) {
        if !self.unsent.is_empty() {
            self.unsent.start += port.try_write(&self.output[self.unsent.clone()]);
        }
    }

    /// Makes a frame of `message`; to be called when idle.
    pub fn send(&mut self, message: &Message, now_us: u64) -> Result<(), Unsent> {
        let length = self.link.send(message, now_us, &mut self.output)?;
        self.unsent = 0..length;
        Ok(())
    }

    /// Makes the next frame of the link itself or of a self-test; `false`: none is due.
    pub fn tend(&mut self, now_us: u64) -> bool {
        self.unsent = 0..self.link.tend(now_us, &mut self.output);
        if self.is_idle()
            && let Some(message) = self.self_test.due()
        {
            let _ = self.send(&message, now_us); // without a connection nobody waits for it
        }
        !self.is_idle()
    }
}

/// Most bytes of the frame of a long message; 0 of others.
fn long_bytes(message: &Message) -> usize {
    const REST: usize = 48; // header, other fields, checksum, delimiters
    match message {
        Message::Line(line) => line.ranges.len() + line.reflectances.len() + REST,
        Message::BeamTable(table) => 5 * table.angles_urad.len() + REST,
        _ => 0,
    }
}
