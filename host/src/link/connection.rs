//! A serial port kept open, with the protocol of [`rugosa_wire::Link`] on it.

use super::port::PortName;
use super::worker::{Shared, Worker};
use crate::error::Result;
use rugosa_wire::{COUNTERS, Event, Hello, Message};
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::sync::{Arc, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

/// Messages that wait for being sent.
const OUTGOING: usize = 64;

/// How to connect.
#[derive(Clone, Debug)]
pub struct Settings {
    /// which port
    pub port: PortName,
    /// bits per second
    pub baud: u32,
    /// what this side says of itself; with `capability::FLOW_CONTROL` it grants lines
    pub hello: Hello,
    /// number of the session
    pub session: u32,
    /// arrivals that may wait; when they do, reading stops and the peer has to wait
    pub queue: usize,
    /// send an echo every second to measure the round trip
    pub measure_latency: bool,
}

impl Settings {
    /// 115,200 baud, a fresh session number, a queue of 256, no echoes.
    pub fn new(port: impl Into<PortName>, hello: Hello) -> Self {
        Settings {
            port: port.into(),
            baud: 115_200,
            hello,
            session: fresh_session(),
            queue: 256,
            measure_latency: false,
        }
    }
}

/// A session number from the clock: microseconds, so it repeats after an hour and more.
fn fresh_session() -> u32 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH);
    (since.map_or(1, |d| d.as_micros()) as u32).max(1)
}

/// Something that happened, and when.
#[derive(Clone, Debug, PartialEq)]
pub struct Arrival {
    /// microseconds since the connection was opened
    pub time_us: u64,
    /// what
    pub news: News,
}

/// What can happen to a connection.
#[derive(Clone, Debug, PartialEq)]
#[allow(clippy::large_enum_variant)]
pub enum News {
    /// an event of the link
    Link(Event),
    /// the port disappeared; it is being looked for
    PortLost(String),
    /// the port is there again
    PortFound,
}

/// Round-trip times of echoes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Latency {
    /// echoes that came back
    pub samples: u32,
    /// shortest, microseconds
    pub min_us: u64,
    /// longest, microseconds
    pub max_us: u64,
    /// sum of all, microseconds
    pub sum_us: u64,
}

impl Latency {
    /// Takes one more round trip into account.
    pub fn note(&mut self, us: u64) {
        self.min_us = if self.samples == 0 {
            us
        } else {
            self.min_us.min(us)
        };
        self.max_us = self.max_us.max(us);
        self.sum_us += us;
        self.samples += 1;
    }

    /// Mean, microseconds; `None` before the first echo.
    pub fn mean_us(&self) -> Option<u64> {
        (self.samples > 0).then(|| self.sum_us / u64::from(self.samples))
    }
}

/// A look at the connection.
#[derive(Clone, Debug, PartialEq)]
pub struct State {
    /// the link's counters at their places of [`rugosa_wire::counter`]
    pub counters: [u32; COUNTERS],
    /// the peer's last greeting
    pub peer: Option<Hello>,
    /// each side has heard the other
    pub is_connected: bool,
    /// the peer has room for a line or a table
    pub may_send_long: bool,
    /// messages given to [`Connection::send`] that are not on their way yet
    pub unsent: usize,
    /// times the port disappeared
    pub port_losses: u32,
    /// round-trip times
    pub latency: Latency,
}

impl Default for State {
    fn default() -> Self {
        State {
            counters: [0; COUNTERS],
            peer: None,
            is_connected: false,
            may_send_long: false,
            unsent: 0,
            port_losses: 0,
            latency: Latency::default(),
        }
    }
}

/// A port and the thread that reads it. Dropping it sends what is waiting (for half a
/// second at most) and closes the port.
pub struct Connection {
    arrivals: Receiver<Arrival>,
    outgoing: SyncSender<Message>,
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
}

impl Connection {
    /// Opens the port. It must be there now; when it disappears later it is looked for.
    pub fn open(settings: Settings) -> Result<Self> {
        let port = settings.port.open(settings.baud)?;
        let (arrival, arrivals) = sync_channel(settings.queue.max(1));
        let (outgoing, messages) = sync_channel(OUTGOING);
        let shared = Arc::new(Shared::default());
        let worker = Worker::new(settings, port, arrival, messages, shared.clone())?;
        Ok(Connection {
            arrivals,
            outgoing,
            shared,
            thread: Some(std::thread::spawn(move || worker.run())),
        })
    }

    /// What happened next; `None` where nothing did for `timeout`.
    pub fn next(&self, timeout: Duration) -> Option<Arrival> {
        let arrival = self.arrivals.recv_timeout(timeout).ok()?;
        self.shared.taken(&arrival);
        Some(arrival)
    }

    /// Hands a message over to be sent in turn, when there is a connection and credit.
    /// Gives it back where too many are waiting.
    #[allow(clippy::result_large_err)]
    pub fn send(&self, message: Message) -> Result<(), Message> {
        self.shared.handed_over();
        self.outgoing.try_send(message).map_err(|error| {
            self.shared.sent();
            match error {
                TrySendError::Full(message) | TrySendError::Disconnected(message) => message,
            }
        })
    }

    /// A look at the counters.
    pub fn state(&self) -> State {
        let state = self
            .shared
            .state
            .lock()
            .unwrap_or_else(PoisonError::into_inner);
        State {
            unsent: self.shared.unsent(),
            ..state.clone()
        }
    }
}

impl Drop for Connection {
    fn drop(&mut self) {
        self.shared.stop();
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}
