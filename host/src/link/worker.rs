//! The thread of a [`super::Connection`], and a second one that writes, as the operating
//! system makes a writer wait while the other side does not read.

use super::connection::{Arrival, News, Settings, State};
use super::port::lost;
use crate::error::{Failure, Result};
use rugosa_wire::{Event, Frame, Link, MAX_FRAME, Message, Unsent};
use serialport::SerialPort;
use std::collections::VecDeque;
use std::io::{self, ErrorKind, Read, Write};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// First and longest pause between two looks for a lost port.
const RETRY: [Duration; 2] = [Duration::from_millis(50), Duration::from_secs(2)];
/// Longest time that waiting messages hold up the end.
const LAST_WORDS: Duration = Duration::from_millis(500);
/// Pause while there is nothing to do.
const NAP: Duration = Duration::from_millis(5);
/// Time between two echoes.
const ECHO_US: u64 = 1_000_000;
/// Frames between the two threads.
const WRITE_AHEAD: usize = 4;

/// What the thread and its owner share.
#[derive(Default)]
pub(crate) struct Shared {
    pub state: Mutex<State>,
    is_stopping: AtomicBool,
    lines_waiting: AtomicUsize,
    unsent: AtomicUsize,
}

impl Shared {
    pub fn stop(&self) {
        self.is_stopping.store(true, Ordering::Relaxed);
    }

    /// The owner took an arrival.
    pub fn taken(&self, arrival: &Arrival) {
        if is_line(arrival) {
            self.lines_waiting.fetch_sub(1, Ordering::Relaxed);
        }
    }

    pub fn handed_over(&self) {
        self.unsent.fetch_add(1, Ordering::Relaxed);
    }

    pub fn sent(&self) {
        self.unsent.fetch_sub(1, Ordering::Relaxed);
    }

    pub fn unsent(&self) -> usize {
        self.unsent.load(Ordering::Relaxed)
    }
}

fn is_line(arrival: &Arrival) -> bool {
    let News::Link(Event::Message(frame)) = &arrival.news else {
        return false;
    };
    matches!(frame.message, Message::Line(_))
}

/// An open port.
struct Open {
    reader: Box<dyn SerialPort>,
    writer: SyncSender<Vec<u8>>,
    /// a frame the writer has no room for yet
    stuck: Option<Vec<u8>>,
}

impl Open {
    fn new(reader: Box<dyn SerialPort>) -> Result<Self> {
        let port = reader.try_clone().map_err(Failure::runtime)?;
        let (writer, frames) = sync_channel(WRITE_AHEAD);
        std::thread::spawn(move || write(port, &frames));
        Ok(Open {
            reader,
            writer,
            stuck: None,
        })
    }

    /// Hands the stuck frame over; `true`: there is room for more.
    fn has_room(&mut self) -> bool {
        let Some(frame) = self.stuck.take() else {
            return true;
        };
        match self.writer.try_send(frame) {
            Err(TrySendError::Full(frame)) => self.stuck = Some(frame),
            // a dead writer: the reader will find out why
            Ok(()) | Err(TrySendError::Disconnected(_)) => {}
        }
        self.stuck.is_none()
    }
}

/// Writes until the channel or the port is closed.
fn write(mut port: Box<dyn SerialPort>, frames: &Receiver<Vec<u8>>) {
    for frame in frames {
        let mut rest = &frame[..];
        while !rest.is_empty() {
            match port.write(rest) {
                Ok(n) => rest = &rest[n..],
                Err(e) if is_pause(&e) => {}
                Err(_) => return,
            }
        }
    }
}

fn is_pause(error: &io::Error) -> bool {
    use ErrorKind::{Interrupted, TimedOut, WouldBlock};
    matches!(error.kind(), Interrupted | TimedOut | WouldBlock)
}

pub(crate) struct Worker {
    settings: Settings,
    link: Link,
    port: Option<Open>,
    start: Instant,
    retry: (Instant, Duration),
    echo_us: u64,
    arrivals: SyncSender<Arrival>,
    /// arrivals the owner has no room for yet
    waiting: VecDeque<Arrival>,
    messages: Receiver<Message>,
    next: Option<Message>,
    shared: Arc<Shared>,
    state: State,
}

impl Worker {
    pub fn new(
        settings: Settings,
        port: Box<dyn SerialPort>,
        arrivals: SyncSender<Arrival>,
        messages: Receiver<Message>,
        shared: Arc<Shared>,
    ) -> Result<Self> {
        Ok(Worker {
            link: Link::new(settings.hello.clone(), settings.session),
            settings,
            port: Some(Open::new(port)?),
            start: Instant::now(),
            retry: (Instant::now(), RETRY[0]),
            echo_us: 0,
            arrivals,
            waiting: VecDeque::new(),
            messages,
            next: None,
            shared,
            state: State::default(),
        })
    }

    pub fn run(mut self) {
        let mut stopping = None;
        loop {
            self.turn();
            if self.shared.is_stopping.load(Ordering::Relaxed) {
                let since: &Instant = stopping.get_or_insert_with(Instant::now);
                if self.has_said_all() || since.elapsed() > LAST_WORDS {
                    return;
                }
            }
        }
    }

    fn turn(&mut self) {
        self.find_port();
        if self.waiting.is_empty() {
            self.read();
        } else {
            std::thread::sleep(NAP);
        }
        let lines = self.shared.lines_waiting.load(Ordering::Relaxed);
        let room = self.settings.queue.saturating_sub(lines);
        self.link.offer(room.try_into().unwrap_or(u16::MAX));
        self.transmit();
        self.publish(); // whoever hears of an event finds the state that belongs to it
        self.deliver();
    }

    fn now_us(&self) -> u64 {
        self.start.elapsed().as_micros() as u64
    }

    fn has_said_all(&self) -> bool {
        let stuck = self.port.as_ref().is_some_and(|port| port.stuck.is_some());
        self.port.is_none() || !self.link.is_connected() || (!stuck && self.shared.unsent() == 0)
    }

    fn find_port(&mut self) {
        if self.port.is_some() || Instant::now() < self.retry.0 {
            return;
        }
        match self
            .settings
            .port
            .open(self.settings.baud)
            .and_then(Open::new)
        {
            Ok(port) => {
                self.port = Some(port);
                self.retry.1 = RETRY[0];
                self.link.reopen();
                self.arrive(News::PortFound);
            }
            Err(_) => {
                self.retry.0 = Instant::now() + self.retry.1;
                self.retry.1 = (self.retry.1 * 2).min(RETRY[1]);
            }
        }
    }

    fn lose_port(&mut self, error: &io::Error) {
        self.port = None;
        self.retry = (Instant::now() + RETRY[0], RETRY[0]);
        self.state.port_losses += 1;
        let failure = lost(&self.settings.port, error);
        self.arrive(News::PortLost(failure.message));
    }

    fn read(&mut self) {
        let mut buffer = [0; 4096];
        let result = match &mut self.port {
            None => {
                std::thread::sleep(NAP);
                return self.feed(&[]);
            }
            Some(port) => port.reader.read(&mut buffer),
        };
        match result {
            Ok(0) => self.lose_port(&ErrorKind::UnexpectedEof.into()),
            Ok(n) => self.feed(&buffer[..n]),
            Err(e) if is_pause(&e) => self.feed(&[]),
            Err(e) => self.lose_port(&e),
        }
    }

    fn feed(&mut self, mut bytes: &[u8]) {
        let now_us = self.now_us();
        while let Some(event) = self.link.receive(&mut bytes, now_us) {
            self.note_echo(&event, now_us);
            self.arrive(News::Link(event));
        }
    }

    fn note_echo(&mut self, event: &Event, now_us: u64) {
        if let Event::Message(Frame {
            message: Message::EchoReply(bytes),
            ..
        }) = event
            && let Ok(sent) = <[u8; 8]>::try_from(&bytes[..])
        {
            let round_trip = now_us.saturating_sub(u64::from_le_bytes(sent));
            self.state.latency.note(round_trip);
        }
    }

    fn arrive(&mut self, news: News) {
        let time_us = self.now_us();
        let arrival = Arrival { time_us, news };
        if is_line(&arrival) {
            self.shared.lines_waiting.fetch_add(1, Ordering::Relaxed);
        }
        self.waiting.push_back(arrival);
    }

    fn deliver(&mut self) {
        while let Some(arrival) = self.waiting.pop_front() {
            match self.arrivals.try_send(arrival) {
                Ok(()) => {}
                Err(TrySendError::Full(arrival)) => return self.waiting.push_front(arrival),
                Err(TrySendError::Disconnected(_)) => return,
            }
        }
    }

    /// Sends what the link, the latency meter and the owner have to say, in this order.
    fn transmit(&mut self) {
        let mut buffer = [0; MAX_FRAME];
        while let Some(port) = &mut self.port
            && port.has_room()
        {
            let length = self.say(&mut buffer);
            match &mut self.port {
                Some(port) if length > 0 => port.stuck = Some(buffer[..length].to_vec()),
                _ => return,
            }
        }
    }

    /// The next frame to be sent; 0: none.
    fn say(&mut self, buffer: &mut [u8]) -> usize {
        let now_us = self.now_us();
        let length = self.link.tend(now_us, buffer);
        if length > 0 {
            return length;
        }
        if let Some(echo) = self.echo(now_us) {
            return self.link.send(&echo, now_us, buffer).unwrap_or(0);
        }
        if self.next.is_none() {
            self.next = self.messages.try_recv().ok();
        }
        let Some(message) = &self.next else { return 0 };
        match self.link.send(message, now_us, buffer) {
            Err(Unsent::NotConnected | Unsent::NoCredit) => 0,
            done => {
                self.next = None;
                self.shared.sent();
                done.unwrap_or(0)
            }
        }
    }

    fn echo(&mut self, now_us: u64) -> Option<Message> {
        let is_due = now_us >= self.echo_us + ECHO_US;
        if !self.settings.measure_latency || !is_due || !self.link.is_connected() {
            return None;
        }
        self.echo_us = now_us;
        Some(Message::Echo(now_us.to_le_bytes().into_iter().collect()))
    }

    fn publish(&mut self) {
        self.link.fill(&mut self.state.counters);
        self.state.is_connected = self.link.is_connected();
        self.state.may_send_long = self.link.is_connected() && self.link.may_send_long();
        self.state.peer = self.link.peer().map(|peer| peer.hello.clone());
        let mut shared = self
            .shared
            .state
            .lock()
            .unwrap_or_else(PoisonError::into_inner);
        shared.clone_from(&self.state);
    }
}
