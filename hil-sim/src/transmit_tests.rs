use super::*;
use crate::clock::VirtualClock;
use crate::device::Device;
use crate::robot::{Path, Robot};
use crate::scanner::Scanner;
use crate::stream::Simulation;
use crate::terrain::Plane;
use rugosa_wire::{Frame, Role, ScanLine, capability};
use std::cell::RefCell;
use std::rc::Rc;
use std::sync::Arc;

/// A receiver that takes what is written at once and keeps what it understood.
struct Peer {
    link: Link,
    clock: VirtualClock,
    answers: Vec<u8>,
    heard: Vec<Frame>,
    /// lines it still makes room for
    room: Option<u16>,
    broken: u32,
    /// writes until the port fails
    writes: usize,
}

#[derive(Clone)]
struct Port(Rc<RefCell<Peer>>);

impl Port {
    fn new(clock: &VirtualClock, capabilities: u32, session: u32) -> Self {
        let mut hello = Hello::new(Role::Module, "test", "0");
        hello.capabilities = capabilities;
        Port(Rc::new(RefCell::new(Peer {
            link: Link::new(hello, session),
            clock: clock.clone(),
            answers: Vec::new(),
            heard: Vec::new(),
            room: None,
            broken: 0,
            writes: usize::MAX,
        })))
    }

    fn lines(&self) -> Vec<ScanLine> {
        let line = |frame: &Frame| match &frame.message {
            Message::Line(line) => Some(line.clone()),
            _ => None,
        };
        self.0.borrow().heard.iter().filter_map(line).collect()
    }
}

impl Peer {
    fn tend(&mut self) {
        let mut buffer = [0; MAX_FRAME];
        let now = self.clock.now().as_micros() as u64;
        if let Some(room) = self.room {
            self.link.offer(room);
        }
        while let n @ 1.. = self.link.tend(now, &mut buffer) {
            self.answers.extend_from_slice(&buffer[..n]);
        }
    }
}

impl Write for Port {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let mut peer = self.0.borrow_mut();
        if peer.writes == 0 {
            return Err(ErrorKind::BrokenPipe.into());
        }
        peer.writes -= 1;
        let now = peer.clock.now().as_micros() as u64;
        let mut left = bytes;
        while let Some(event) = peer.link.receive(&mut left, now) {
            match event {
                Event::Message(frame) => peer.heard.push(frame),
                Event::Broken(_) => peer.broken += 1,
                _ => {}
            }
        }
        peer.tend();
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Read for Port {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let mut peer = self.0.borrow_mut();
        peer.tend();
        let n = buffer.len().min(peer.answers.len());
        if n == 0 {
            return Err(ErrorKind::TimedOut.into());
        }
        buffer[..n].copy_from_slice(&peer.answers[..n]);
        peer.answers.drain(..n);
        Ok(n)
    }
}

fn simulation(sweeps: u32) -> Simulation {
    simulation_of(Device::perceptron().thinned(32, 32), sweeps)
}

fn simulation_of(device: Device, sweeps: u32) -> Simulation {
    let path = Path::Still {
        at: [0.0, 0.0],
        heading: 0.0,
    };
    let robot = Robot::new(Arc::new(Plane::FLAT), path);
    let mut simulation = Simulation::new(Scanner::new(device, robot, 1));
    simulation.sweeps = Some(sweeps);
    simulation
}

fn transmitter(port: &Port, clock: &VirtualClock) -> Transmitter<Port, VirtualClock> {
    let hello = Hello::new(Role::Scanner, "simulated", "0");
    Transmitter::new(port.clone(), clock.clone(), hello, 7).describe(simulation(0).description())
}

static GO: AtomicBool = AtomicBool::new(false);

#[test]
fn description_comes_first_and_nothing_is_lost() {
    let clock = VirtualClock::default();
    let port = Port::new(&clock, 0, 1);
    let mut scanner = transmitter(&port, &clock);
    let mut sweeps = Vec::new();
    let mut watch = |sent: &Sent| sweeps.push(sent.sweeps);
    let messages = &mut simulation(3).messages();
    let sent = scanner
        .run(messages, Sending::UNLIMITED, &GO, &mut watch)
        .unwrap();
    assert_eq!(sweeps, [1, 2, 3]);
    assert_eq!((sent.lines, sent.sweeps, sent.connections), (96, 3, 1));
    let peer = port.0.borrow();
    assert!(matches!(peer.heard[0].message, Message::Scanner(_)));
    let spoken = peer.heard[1..].iter().map(|frame| frame.message.clone());
    let spoken = spoken.filter(|message| !matches!(message, Message::Heartbeat(_)));
    assert!(spoken.eq(simulation(3).messages().map(|stamped| stamped.message)));
    assert_eq!((peer.broken, peer.link.tally().lost), (0, 0));
}

#[test]
fn real_time_is_kept() {
    let clock = VirtualClock::default();
    let port = Port::new(&clock, 0, 1);
    let mut scanner = transmitter(&port, &clock);
    let messages = &mut simulation(4).messages();
    let sent = scanner
        .run(messages, Sending::REAL_TIME, &GO, &mut |_| ())
        .unwrap();
    let (time, last) = (
        clock.now().as_secs_f64(),
        simulation(4).messages().last().unwrap(),
    );
    assert!((time - last.stamp_us as f64 * 1e-6).abs() < 0.01, "{time}");
    assert!(sent.worst_late_us < 2_000, "{sent:?}");
}

#[test]
fn lines_wait_for_credit() {
    let clock = VirtualClock::default();
    let port = Port::new(&clock, capability::FLOW_CONTROL, 1);
    port.0.borrow_mut().room = Some(5);
    let mut scanner = transmitter(&port, &clock);
    let stop = AtomicBool::new(false);
    let messages = &mut simulation(2).messages();
    let sent = scanner
        .run(messages, Sending::UNLIMITED, &stop, &mut |_| ())
        .unwrap();
    assert_eq!((sent.lines, port.lines().len()), (64, 64));

    // a peer without room gets none, and says so by its silence only
    let port = Port::new(&clock, capability::FLOW_CONTROL, 2);
    let mut scanner = transmitter(&port, &clock);
    let patient = Sending {
        pace: Pace::Times(1.0),
        patience: Some(Duration::from_millis(50)),
    };
    let messages = &mut simulation(2).messages();
    let sent = scanner.run(messages, patient, &GO, &mut |_| ()).unwrap();
    assert_eq!((sent.lines, sent.skipped, sent.sweeps), (0, 64, 2));
    assert!(port.lines().is_empty() && sent.waits > 0);
}

#[test]
fn tables_wait_for_credit_and_come_before_the_rest() {
    let clock = VirtualClock::default();
    let port = Port::new(&clock, capability::FLOW_CONTROL, 1);
    let simulation = simulation_of(Device::lidar().thinned(8, 64), 1);
    let description = simulation.description();
    let hello = Hello::new(Role::Scanner, "simulated", "0");
    let mut scanner =
        Transmitter::new(port.clone(), clock.clone(), hello, 7).describe(description.clone());
    scanner.idle(Duration::from_millis(300)).unwrap();
    let tables = |port: &Port| {
        let heard = &port.0.borrow().heard;
        let is_table = |frame: &&Frame| matches!(frame.message, Message::BeamTable(_));
        heard.iter().filter(is_table).count()
    };
    assert_eq!(tables(&port), 0, "without room");
    port.0.borrow_mut().room = Some(1);
    let stop = AtomicBool::new(false);
    let messages = &mut simulation.messages();
    scanner
        .run(messages, Sending::UNLIMITED, &stop, &mut |_| ())
        .unwrap();
    assert_eq!(tables(&port), description.len() - 1);
    let peer = port.0.borrow();
    let spoken = peer.heard.iter().map(|frame| frame.message.clone());
    let spoken = spoken.filter(|message| !matches!(message, Message::Heartbeat(_)));
    let messages = simulation.messages().map(|stamped| stamped.message);
    assert!(spoken.eq(description.into_iter().chain(messages)));
}

#[test]
fn a_port_that_fails_and_comes_back_loses_no_line() {
    let clock = VirtualClock::default();
    let first = Port::new(&clock, 0, 1);
    first.0.borrow_mut().writes = 40;
    let mut scanner = transmitter(&first, &clock);
    let messages = &mut simulation(2).messages();
    let error = scanner
        .run(messages, Sending::UNLIMITED, &GO, &mut |_| ())
        .unwrap_err();
    assert!(error.to_string().contains("cannot be written"), "{error}");
    let second = Port::new(&clock, 0, 2);
    scanner.reopen(second.clone());
    let sent = scanner
        .run(messages, Sending::UNLIMITED, &GO, &mut |_| ())
        .unwrap();
    assert_eq!((sent.lines, sent.connections), (64, 2));
    let mut lines = first.lines();
    lines.extend(second.lines());
    let stamps: Vec<u64> = lines.iter().map(|line| line.stamp_us).collect();
    assert_eq!(stamps.len(), 64);
    assert!(stamps.windows(2).all(|pair| pair[0] < pair[1]));
    assert!(matches!(
        second.0.borrow().heard[0].message,
        Message::Scanner(_)
    ));
}

#[test]
fn echoes_are_answered_and_stop_stops() {
    let clock = VirtualClock::default();
    let port = Port::new(&clock, 0, 1);
    let mut scanner = transmitter(&port, &clock);
    scanner.idle(Duration::from_millis(100)).unwrap();
    let echo = Message::Echo(b"abc".iter().copied().collect());
    let mut buffer = [0; MAX_FRAME];
    let n = port
        .0
        .borrow_mut()
        .link
        .send(&echo, 200_000, &mut buffer)
        .unwrap();
    port.0.borrow_mut().answers.extend_from_slice(&buffer[..n]);
    scanner.idle(Duration::from_millis(10)).unwrap();
    let reply = Message::EchoReply(b"abc".iter().copied().collect());
    assert!(
        port.0
            .borrow()
            .heard
            .iter()
            .any(|frame| frame.message == reply)
    );

    let stop = AtomicBool::new(true);
    let sent = scanner.run(
        &mut simulation(1).messages(),
        Sending::UNLIMITED,
        &stop,
        &mut |_| (),
    );
    assert_eq!(sent.unwrap().lines, 0);
}

#[test]
fn another_protocol_is_refused_by_name() {
    let clock = VirtualClock::default();
    let mut hello = Hello::new(Role::Module, "test", "0");
    hello.protocol += 1;
    let port = Port::new(&clock, 0, 1);
    port.0.borrow_mut().link = Link::new(hello, 1);
    let mut scanner = transmitter(&port, &clock);
    let messages = &mut simulation(1).messages();
    let error = scanner
        .run(messages, Sending::UNLIMITED, &GO, &mut |_| ())
        .unwrap_err();
    assert!(error.to_string().contains("protocol"), "{error}");
}
