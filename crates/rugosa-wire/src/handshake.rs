//! Who is on the other side: greeting, sessions, refusal.
//!
//! Each side draws a session number at every start (never 0, not one of its last few)
//! and puts it into all its frames. Both send [`Hello`] every [`RETRY_US`] until they
//! know that the other has heard it: `heard` names the session a greeting answers, and
//! `asking` says that an answer is wanted. Three greetings make a connection:
//!
//! ```text
//! A → B   session a, heard 0, asking
//! B → A   session b, heard a, asking        A is connected
//! A → B   session a, heard b                B is connected
//! ```
//!
//! Any of them may be lost or come twice. A new session of the peer starts all counts
//! afresh; a silence does not, so that a link that was unplugged goes on where it was.

use core::fmt;

use crate::frame::{Header, Version};
use crate::message::Hello;
use crate::sequence::{Order, Sequence};

/// Time between two greetings while there is no connection, microseconds.
pub const RETRY_US: u64 = 250_000;
/// Longest time without sending anything, microseconds.
pub const HEARTBEAT_US: u64 = 500_000;
/// Longest wait for credit without saying so, microseconds.
pub const STALL_US: u64 = 100_000;
/// A peer is gone when nothing came from it for this long, microseconds.
pub const SILENCE_US: u64 = 2_000_000;

/// The peer speaks another protocol.
///
/// ```
/// use rugosa_wire::{PROTOCOL, Refusal, Version};
/// let newer = Version { protocol: PROTOCOL + 1, schema: 0 };
/// let refusal = Refusal { ours: Version::OURS, theirs: newer };
/// assert!(refusal.to_string().ends_with("update the software on this side"));
/// let refusal = Refusal { ours: newer, theirs: Version::OURS };
/// assert!(refusal.to_string().ends_with("update the peer"));
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Refusal {
    /// what this side speaks
    pub ours: Version,
    /// what the peer speaks
    pub theirs: Version,
}

impl fmt::Display for Refusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Refusal { ours, theirs } = self;
        write!(
            f,
            "refused: the peer speaks {theirs}, this side {ours}; update the "
        )?;
        f.write_str(match theirs.protocol.cmp(&ours.protocol) {
            core::cmp::Ordering::Less => "peer",
            core::cmp::Ordering::Equal => "older of the two",
            core::cmp::Ordering::Greater => "software on this side",
        })
    }
}

impl core::error::Error for Refusal {}

/// What is known of the peer.
///
/// ```
/// use rugosa_wire::{Event, Hello, Link, MAX_FRAME, Role};
/// let mut host = Link::new(Hello::new(Role::Host, "desk", "0.1.0"), 31);
/// let mut module = Link::new(Hello::new(Role::Module, "rugosa", "0.1.0"), 32);
/// let mut buffer = [0; MAX_FRAME];
/// let length = host.tend(0, &mut buffer);
/// assert_eq!(module.receive(&mut &buffer[..length], 0), None);
/// // one greeting tells who is there, but not yet that it can hear
/// let peer = module.peer().unwrap();
/// assert_eq!((peer.session, peer.hello.role), (31, Role::Host));
/// assert!(!peer.is_connected());
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Peer {
    /// number of its session
    pub session: u32,
    /// its last greeting
    pub hello: Hello,
    expected: Sequence,
    is_connected: bool,
    was_connected: bool,
}

impl Peer {
    /// Each side has heard the other.
    pub fn is_connected(&self) -> bool {
        self.is_connected
    }
}

/// What a greeting changed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Greeted {
    /// the peer's session is new: all counts start afresh
    pub is_new: bool,
    /// there is a connection, and the peer may have missed what was said before
    pub connected: bool,
    /// there was one before, in the same session
    pub resumed: bool,
    /// frames that are missing before the greeting
    pub lost: u16,
}

/// The state of the handshake on one side.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Handshake {
    /// what this side says of itself; `heard` and `asking` are filled in
    hello: Hello,
    session: u32,
    pub peer: Option<Peer>,
    answer_due: bool,
    greeted_us: Option<u64>,
}

impl Handshake {
    pub fn new(hello: Hello, session: u32) -> Self {
        Handshake {
            hello,
            session: session.max(1),
            peer: None,
            answer_due: false,
            greeted_us: None,
        }
    }

    pub fn session(&self) -> u32 {
        self.session
    }

    pub fn is_connected(&self) -> bool {
        self.peer.as_ref().is_some_and(Peer::is_connected)
    }

    /// The peer has fallen silent or cannot be spoken to.
    pub fn disconnect(&mut self) {
        if let Some(peer) = &mut self.peer {
            peer.is_connected = false;
        }
    }

    /// A greeting from another session than ours.
    pub fn hear(&mut self, header: Header, hello: Hello) -> Greeted {
        let mut known = self.peer.take().filter(|p| p.session == header.session);
        let lost = known
            .as_mut()
            .map_or(0, |p| p.expected.missing(header.sequence));
        let is_connected = hello.heard == self.session;
        let was_connected = known.as_ref().is_some_and(Peer::is_connected);
        let resumed = known.as_ref().is_some_and(|p| p.was_connected);
        let greeted = Greeted {
            is_new: known.is_none(),
            connected: is_connected && (hello.asking || !was_connected),
            resumed,
            lost,
        };
        self.answer_due |= hello.asking;
        self.peer = Some(Peer {
            session: header.session,
            hello,
            expected: Sequence::after(header.sequence),
            is_connected,
            was_connected: resumed || is_connected,
        });
        greeted
    }

    /// Any other frame: `None` where it is not of a session that has been connected. A
    /// silence does not end a session: what comes after it, before new greetings have
    /// gone to and fro, is not lost.
    pub fn judge(&mut self, header: Header) -> Option<Order> {
        let peer = self.peer.as_mut()?;
        let is_theirs = peer.was_connected && peer.session == header.session;
        is_theirs.then(|| peer.expected.judge(header.sequence))
    }

    /// The greeting that is due.
    pub fn due(&mut self, now_us: u64) -> Option<Hello> {
        let since = self.greeted_us.map(|then| now_us.saturating_sub(then));
        let retry = !self.is_connected() && since.is_none_or(|us| us >= RETRY_US);
        if !retry && !self.answer_due {
            return None;
        }
        (self.answer_due, self.greeted_us) = (false, Some(now_us));
        self.hello.heard = self.peer.as_ref().map_or(0, |peer| peer.session);
        self.hello.asking = !self.is_connected();
        Some(self.hello.clone())
    }
}
