//! Self-tests of a link, as the best robot links have them: echo, source, sink.
//!
//! [`Message::Echo`] comes back as [`Message::EchoReply`] (round-trip time),
//! [`Message::Source`] asks for a run of [`Message::Sink`] (throughput and losses from
//! the device), and a sink is counted and thrown away (the same towards the device).

use heapless::Vec;

use crate::message::{MAX_ECHO, Message};

/// Number of the parameter that makes a module do nothing for so many seconds, as if a
/// stage took that long.
pub const STALL: u8 = 253;
/// Number of the parameter that makes a module panic when it is set: it says so in its
/// log, counts and starts afresh.
pub const PANIC: u8 = 254;
/// Number of the parameter that makes a module hang when it is set: its watchdog bites.
pub const HANG: u8 = 255;

/// The answering side of the self-tests.
///
/// ```
/// use rugosa_wire::{Message, SelfTest};
/// let mut test = SelfTest::default();
/// let bytes = heapless::Vec::from_slice(b"are you there?").unwrap();
/// assert!(test.take(&Message::Echo(bytes.clone())));
/// assert_eq!(test.due(), Some(Message::EchoReply(bytes)));
/// // a run of three sinks
/// test.take(&Message::Source { count: 3 });
/// let sinks: Vec<Message> = std::iter::from_fn(|| test.due()).collect();
/// assert!(matches!(sinks[..], [_, _, Message::Sink { index: 2, .. }]));
/// sinks.iter().for_each(|sink| assert!(test.take(sink)));
/// assert_eq!((test.sunk, test.take(&Message::Refresh)), (3, false));
/// ```
#[derive(Clone, Debug, Default)]
pub struct SelfTest {
    echo: Option<Vec<u8, MAX_ECHO>>,
    index: u32,
    count: u32,
    /// sinks received
    pub sunk: u32,
}

impl SelfTest {
    /// Takes a message of a self-test; `false`: it is none.
    pub fn take(&mut self, message: &Message) -> bool {
        match message {
            Message::Echo(bytes) => self.echo = Some(bytes.clone()),
            Message::Source { count } => (self.index, self.count) = (0, *count),
            Message::Sink { .. } => self.sunk = self.sunk.wrapping_add(1),
            _ => return false,
        }
        true
    }

    /// The answer that is due. An echo that comes before the last was answered replaces
    /// it; the filler of a sink is its index, over and over.
    pub fn due(&mut self) -> Option<Message> {
        if let Some(bytes) = self.echo.take() {
            return Some(Message::EchoReply(bytes));
        }
        if self.index >= self.count {
            return None;
        }
        let index = self.index;
        self.index += 1;
        let filler = index.to_le_bytes().into_iter().cycle().take(MAX_ECHO);
        Some(Message::Sink {
            index,
            filler: filler.collect(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn echo_source_and_sink() {
        let mut test = SelfTest::default();
        assert!(!test.take(&Message::Refresh));
        assert_eq!(test.due(), None);
        let bytes = Vec::from_slice(b"hello").unwrap();
        assert!(test.take(&Message::Source { count: 300 }));
        assert!(test.take(&Message::Echo(bytes.clone())));
        assert_eq!(test.due(), Some(Message::EchoReply(bytes)));
        for i in 0..300 {
            let sink = test.due().unwrap();
            assert!(matches!(sink, Message::Sink { index, .. } if index == i));
            test.take(&sink);
        }
        assert_eq!((test.due(), test.sunk), (None, 300));
    }
}
