//! Two ends of a link under losses, restarts and silence.

mod common;

use common::*;
use proptest::prelude::*;
use rugosa_wire::*;

/// Two links and a line between them; time goes in steps of 10 ms.
struct Pair {
    scanner: Link,
    module: Link,
    now_us: u64,
    events: (Vec<Event>, Vec<Event>),
}

fn scanner(session: u32) -> Link {
    Link::new(Hello::new(Role::Scanner, "scanner", "1"), session)
}

fn module(session: u32) -> Link {
    Link::new(hello(), session)
}

fn line() -> Message {
    Message::Line(ScanLine {
        sweep: 1,
        line: 2,
        first_column: 0,
        stamp_us: 3,
        returns: 2,
        packing: Packing::Bits12,
        ranges: Packing::Bits12.pack([5, 6]).unwrap(),
        reflectances: heapless::Vec::new(),
    })
}

fn tend(link: &mut Link, now_us: u64) -> Vec<u8> {
    let (mut bytes, mut buffer) = (Vec::new(), [0; MAX_FRAME]);
    loop {
        match link.tend(now_us, &mut buffer) {
            0 => return bytes,
            n => bytes.extend(&buffer[..n]),
        }
    }
}

fn take(link: &mut Link, mut bytes: &[u8], now_us: u64) -> Vec<Event> {
    std::iter::from_fn(|| link.receive(&mut bytes, now_us)).collect()
}

impl Pair {
    fn new() -> Self {
        Pair {
            scanner: scanner(10),
            module: module(20),
            now_us: 0,
            events: Default::default(),
        }
    }

    /// One step; `cut` says which directions are cut, (to the module, to the scanner).
    fn step(&mut self, cut: (bool, bool)) {
        self.now_us += 10_000;
        let up = tend(&mut self.scanner, self.now_us);
        let down = tend(&mut self.module, self.now_us);
        let (up, down) = (
            if cut.0 { &[] } else { &up[..] },
            if cut.1 { &[] } else { &down[..] },
        );
        self.events
            .1
            .extend(take(&mut self.module, up, self.now_us));
        self.events
            .0
            .extend(take(&mut self.scanner, down, self.now_us));
    }

    fn steps(&mut self, n: usize) {
        (0..n).for_each(|_| self.step((false, false)));
    }

    fn connected(&self) -> bool {
        self.scanner.is_connected() && self.module.is_connected()
    }

    fn send(&mut self, message: &Message) -> Result<Vec<u8>, Unsent> {
        let mut buffer = [0; MAX_FRAME];
        let length = self.scanner.send(message, self.now_us, &mut buffer)?;
        Ok(buffer[..length].to_vec())
    }
}

#[test]
fn nothing_is_sent_or_taken_without_a_handshake() {
    let mut pair = Pair::new();
    assert_eq!(pair.send(&Message::Refresh), Err(Unsent::NotConnected));
    let bytes = frame(10, 0, &Message::Refresh);
    assert_eq!(take(&mut pair.module, &bytes, 0), []);
    assert_eq!(pair.module.tally().stale, 1);
    pair.steps(3);
    assert!(pair.connected());
    assert_eq!(pair.events.0, [Event::Connected { resumed: false }]);
    assert_eq!(pair.events.1, [Event::Connected { resumed: false }]);
    assert_eq!(pair.module.peer().unwrap().hello.role, Role::Scanner);
}

#[test]
fn our_own_echo_is_not_a_peer() {
    let mut alone = scanner(10);
    let bytes = tend(&mut alone, 0);
    assert_eq!(take(&mut alone, &bytes, 0), []);
    assert!(alone.peer().is_none() && alone.tally().stale == 1);
}

#[test]
fn greetings_stop_and_heartbeats_keep_the_connection() {
    let mut pair = Pair::new();
    pair.steps(10);
    let before = (*pair.scanner.tally(), *pair.module.tally());
    pair.steps(1000);
    assert!(pair.connected());
    assert_eq!(pair.scanner.tally().sessions, 1);
    // the module's credits answer the scanner's heartbeats: no other sign of life
    for (link, before) in [(&pair.scanner, before.0), (&pair.module, before.1)] {
        let frames = link.tally().frames_sent - before.frames_sent;
        assert!(
            (19..=21).contains(&frames),
            "{frames} frames in ten seconds"
        );
    }
    assert_eq!(pair.module.decoder().counts().broken(), 0);
}

#[test]
fn a_peer_of_another_version_is_refused_by_name() {
    let mut pair = Pair::new();
    pair.steps(5);
    let newer = Hello {
        protocol: 7,
        ..hello()
    };
    let events = take(
        &mut pair.scanner,
        &frame(30, 0, &Message::Hello(newer)),
        60_000,
    );
    let Some(Event::Refused(refusal)) = events.first() else {
        panic!("{events:?}");
    };
    let text = format!("{refusal}");
    assert!(
        text.contains("speaks protocol 7") && text.contains("software on this side"),
        "{text}"
    );
    assert!(!pair.scanner.is_connected());
}

#[test]
fn silence_is_noticed_and_the_link_resumes() {
    let mut pair = Pair::new();
    pair.steps(5);
    (0..250).for_each(|_| pair.step((true, true)));
    assert!(!pair.connected());
    assert_eq!(pair.events.0.last(), Some(&Event::Silent));
    let lost_before = pair.module.tally().lost;
    pair.steps(30);
    assert!(pair.connected());
    assert_eq!(
        pair.events.0.last(),
        Some(&Event::Connected { resumed: true })
    );
    assert_eq!(
        pair.events.1.last(),
        Some(&Event::Connected { resumed: true })
    );
    assert!(
        pair.module.tally().lost > lost_before,
        "what was sent meanwhile is counted"
    );
}

#[test]
fn what_comes_after_a_silence_is_not_lost() {
    let mut pair = Pair::new();
    pair.steps(5);
    let silent = pair.now_us + 3_000_000;
    assert_eq!(take(&mut pair.module, &[], silent), [Event::Silent]);
    assert!(!pair.module.is_connected());
    // the scanner knows of no silence and goes on
    let mut buffer = [0; MAX_FRAME];
    let length = pair
        .scanner
        .send(&Message::Refresh, pair.now_us, &mut buffer)
        .unwrap();
    let events = take(&mut pair.module, &buffer[..length], silent);
    assert!(matches!(&events[..], [Event::Message(frame)] if frame.message == Message::Refresh));
    assert_eq!(pair.module.tally().stale, 0);
}

#[test]
fn a_restart_of_either_side_starts_afresh_and_old_frames_are_stale() {
    let mut pair = Pair::new();
    pair.module.offer(4);
    pair.steps(5);
    let old = pair.send(&line()).unwrap();
    pair.module = module(21);
    pair.module.offer(4);
    assert_eq!(take(&mut pair.module, &old, pair.now_us), []);
    assert_eq!(pair.module.tally().stale, 1);
    pair.steps(30);
    assert!(pair.connected());
    assert_eq!(
        pair.events.0.last(),
        Some(&Event::Connected { resumed: false })
    );
    assert_eq!(pair.scanner.peer().unwrap().session, 21);
    for _ in 0..4 {
        pair.send(&line()).unwrap(); // the count of lines starts afresh too
    }
    assert_eq!(pair.send(&line()), Err(Unsent::NoCredit));
    pair.scanner = scanner(11);
    pair.steps(30);
    assert!(pair.connected() && pair.send(&line()).is_ok());
}

#[test]
fn lost_and_repeated_frames_are_counted() {
    let mut pair = Pair::new();
    pair.module.offer(100);
    pair.steps(5);
    let sent: Vec<_> = (0..20).map(|_| pair.send(&line()).unwrap()).collect();
    let mut arrived: Vec<u8> = sent[..5].concat();
    arrived.extend(sent[9..].concat());
    arrived.extend(&sent[19]);
    let events = take(&mut pair.module, &arrived, pair.now_us);
    assert_eq!(events.len(), 16);
    assert_eq!(pair.module.tally().lost, 4);
    assert_eq!(pair.module.tally().duplicates, 1);
}

#[test]
fn counters_find_their_places() {
    let mut pair = Pair::new();
    pair.steps(100);
    let mut counters = [0; COUNTERS];
    pair.module.fill(&mut counters);
    assert_eq!(counters[counter::LINK_SESSIONS], 1);
    assert_eq!(
        counters[counter::LINK_FRAMES],
        pair.module.decoder().counts().frames
    );
    assert_eq!(
        counters[counter::LINK_FRAMES_SENT],
        pair.module.tally().frames_sent
    );
    pair.module.fill(&mut []);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    /// Whatever was lost before, a sound line connects within a retry, and the queue of
    /// the module is never asked to hold more than it offered.
    #[test]
    fn a_handshake_survives_any_loss(
        losses in prop::collection::vec(any::<(bool, bool)>(), 0..400),
        restarts in prop::collection::vec((0usize..400, any::<bool>()), 0..4),
    ) {
        let mut pair = Pair::new();
        pair.module.offer(3);
        for (i, &cut) in losses.iter().enumerate() {
            for (_, of_scanner) in restarts.iter().filter(|(at, _)| *at == i) {
                match of_scanner {
                    true => pair.scanner = scanner(100 + i as u32),
                    false => {
                        pair.module = module(1000 + i as u32);
                        pair.module.offer(3);
                    }
                }
            }
            pair.step(cut);
            if let Ok(bytes) = pair.send(&line()) && !cut.0 {
                pair.events.1.extend(take(&mut pair.module, &bytes, pair.now_us));
            }
        }
        pair.steps(100); // retry, answer, and a heartbeat that tells of lost lines
        prop_assert!(pair.connected());
        let taken = (0..10).filter(|_| pair.send(&line()).is_ok()).count();
        prop_assert_eq!(taken, 3);
    }
}
