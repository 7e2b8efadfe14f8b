//! The simulated scanner over a virtual serial cable, good and bad, into the receiving
//! end of the link: what arrives is what was sent, and what does not is counted.

use std::io::Read;
use std::io::Write;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use anyhow::Result;
use rugosa_hil_sim::clock::RealClock;
use rugosa_hil_sim::device::Device;
use rugosa_hil_sim::faults::Faults;
use rugosa_hil_sim::port::{Cable, CableSettings, End};
use rugosa_hil_sim::robot::{Path, Robot};
use rugosa_hil_sim::scanner::Scanner;
use rugosa_hil_sim::stream::{Simulation, Stamped};
use rugosa_hil_sim::terrain::egg_carton;
use rugosa_hil_sim::transmit::{Sending, Sent, Transmitter};
use rugosa_wire::{Event, Hello, Link, MAX_FRAME, Message, Role, ScanLine, capability};

const QUEUE: u16 = 16;

fn simulation(sweeps: u32) -> Simulation {
    let path = Path::Straight {
        from: [0.0, 0.0],
        heading: 0.5,
        speed: 0.4,
    };
    let robot = Robot::new(Arc::new(egg_carton(0.1, 1.5)), path);
    let device = Device::perceptron().thinned(64, 96);
    let mut simulation = Simulation::new(Scanner::new(device, robot, 3));
    simulation.sweeps = Some(sweeps);
    simulation
}

fn lines(simulation: &Simulation) -> Vec<ScanLine> {
    let line = |stamped: Stamped| match stamped.message {
        Message::Line(line) => Some(line),
        _ => None,
    };
    simulation.messages().filter_map(line).collect()
}

/// What the module's end has taken.
#[derive(Default)]
struct Heard {
    lines: Vec<ScanLine>,
    descriptions: u32,
    sweeps: u32,
    broken: u32,
    link_lost: u32,
}

/// A module that grants credit and writes down lines, until `done`.
fn listen(cable: &Arc<Cable>, done: &Arc<AtomicBool>) -> JoinHandle<Result<Heard>> {
    let (cable, done) = (cable.clone(), done.clone());
    std::thread::spawn(move || {
        let mut hello = Hello::new(Role::Module, "listener", "0");
        hello.capabilities = capability::FLOW_CONTROL;
        let (mut link, start) = (Link::new(hello, 99), Instant::now());
        let mut port = cable.connect(End::B, Duration::from_millis(5))?;
        let (mut heard, mut chunk, mut frame) = (Heard::default(), [0; 777], [0; MAX_FRAME]);
        while !done.load(Ordering::SeqCst) {
            let taken = match port.read(&mut chunk) {
                Ok(taken) => taken,
                Err(error) if error.kind() == std::io::ErrorKind::TimedOut => 0,
                Err(_) => {
                    // unplugged: open the port again when it is back
                    std::thread::sleep(Duration::from_millis(20));
                    if let Ok(again) = cable.connect(End::B, Duration::from_millis(5)) {
                        port = again;
                        link.reopen();
                    }
                    continue;
                }
            };
            let (mut bytes, now) = (&chunk[..taken], start.elapsed().as_micros() as u64);
            while let Some(event) = link.receive(&mut bytes, now) {
                heard.note(event);
            }
            link.offer(QUEUE);
            while let n @ 1.. = link.tend(now, &mut frame) {
                let _ = port.write_all(&frame[..n]);
            }
        }
        heard.link_lost = link.tally().lost;
        Ok(heard)
    })
}

impl Heard {
    fn note(&mut self, event: Event) {
        match event {
            Event::Message(frame) => match frame.message {
                Message::Line(line) => self.lines.push(line),
                Message::Scanner(_) => self.descriptions += 1,
                Message::SweepEnd(_) => self.sweeps += 1,
                _ => {}
            },
            Event::Broken(_) => self.broken += 1,
            _ => {}
        }
    }
}

/// Runs all sweeps over `cable`, `beside` while they run.
fn run(cable: Cable, sweeps: u32, beside: impl FnOnce(&Cable)) -> Result<(Sent, Heard)> {
    let (cable, done) = (Arc::new(cable), Arc::new(AtomicBool::new(false)));
    let listener = listen(&cable, &done);
    let port = cable.connect(End::A, Duration::ZERO)?;
    let scanner = std::thread::spawn(move || {
        let simulation = simulation(sweeps);
        let hello = Hello::new(Role::Scanner, "simulated", "0");
        let mut transmitter =
            Transmitter::new(port, RealClock::start(), hello, 5).describe(simulation.description());
        let stop = AtomicBool::new(false);
        let messages = &mut simulation.messages_ahead(64);
        let sent = transmitter.run(messages, Sending::UNLIMITED, &stop, &mut |_| ());
        transmitter.idle(Duration::from_millis(700))?; // a heartbeat tells of the last losses
        sent
    });
    beside(&cable);
    let sent = scanner.join().expect("the scanner's thread")?;
    done.store(true, Ordering::SeqCst);
    Ok((sent, listener.join().expect("the listener's thread")?))
}

#[test]
fn a_good_cable_loses_nothing() -> Result<()> {
    let (sent, heard) = run(Cable::new()?, 4, |_| ())?;
    assert_eq!((sent.lines, sent.skipped, sent.connections), (256, 0, 1));
    assert_eq!((heard.broken, heard.link_lost, heard.sweeps), (0, 0, 4));
    assert!(heard.lines == lines(&simulation(4)));
    Ok(())
}

#[test]
fn a_bad_cable_loses_lines_but_never_changes_one() -> Result<()> {
    let faults = Faults {
        bit_error_rate: 1e-5,
        drop_rate: 5e-5,
        duplicate_rate: 5e-5,
        seed: 8,
        ..Faults::default()
    };
    let cable = Cable::with(CableSettings {
        a_to_b: faults,
        ..Default::default()
    })?;
    let (sent, heard) = run(cable, 8, |_| ())?;
    let original = lines(&simulation(8));
    assert_eq!(sent.lines, original.len() as u64);
    let mut at = original.iter();
    for line in &heard.lines {
        assert!(
            at.any(|sent| sent == line),
            "changed, doubled or out of order"
        );
    }
    let lost = original.len() - heard.lines.len();
    // some 200 kB: 16 inverted bits, 10 lost, 10 doubled bytes, at most a frame each
    assert!((5..80).contains(&lost), "{lost} lines lost");
    assert!(heard.broken > 0 && heard.link_lost as usize >= lost);
    Ok(())
}

#[test]
fn a_plug_that_is_pulled_for_a_moment_costs_only_what_was_under_way() -> Result<()> {
    let cable = Cable::with(CableSettings {
        a_to_b: Faults::paced(1_000_000),
        ..Default::default()
    })?;
    let (sent, heard) = run(cable, 12, |cable| {
        while cable.injected()[0].bytes_in < 60_000 {
            std::thread::sleep(Duration::from_millis(5));
        }
        cable.unplug(End::B).expect("unplugged");
        std::thread::sleep(Duration::from_millis(300));
        cable.plug(End::B).expect("plugged");
    })?;
    let original = lines(&simulation(12));
    assert_eq!(sent.lines, original.len() as u64);
    let mut at = original.iter();
    assert!(heard.lines.iter().all(|line| at.any(|sent| sent == line)));
    // without credit the scanner stops: a queue's worth is lost at most, before and after
    let lost = original.len() - heard.lines.len();
    assert!(lost <= 2 * usize::from(QUEUE), "{lost} lines lost");
    assert!(heard.descriptions >= 1 && heard.sweeps >= 10);
    Ok(())
}
