//! Connections over virtual serial cables.

use rugosa_hil_sim::port::{Cable, CableSettings, End};
use rugosa_host::link::{Arrival, Connection, News, Settings};
use rugosa_wire::*;
use serialport::TTYPort;
use std::io::{ErrorKind, Read, Write};
use std::time::{Duration, Instant};

const PATIENCE: Duration = Duration::from_secs(20);

/// The other side: a link driven by hand.
struct Peer {
    port: TTYPort,
    link: Link,
    test: SelfTest,
    start: Instant,
    messages: Vec<Message>,
}

impl Peer {
    fn new(cable: &Cable, session: u32, capabilities: u32) -> Self {
        let mut hello = Hello::new(Role::Scanner, "peer", "1");
        hello.capabilities = capabilities;
        Peer {
            port: cable.connect(End::A, Duration::from_millis(1)).unwrap(),
            link: Link::new(hello, session),
            test: SelfTest::default(),
            start: Instant::now(),
            messages: Vec::new(),
        }
    }

    fn now_us(&self) -> u64 {
        self.start.elapsed().as_micros() as u64
    }

    fn turn(&mut self) {
        let mut buffer = [0; MAX_FRAME];
        let n = self.port.read(&mut buffer).unwrap_or(0);
        let mut bytes = &buffer[..n];
        let now = self.now_us();
        while let Some(event) = self.link.receive(&mut bytes, now) {
            if let Event::Message(frame) = event {
                self.test.take(&frame.message);
                self.messages.push(frame.message);
            }
        }
        loop {
            let n = self.link.tend(now, &mut buffer);
            match n {
                0 => break,
                n => self.write(&buffer[..n]),
            }
        }
        while let Some(answer) = self.test.due() {
            self.send(&answer).unwrap();
        }
    }

    fn send(&mut self, message: &Message) -> Result<(), Unsent> {
        let mut buffer = [0; MAX_FRAME];
        let n = self.link.send(message, self.now_us(), &mut buffer)?;
        self.write(&buffer[..n]);
        Ok(())
    }

    fn write(&mut self, mut bytes: &[u8]) {
        while !bytes.is_empty() {
            match self.port.write(bytes) {
                Ok(n) => bytes = &bytes[n..],
                Err(e) => assert_eq!(e.kind(), ErrorKind::TimedOut),
            }
        }
    }
}

fn open(cable: &Cable, change: impl FnOnce(&mut Settings)) -> Connection {
    let mut hello = Hello::new(Role::Module, "host", "1");
    hello.capabilities = capability::FLOW_CONTROL;
    let path = cable.path(End::B);
    let mut settings = Settings::new(path.to_str().unwrap(), hello);
    change(&mut settings);
    Connection::open(settings).unwrap()
}

/// Turns the peer until `done` is content with an arrival.
fn wait(connection: &Connection, peer: &mut Peer, mut done: impl FnMut(&Arrival) -> bool) {
    let start = Instant::now();
    while start.elapsed() < PATIENCE {
        peer.turn();
        while let Some(arrival) = connection.next(Duration::from_millis(1)) {
            if done(&arrival) {
                return;
            }
        }
    }
    panic!("did not happen: {:?}", connection.state());
}

fn is_connected(arrival: &Arrival) -> bool {
    matches!(arrival.news, News::Link(Event::Connected { .. }))
}

fn line(number: u16) -> Message {
    Message::Line(ScanLine {
        sweep: 0,
        line: number,
        first_column: 0,
        stamp_us: 0,
        returns: 128,
        packing: Packing::Bits12,
        ranges: Packing::Bits12.pack((0..128).map(|i| i * 31)).unwrap(),
        reflectances: Default::default(),
    })
}

fn number(arrival: &Arrival) -> Option<u16> {
    match &arrival.news {
        News::Link(Event::Message(frame)) => match &frame.message {
            Message::Line(line) => Some(line.line),
            _ => None,
        },
        _ => None,
    }
}

#[test]
fn messages_pass_both_ways_and_the_round_trip_is_measured() {
    let cable = Cable::new().unwrap();
    let mut peer = Peer::new(&cable, 5, 0);
    let connection = open(&cable, |s| s.measure_latency = true);
    wait(&connection, &mut peer, is_connected);
    connection.send(Message::Refresh).unwrap();
    let mut turns = 0;
    while !peer.messages.contains(&Message::Refresh) || connection.state().latency.samples == 0 {
        peer.turn();
        turns += 1;
        assert!(turns < 10_000);
    }
    let state = connection.state();
    assert_eq!(state.peer.unwrap().device, "peer");
    assert!(state.is_connected && state.unsent == 0);
    assert!(state.latency.min_us > 0 && state.latency.mean_us().unwrap() < 5_000_000);
    assert_eq!(state.counters[counter::LINK_SESSIONS], 1);
}

/// The owner of the connection takes nothing for a while: the sender has to wait, and no
/// line is lost.
#[test]
fn a_slow_owner_makes_the_sender_wait() {
    let cable = Cable::new().unwrap();
    let mut peer = Peer::new(&cable, 5, 0);
    let connection = open(&cable, |s| s.queue = 16);
    wait(&connection, &mut peer, is_connected);
    let (mut sent, start) = (0, Instant::now());
    while start.elapsed() < Duration::from_secs(1) {
        peer.turn();
        while sent < 100 && peer.send(&line(sent)).is_ok() {
            sent += 1;
        }
    }
    assert!((8..=16).contains(&sent), "{sent} lines for a queue of 16");
    let mut received = 0;
    let start = Instant::now();
    while received < 100 && start.elapsed() < PATIENCE {
        peer.turn();
        while sent < 100 && peer.send(&line(sent)).is_ok() {
            sent += 1;
        }
        while let Some(arrival) = connection.next(Duration::ZERO) {
            if let Some(n) = number(&arrival) {
                assert_eq!(n, received);
                received += 1;
            }
        }
    }
    assert_eq!(received, 100);
    assert_eq!(connection.state().counters[counter::LINK_LOST], 0);
}

#[test]
fn a_port_that_disappears_is_found_again() {
    let folder = tempfile::tempdir().unwrap();
    let cable = Cable::with(CableSettings {
        names: [None, Some(folder.path().join("port"))],
        ..CableSettings::default()
    })
    .unwrap();
    let mut peer = Peer::new(&cable, 5, 0);
    let connection = open(&cable, |_| {});
    wait(&connection, &mut peer, is_connected);

    cable.unplug(End::B).unwrap();
    let mut why = String::new();
    wait(&connection, &mut peer, |arrival| match &arrival.news {
        News::PortLost(reason) => {
            why.clone_from(reason);
            true
        }
        _ => false,
    });
    assert!(why.contains("port lost"), "{why}");
    cable.plug(End::B).unwrap();
    let mut found = false;
    wait(&connection, &mut peer, |arrival| {
        found |= arrival.news == News::PortFound;
        found && is_connected(arrival)
    });
    assert_eq!(connection.state().port_losses, 1);
    let start = Instant::now(); // a grant may have been on the cable: it is asked for again
    while peer.send(&line(7)).is_err() {
        assert!(start.elapsed() < PATIENCE, "no credit");
        peer.turn();
    }
    wait(&connection, &mut peer, |arrival| number(arrival) == Some(7));
}

#[test]
fn a_port_in_use_is_refused_with_a_reason() {
    let cable = Cable::new().unwrap();
    let _connection = open(&cable, |_| {});
    let hello = Hello::new(Role::Host, "second", "1");
    let path = cable.path(End::B);
    let again = Connection::open(Settings::new(path.to_str().unwrap(), hello));
    let failure = again.err().unwrap();
    assert!(
        failure.message.contains(path.to_str().unwrap()),
        "{failure}"
    );
}
