//! One end of the link: decoder, handshake, running numbers, credit and heartbeat.
//!
//! No clock and no port: the caller passes the time in microseconds and moves the bytes.
//! The loop of scanner, module and host is the same:
//!
//! ```text
//! for each chunk of bytes (or none, at least every 100 ms):
//!     while let Some(event) = link.receive(&mut chunk, now) { … }
//!     loop { match link.tend(now, &mut buffer) { 0 => break, n => write(&buffer[..n]) } }
//!     n = link.send(&message, now, &mut buffer)?; write(&buffer[..n])
//! ```
//!
//! After every [`Event::Connected`] a scanner sends its description and tables again;
//! with `resumed` false the peer knows nothing at all.

use core::fmt;

use crate::counter;
use crate::credit::{Granter, Spender};
use crate::frame::{Broken, Decoder, Frame, Header, Version, encode};
use crate::handshake::{HEARTBEAT_US, Handshake, Peer, Refusal, SILENCE_US, STALL_US};
use crate::message::{Heartbeat, Hello, Message, capability};
use crate::sequence::Order;

/// What came of the bytes, or of the time.
#[derive(Clone, Debug, PartialEq)]
#[allow(clippy::large_enum_variant)]
pub enum Event {
    /// there is a connection; [`Link::peer`] says to whom
    Connected {
        /// the peer is in the same session as before
        resumed: bool,
    },
    /// nothing came from the peer for a while; greeting it again
    Silent,
    /// the peer speaks another protocol and is not listened to
    Refused(Refusal),
    /// a message of the connected peer
    Message(Frame),
    /// a frame was thrown away
    Broken(Broken),
}

/// Why a message cannot be sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unsent {
    /// there is no connection
    NotConnected,
    /// a line or a table, and the peer has no room for it
    NoCredit,
    /// the buffer is too short; [`crate::MAX_FRAME`] bytes always suffice
    BufferFull,
}

impl fmt::Display for Unsent {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Unsent::NotConnected => "not sent: no connection",
            Unsent::NoCredit => "not sent: the peer has no room for lines and tables",
            Unsent::BufferFull => "not sent: the buffer is too short",
        })
    }
}

impl core::error::Error for Unsent {}

/// What a link counts besides its decoder. Counters wrap.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Tally {
    /// frames missing in the running numbers
    pub lost: u32,
    /// frames received twice
    pub duplicates: u32,
    /// frames of a session that has not greeted or has ended
    pub stale: u32,
    /// frames sent
    pub frames_sent: u32,
    /// bytes sent
    pub bytes_sent: u32,
    /// handshakes completed
    pub sessions: u32,
    /// times the peer fell silent
    pub silences: u32,
}

fn count(counter: &mut u32, n: u32) {
    *counter = counter.wrapping_add(n);
}

/// One end of the link.
///
/// ```
/// use rugosa_wire::{Event, Hello, Link, MAX_FRAME, Role};
/// let mut scanner = Link::new(Hello::new(Role::Scanner, "simulated", "0.1.0"), 11);
/// let mut module = Link::new(Hello::new(Role::Module, "rugosa", "0.1.0"), 22);
/// let mut buffer = [0; MAX_FRAME];
/// for _ in 0..3 {
///     let length = scanner.tend(0, &mut buffer);
///     let mut bytes = &buffer[..length];
///     while let Some(event) = module.receive(&mut bytes, 0) { /* … */ }
///     let length = module.tend(0, &mut buffer);
///     let mut bytes = &buffer[..length];
///     while let Some(event) = scanner.receive(&mut bytes, 0) { /* … */ }
/// }
/// assert!(scanner.is_connected() && module.is_connected());
/// ```
#[derive(Clone, Debug)]
pub struct Link {
    decoder: Decoder,
    handshake: Handshake,
    spender: Spender,
    granter: Granter,
    tally: Tally,
    grants: bool,
    is_stalled: bool,
    sequence: u16,
    heard_us: u64,
    sent_us: u64,
}

impl Link {
    /// A link that will greet with `hello`. `session` must differ from those of the
    /// last few starts: a counter kept over resets, a random number, the time.
    pub fn new(hello: Hello, session: u32) -> Self {
        Link {
            grants: hello.capabilities & capability::FLOW_CONTROL != 0,
            decoder: Decoder::new(),
            handshake: Handshake::new(hello, session),
            spender: Spender::default(),
            granter: Granter::default(),
            tally: Tally::default(),
            is_stalled: false,
            sequence: 0,
            heard_us: 0,
            sent_us: 0,
        }
    }

    /// Takes bytes off the front of `bytes` up to the next event; `None`: all are taken.
    /// To be called without bytes too, as a silence is noticed here.
    ///
    /// ```
    /// # use rugosa_wire::{Event, Hello, Link, MAX_FRAME, Message, Role, handshake::SILENCE_US};
    /// # let mut scanner = Link::new(Hello::new(Role::Scanner, "simulated", "0.1.0"), 11);
    /// # let mut module = Link::new(Hello::new(Role::Module, "rugosa", "0.1.0"), 22);
    /// # let mut buffer = [0; MAX_FRAME];
    /// # for _ in 0..3 {
    /// #     let length = scanner.tend(0, &mut buffer);
    /// #     module.receive(&mut &buffer[..length], 0);
    /// #     let length = module.tend(0, &mut buffer);
    /// #     scanner.receive(&mut &buffer[..length], 0);
    /// # }
    /// // two links that have greeted each other
    /// let length = module.send(&Message::Refresh, 1000, &mut buffer).unwrap();
    /// let Some(Event::Message(frame)) = scanner.receive(&mut &buffer[..length], 1000) else {
    ///     panic!("the message has come");
    /// };
    /// assert_eq!((frame.message, frame.header.session), (Message::Refresh, 22));
    /// // a second frame with the same number is not told again
    /// assert_eq!(scanner.receive(&mut &buffer[..length], 2000), None);
    /// assert_eq!(scanner.tally().duplicates, 1);
    /// let later = 1000 + SILENCE_US + 1;
    /// assert_eq!(scanner.receive(&mut &[][..], later), Some(Event::Silent));
    /// ```
    pub fn receive(&mut self, bytes: &mut &[u8], now_us: u64) -> Option<Event> {
        while let Some(result) = self.decoder.pull(bytes) {
            let event = match result {
                Ok(frame) => self.admit(frame, now_us),
                Err(Broken::Version(theirs)) => Some(self.refuse(theirs)),
                Err(broken) => Some(Event::Broken(broken)),
            };
            if event.is_some() {
                return event;
            }
        }
        self.notice_silence(now_us)
    }

    /// Writes the next frame the link itself has to send; 0: nothing is due.
    pub fn tend(&mut self, now_us: u64, buffer: &mut [u8]) -> usize {
        if let Some(hello) = self.handshake.due(now_us) {
            return self.greet(hello, now_us, buffer);
        }
        if !self.is_connected() {
            return 0;
        }
        match self.due(now_us) {
            Some(message) => self.put(&message, now_us, buffer).unwrap_or(0),
            None => 0,
        }
    }

    /// Writes one frame with `message` to the front of `buffer`; returns its length.
    ///
    /// ```
    /// use rugosa_wire::{Hello, Link, MAX_FRAME, Message, Role, Unsent};
    /// # let mut scanner = Link::new(Hello::new(Role::Scanner, "simulated", "0.1.0"), 11);
    /// # let mut module = Link::new(Hello::new(Role::Module, "rugosa", "0.1.0"), 22);
    /// let mut buffer = [0; MAX_FRAME];
    /// let early = scanner.send(&Message::Refresh, 0, &mut buffer);
    /// assert_eq!(early, Err(Unsent::NotConnected));
    /// # for _ in 0..3 {
    /// #     let length = scanner.tend(0, &mut buffer);
    /// #     module.receive(&mut &buffer[..length], 0);
    /// #     let length = module.tend(0, &mut buffer);
    /// #     scanner.receive(&mut &buffer[..length], 0);
    /// # }
    /// // … after the greetings
    /// let before = *scanner.tally();
    /// let length = scanner.send(&Message::Refresh, 0, &mut buffer).unwrap();
    /// assert_eq!(scanner.tally().frames_sent, before.frames_sent + 1);
    /// assert_eq!(scanner.tally().bytes_sent, before.bytes_sent + length as u32);
    /// assert_eq!(scanner.send(&Message::Refresh, 0, &mut [0; 4]), Err(Unsent::BufferFull));
    /// ```
    pub fn send(
        &mut self,
        message: &Message,
        now_us: u64,
        buffer: &mut [u8],
    ) -> Result<usize, Unsent> {
        if !self.is_connected() {
            return Err(Unsent::NotConnected);
        }
        let is_long = message.is_on_credit();
        if is_long && !self.may_send_long() {
            self.is_stalled = true;
            return Err(Unsent::NoCredit);
        }
        let length = self.put(message, now_us, buffer)?;
        if is_long {
            self.spender.spend();
            self.is_stalled = false;
        }
        Ok(length)
    }

    /// There is room for this many lines and tables now. Grants them to the peer if this side
    /// greets with [`capability::FLOW_CONTROL`].
    ///
    /// ```
    /// use rugosa_wire::{BeamTable, Hello, Link, Message, Role, TableKind, Unsent, capability};
    /// # let talk = |from: &mut Link, to: &mut Link| {
    /// #     let mut buffer = [0; rugosa_wire::MAX_FRAME];
    /// #     let length = from.tend(0, &mut buffer);
    /// #     to.receive(&mut &buffer[..length], 0);
    /// # };
    /// # let mut scanner = Link::new(Hello::new(Role::Scanner, "simulated", "0.1.0"), 11);
    /// let mut hello = Hello::new(Role::Module, "rugosa", "0.1.0");
    /// hello.capabilities |= capability::FLOW_CONTROL;
    /// let mut module = Link::new(hello, 22);
    /// # for _ in 0..3 { talk(&mut scanner, &mut module); talk(&mut module, &mut scanner); }
    /// // … after the greetings
    /// assert!(scanner.is_connected() && !scanner.may_send_long());
    /// module.offer(1); // there is room for one table
    /// talk(&mut module, &mut scanner);
    /// let (kind, mut buffer) = (TableKind::Azimuth, [0; 99]);
    /// let table = BeamTable { kind, first: 0, angles_urad: Default::default() };
    /// let table = Message::BeamTable(table);
    /// let length = scanner.send(&table, 0, &mut buffer).unwrap();
    /// assert_eq!(scanner.send(&table, 0, &mut [0; 99]), Err(Unsent::NoCredit));
    /// module.receive(&mut &buffer[..length], 0); // taken: there is room again
    /// talk(&mut module, &mut scanner);
    /// assert!(scanner.may_send_long());
    /// ```
    pub fn offer(&mut self, room: u16) {
        self.granter.offer(room);
    }

    /// Has the peer room for a line or a table?
    pub fn may_send_long(&self) -> bool {
        let limits = |peer: &Peer| peer.hello.capabilities & capability::FLOW_CONTROL != 0;
        !self.peer().is_some_and(limits) || self.spender.has_credit()
    }

    /// Each side has heard the other.
    pub fn is_connected(&self) -> bool {
        self.handshake.is_connected()
    }

    /// Who is on the other side.
    pub fn peer(&self) -> Option<&Peer> {
        self.handshake.peer.as_ref()
    }

    /// The session of this side.
    pub fn session(&self) -> u32 {
        self.handshake.session()
    }

    /// The decoder and what it counted.
    pub fn decoder(&self) -> &Decoder {
        &self.decoder
    }

    /// What the link counted itself.
    pub fn tally(&self) -> &Tally {
        &self.tally
    }

    /// The port was closed and opened again: drops the frame in progress and greets anew.
    ///
    /// ```
    /// # use rugosa_wire::{Event, Hello, Link, MAX_FRAME, Role};
    /// # let mut host = Link::new(Hello::new(Role::Host, "desk", "0.1.0"), 11);
    /// # let mut module = Link::new(Hello::new(Role::Module, "rugosa", "0.1.0"), 22);
    /// # let mut buffer = [0; MAX_FRAME];
    /// # let mut talk = |host: &mut Link, module: &mut Link, now| {
    /// #     let length = host.tend(now, &mut buffer);
    /// #     module.receive(&mut &buffer[..length], now);
    /// #     let length = module.tend(now, &mut buffer);
    /// #     host.receive(&mut &buffer[..length], now)
    /// # };
    /// # (0..3).for_each(|_| { talk(&mut host, &mut module, 0); });
    /// assert!(host.is_connected());
    /// host.reopen();
    /// assert!(!host.is_connected());
    /// // the next greeting, a quarter of a second later, finds the same session
    /// let event = talk(&mut host, &mut module, 250_000);
    /// assert_eq!(event, Some(Event::Connected { resumed: true }));
    /// ```
    pub fn reopen(&mut self) {
        self.decoder.restart();
        self.handshake.disconnect();
    }

    /// Writes the link's counters to their places among all (see [`crate::counter`]).
    ///
    /// ```
    /// use rugosa_wire::{COUNTERS, Hello, Link, MAX_FRAME, Role, counter};
    /// let mut link = Link::new(Hello::new(Role::Host, "desk", "0.1.0"), 5);
    /// let mut buffer = [0; MAX_FRAME];
    /// let length = link.tend(0, &mut buffer); // a greeting
    /// let mut counters = [0; COUNTERS];
    /// link.fill(&mut counters);
    /// assert_eq!(counters[counter::LINK_FRAMES_SENT], 1);
    /// // the delimiter before a greeting is not counted
    /// assert_eq!(counters[counter::LINK_BYTES_SENT], length as u32 - 1);
    /// ```
    pub fn fill(&self, counters: &mut [u32]) {
        let (decoder, tally) = (self.decoder.counts(), &self.tally);
        for (index, value) in [
            (counter::LINK_BYTES, decoder.bytes),
            (counter::LINK_FRAMES, decoder.frames),
            (counter::LINK_BAD_COBS, decoder.bad_cobs),
            (counter::LINK_BAD_CRC, decoder.bad_crc),
            (counter::LINK_BAD_MESSAGE, decoder.bad_message),
            (counter::LINK_OVER_LONG, decoder.over_long),
            (counter::LINK_UNKNOWN_VERSION, decoder.unknown_version),
            (counter::LINK_LOST, tally.lost),
            (counter::LINK_DUPLICATES, tally.duplicates),
            (counter::LINK_STALE, tally.stale),
            (counter::LINK_BYTES_SENT, tally.bytes_sent),
            (counter::LINK_FRAMES_SENT, tally.frames_sent),
            (counter::LINK_SESSIONS, tally.sessions),
            (counter::LINK_SILENCES, tally.silences),
            (counter::CREDIT_LIMIT, self.granter.limit()),
        ] {
            if let Some(place) = counters.get_mut(index) {
                *place = value;
            }
        }
    }

    fn admit(&mut self, frame: Frame, now_us: u64) -> Option<Event> {
        if frame.header.session == self.session() {
            count(&mut self.tally.stale, 1); // our own echo
            return None;
        }
        if let Message::Hello(hello) = frame.message {
            return self.greeted(frame.header, hello, now_us);
        }
        match self.handshake.judge(frame.header) {
            None => count(&mut self.tally.stale, 1),
            Some(Order::Duplicate) => count(&mut self.tally.duplicates, 1),
            Some(Order::New { lost }) => {
                count(&mut self.tally.lost, lost.into());
                self.heard_us = now_us;
                return self.take(frame);
            }
        }
        None
    }

    fn greeted(&mut self, header: Header, hello: Hello, now_us: u64) -> Option<Event> {
        let greeted = self.handshake.hear(header, hello);
        self.heard_us = now_us;
        count(&mut self.tally.lost, greeted.lost.into());
        if greeted.is_new {
            (self.spender, self.granter) = (Spender::default(), self.granter.afresh());
            self.is_stalled = false;
        }
        count(&mut self.tally.sessions, greeted.connected.into());
        greeted.connected.then_some(Event::Connected {
            resumed: greeted.resumed,
        })
    }

    /// Credit is the link's own business, the rest the caller's.
    fn take(&mut self, frame: Frame) -> Option<Event> {
        match &frame.message {
            Message::Credit(credit) => self.spender.granted(*credit),
            Message::Heartbeat(heartbeat) => self.granter.reconcile(heartbeat.lines),
            long if long.is_on_credit() => self.granter.took(),
            _ => {}
        }
        let is_ours = matches!(frame.message, Message::Credit(_));
        (!is_ours).then_some(Event::Message(frame))
    }

    fn refuse(&mut self, theirs: Version) -> Event {
        self.handshake.peer = None;
        Event::Refused(Refusal {
            ours: Version::OURS,
            theirs,
        })
    }

    fn notice_silence(&mut self, now_us: u64) -> Option<Event> {
        let silent = now_us.saturating_sub(self.heard_us) > SILENCE_US;
        if !silent || !self.is_connected() {
            return None;
        }
        self.handshake.disconnect();
        count(&mut self.tally.silences, 1);
        Some(Event::Silent)
    }

    fn due(&mut self, now_us: u64) -> Option<Message> {
        if let Some(credit) = self.granter.due().filter(|_| self.grants) {
            return Some(Message::Credit(credit));
        }
        let wait = if self.is_stalled {
            STALL_US
        } else {
            HEARTBEAT_US
        };
        (now_us.saturating_sub(self.sent_us) >= wait).then_some(Message::Heartbeat(Heartbeat {
            uptime_us: now_us,
            lines: self.spender.sent,
        }))
    }

    /// A delimiter first: whatever noise is on the line, it does not swallow the greeting.
    fn greet(&mut self, hello: Hello, now_us: u64, buffer: &mut [u8]) -> usize {
        let Some((delimiter, rest)) = buffer.split_first_mut() else {
            return 0;
        };
        *delimiter = 0;
        match self.put(&Message::Hello(hello), now_us, rest) {
            Ok(length) => length + 1,
            Err(_) => 0,
        }
    }

    fn put(&mut self, message: &Message, now_us: u64, buffer: &mut [u8]) -> Result<usize, Unsent> {
        let header = Header {
            session: self.session(),
            sequence: self.sequence,
        };
        let length = encode(&header, message, buffer).map_err(|_| Unsent::BufferFull)?;
        self.sequence = self.sequence.wrapping_add(1);
        self.sent_us = now_us;
        count(&mut self.tally.frames_sent, 1);
        count(&mut self.tally.bytes_sent, length as u32);
        Ok(length)
    }
}
