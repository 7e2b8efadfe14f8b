//! The loop that moves the bytes.

use crate::board_clock::BoardClock;
use crate::feeder::Feeder;
use crate::listener::Listener;
use crate::log::{Entry, Log};
use crate::schedule::Schedule;
use crate::sent_map::{Extent, Sent};
use crate::summary::{Lines, Parity, STAGES, Summary};
use crate::twin::Twin;
use anyhow::{Context, Result, bail};
use rugosa::{LAYERS, Layer};
use rugosa_hil_sim::clock::{Clock, RealClock};
use rugosa_hil_sim::faults::{Faults, Injected, Line};
use rugosa_hil_sim::port::End;
use rugosa_hil_sim::qemu::{Emulator, EmulatorSettings};
use rugosa_wire::{Message, Status, counter};
use serialport::TTYPort;
use std::collections::BTreeMap;
use std::io::{ErrorKind, Read, Write};
use std::path::PathBuf;
use std::time::Duration;

const NAP: Duration = Duration::from_micros(300);
/// A module that starts or reboots answers within this.
const PATIENCE: Duration = Duration::from_secs(60);

/// What is run, and how bad the line is.
#[derive(Clone, Debug, Default)]
pub struct Settings {
    /// image of the firmware
    pub image: PathBuf,
    /// from the scanner to the module
    pub to_module: Faults,
    /// from the module to the scanner
    pub from_module: Faults,
    /// do scanner and line go by the board's clock instead of the computer's?
    pub in_board_time: bool,
}

/// A running experiment.
pub struct Bench<M> {
    /// the emulated board
    pub emulator: Emulator,
    /// the scanner's side
    pub feeder: Feeder<M>,
    /// the host's side
    pub listener: Listener,
    /// what the module has to agree with
    pub twin: Option<Twin>,
    /// the module's log so far
    pub entries: Vec<Entry>,
    /// does anybody read what the module says to the host?
    pub is_listening: bool,
    /// is the cable to the scanner plugged in?
    pub is_plugged: bool,
    ports: [TTYPort; 2],
    lines: [Line; 2],
    pending: [Vec<u8>; 2],
    before_greeting: Vec<u8>,
    cut: u64,
    clock: RealClock,
    board_clock: Option<BoardClock>,
    /// of scanner and line
    time: Duration,
    log: Log,
}

impl<M: Iterator<Item = Message>> Bench<M> {
    /// Starts the firmware and a scanner that sends `messages` after `description`.
    pub fn start(settings: Settings, description: Vec<Message>, messages: M) -> Result<Self> {
        let log = Log::of(&settings.image)?;
        let emulator = Emulator::start(EmulatorSettings {
            image: settings.image,
            instructions_ns: Some(3),
            ..EmulatorSettings::default()
        })?;
        let port = |uart| emulator.cable(uart).connect(End::A, Duration::ZERO);
        let ports = [port(0)?, port(1)?];
        Ok(Bench {
            ports,
            emulator,
            feeder: Feeder::new(description, messages),
            listener: Listener::new(1),
            twin: None,
            entries: Vec::new(),
            is_listening: true,
            is_plugged: true,
            lines: [settings.to_module, settings.from_module].map(Line::new),
            pending: [Vec::new(), Vec::new()],
            before_greeting: Vec::new(),
            cut: 0,
            clock: RealClock::start(),
            board_clock: settings.in_board_time.then(BoardClock::default),
            time: Duration::ZERO,
            log,
        })
    }

    /// Time since the start, for scanner and line.
    pub fn now(&self) -> Duration {
        self.time
    }

    fn look_at_the_clock(&mut self) -> Result<()> {
        self.time = match &mut self.board_clock {
            Some(clock) => clock.now(&self.emulator)?,
            None => self.clock.now(),
        };
        Ok(())
    }

    /// What was injected on the way to the module and back.
    pub fn injected(&self) -> [Injected; 2] {
        let mut injected = [self.lines[0].injected(), self.lines[1].injected()];
        injected[0].bytes_out -= self.cut;
        injected[0].cut += self.cut;
        injected
    }

    /// Moves what can be moved now; naps when that is nothing.
    pub fn turn(&mut self) -> Result<()> {
        let (bytes, _) = self.emulator.take_log();
        self.entries.extend(self.log.take(&bytes));
        if let Some(exit) = self.emulator.exit()? {
            bail!(
                "the emulator has ended: {exit:?} {}",
                self.emulator.complaints()
            );
        }
        self.look_at_the_clock()?;
        let moved =
            self.hear_scanner_port()? + self.feed()? + self.hear_host_port()? + self.ask()?;
        if moved == 0 {
            std::thread::sleep(NAP);
        }
        Ok(())
    }

    /// Turns until `done`; an error after `limit` of the computer's time.
    pub fn until(
        &mut self,
        what: &str,
        limit: Duration,
        done: impl Fn(&Self) -> bool,
    ) -> Result<()> {
        let end = self.clock.now() + limit;
        while !done(self) {
            if self.clock.now() > end {
                let last = self.entries.last().map(Entry::to_string);
                bail!("not within {limit:?}: {what}; the module's last words: {last:?}");
            }
            self.turn()?;
        }
        Ok(())
    }

    /// Turns for some time of the computer.
    pub fn for_a_while(&mut self, time: Duration) -> Result<()> {
        let end = self.clock.now() + time;
        while self.clock.now() < end {
            self.turn()?;
        }
        Ok(())
    }

    /// Until scanner and host are connected to the module in the same session of it.
    pub fn connect(&mut self) -> Result<()> {
        self.until("connections", PATIENCE, Self::is_connected)
    }

    /// Until both are connected to a module that has started again.
    pub fn reconnect(&mut self, what: &str, limit: Duration) -> Result<()> {
        let before = self.feeder.module_session();
        self.until(what, limit, |b| {
            b.is_connected() && b.feeder.module_session() != before
        })
    }

    fn is_connected(&self) -> bool {
        let session = self.feeder.module_session();
        let links = [self.feeder.link(), self.listener.link()];
        session == self.listener.module_session() && links.iter().all(|link| link.is_connected())
    }

    /// Sends bytes to the scanner's port of the module, beside what the scanner says.
    pub fn inject(&mut self, bytes: &[u8]) {
        let now = self.now();
        self.lines[0].push(bytes, now);
    }

    /// Until all is sent, mapped and reported. The scanner is silent then, so that the
    /// last status is of the same moment as the twin.
    pub fn finish(&mut self, limit: Duration) -> Result<()> {
        self.until("everything sent", limit, |b| b.feeder.is_finished())?;
        self.settle()
    }

    /// Stops sending and waits until the module has read everything, told everything
    /// and has nothing new for two statuses.
    pub fn settle(&mut self) -> Result<()> {
        self.feeder.is_muted = true;
        self.until("everything delivered", PATIENCE, Self::is_quiet)?;
        let from = self.listener.statuses.len();
        self.until("the last status", PATIENCE, |b| {
            let news = b.listener.statuses.get(from..).unwrap_or_default();
            b.is_all_read() && b.is_all_told() && is_settled(news)
        })
    }

    /// Has everything gone out to the emulator?
    pub fn is_quiet(&self) -> bool {
        self.pending.iter().all(Vec::is_empty) && self.lines.iter().all(|line| line.waiting() == 0)
    }

    /// Has the module read, or dropped and counted, every byte that the twin got? After a
    /// reset nobody knows how many that are.
    fn is_all_read(&self) -> bool {
        let at = |index| self.listener.counter(index);
        let read = at(counter::LINK_BYTES).wrapping_add(at(counter::LINK_OVERRUN));
        let given = self.twin.as_ref().map(|t| t.counter(counter::LINK_BYTES));
        at(counter::RESTARTS) > 0 || Some(read) == given
    }

    fn is_all_told(&self) -> bool {
        self.listener.counter(counter::PATCHES_SENT) == self.listener.map.patches()
    }

    /// Module → scanner.
    fn hear_scanner_port(&mut self) -> Result<usize> {
        let (now, mut arrived) = (self.now(), Vec::new());
        let bytes = read(&mut self.ports[0])?;
        let line = &mut self.lines[1];
        line.push(&bytes, now);
        line.pull(now, &mut arrived);
        if self.is_plugged && self.feeder.receive(&arrived, micros(now)) {
            self.renew_twin();
        }
        Ok(bytes.len())
    }

    /// The module has started: so does its twin. What the module got before its first
    /// greeting is made up for; what it got before a reset is not known.
    fn renew_twin(&mut self) {
        let Some(session) = self.feeder.module_session() else {
            return;
        };
        let mut twin = Twin::new(session);
        twin.receive(&std::mem::take(&mut self.before_greeting));
        self.twin = Some(twin);
    }

    /// Scanner → module and twin.
    fn feed(&mut self) -> Result<usize> {
        let now = self.now();
        self.feeder.look(micros(now));
        let line = &mut self.lines[0];
        if line.room(now) >= 512 && self.pending[0].is_empty() {
            line.push(&self.feeder.next_frame(micros(now)), now);
        }
        let mut arrived = Vec::new();
        line.pull(now, &mut arrived);
        if !self.is_plugged {
            self.cut += arrived.len() as u64;
            arrived.clear();
        }
        match &mut self.twin {
            Some(twin) => twin.receive(&arrived),
            None => self.before_greeting.extend(&arrived),
        }
        self.pending[0].extend(arrived);
        write(&mut self.ports[0], &mut self.pending[0])
    }

    fn hear_host_port(&mut self) -> Result<usize> {
        if !self.is_listening {
            return Ok(0);
        }
        let bytes = read(&mut self.ports[1])?;
        let now = micros(self.now());
        self.listener.receive(&bytes, now);
        Ok(bytes.len())
    }

    fn ask(&mut self) -> Result<usize> {
        if self.pending[1].is_empty() && self.is_listening {
            let now = micros(self.now());
            self.pending[1] = self.listener.next_frame(now);
        }
        write(&mut self.ports[1], &mut self.pending[1])
    }

    /// Module against twin: digests after each sweep, counters, and the map as sent.
    pub fn compare(&self) -> Parity {
        let mut parity = Parity::default();
        let Some(twin) = &self.twin else {
            parity.differences.push("the module never greeted".into());
            return parity;
        };
        self.compare_digests(twin, &mut parity);
        self.compare_counters(twin, &mut parity);
        self.compare_map(twin, &mut parity);
        let strange = twin
            .lines
            .iter()
            .filter(|line| !self.feeder.known.contains(line));
        match strange.count() {
            0 => {}
            count => parity
                .differences
                .push(format!("{count} lines that nobody sent")),
        }
        parity.equal = parity.differences.is_empty() && parity.sweeps > 0;
        parity
    }

    fn compare_digests(&self, twin: &Twin, parity: &mut Parity) {
        let mut reported = BTreeMap::new();
        for status in self.listener.statuses_of_this_session() {
            let at = |index: usize| status.counters.get(index).copied().unwrap_or(0);
            if at(counter::SWEEPS) > 0 {
                reported.insert(at(counter::SWEEPS), at(counter::MAP_DIGEST));
            }
        }
        parity.sweeps = reported.len() as u32;
        for (sweeps, digest) in reported {
            if twin.digest(sweeps) != Some(digest) {
                parity.differences.push(format!("map after sweep {sweeps}"));
            }
        }
    }

    fn compare_counters(&self, twin: &Twin, parity: &mut Parity) {
        let link = counter::LINK_BAD_COBS..=counter::LINK_STALE;
        // of the link only in the first session: a reset loses half a frame
        let link = link.filter(|_| self.listener.counter(counter::RESTARTS) == 0);
        for index in link.chain(counter::LINES_RECEIVED..=counter::MAP_REBASES) {
            let (module, twin) = (self.listener.counter(index), twin.counter(index));
            if module != twin {
                let name = counter::NAMES[index];
                parity
                    .differences
                    .push(format!("{name}: module {module}, twin {twin}"));
            }
        }
    }

    fn compare_map(&self, twin: &Twin, parity: &mut Parity) {
        let mut wrong = BTreeMap::new();
        // the reconstruction moves a little everywhere with every sweep and is sent for
        // tiles with news only; its digest is compared like that of all layers
        let moves = [Layer::Mean, Layer::StandardDeviation, Layer::Realisation];
        let exact = LAYERS.iter().filter(|d| !moves.contains(&d.layer));
        for description in exact {
            let cells = twin.mapper().window().cells();
            for cell in cells.filter(|&cell| twin.is_complete(cell)) {
                let Some(sent) = self.listener.map.value(description.layer, cell) else {
                    continue;
                };
                let own = twin.mapper().value(description.layer, cell);
                let (sent, own) = same_unknown(description.layer, sent, own);
                let same =
                    sent.value.is_nan() && own.is_nan() || (sent.value - own).abs() <= sent.within;
                parity.values += 1;
                *wrong.entry(description.name).or_insert(0) += u32::from(!same);
            }
        }
        for (name, count) in wrong.into_iter().filter(|(_, count)| *count > 0) {
            parity
                .differences
                .push(format!("{count} values of {name} as sent"));
        }
    }

    /// The cells of the twin's window and their edge \[m\]; `None` before the module has
    /// greeted.
    pub fn window(&self) -> Option<(Extent, f32)> {
        let mapper = self.twin.as_ref()?.mapper();
        let window = mapper.window();
        let extent = Extent {
            origin: window.origin(),
            columns: window.side(),
            rows: window.side(),
        };
        Some((extent, mapper.config().resolution))
    }

    /// What came of it.
    pub fn summary(&self) -> Summary {
        let at = |index| self.listener.counter(index);
        let received = u64::from(at(counter::LINES_RECEIVED));
        let returns = self.listener.returns_of_last_sweep();
        let per_sweep =
            at(counter::COST_RECEIVE) + at(counter::COST_LINES) + at(counter::COST_COUNTERS);
        Summary {
            parity: self.compare(),
            lines: Lines {
                sent: self.feeder.lines,
                received,
                lost: self.feeder.lines.saturating_sub(received),
                rejected: received.saturating_sub(u64::from(at(counter::LINES_USED))),
                lateness: self.feeder.schedule.as_ref().map(Schedule::lateness),
            },
            instructions: STAGES
                .iter()
                .map(|&(name, index)| (name, at(index)))
                .collect(),
            instructions_per_return: f64::from(per_sweep) / f64::from(returns.max(1)),
            stack: at(counter::STACK_PEAK),
            queue: at(counter::QUEUE_PEAK),
            seconds: self.clock.now().as_secs_f64(),
            board_seconds: self.board_clock.map(|_| self.time.as_secs_f64()),
            counters: counter::NAMES
                .iter()
                .enumerate()
                .map(|(i, &name)| (name, at(i)))
                .collect(),
            restarts: at(counter::RESTARTS),
            log_entries: self.entries.len(),
        }
    }
}

/// A cell that lay outside the window when its tile was sent has no state; when it comes
/// into the window its state is "unknown". Nothing has become known, so nothing is sent.
fn same_unknown(layer: Layer, mut sent: Sent, own: f32) -> (Sent, f32) {
    if layer == Layer::State && sent.value.is_nan() && own == 0.0 {
        sent.value = own;
    }
    (sent, own)
}

/// Do the last three statuses tell the same of bytes read and patches sent?
fn is_settled(statuses: &[Status]) -> bool {
    let told = |status: &Status| {
        let at = |index: usize| status.counters.get(index).copied();
        [
            counter::LINK_BYTES,
            counter::LINK_OVERRUN,
            counter::PATCHES_SENT,
        ]
        .map(at)
    };
    match statuses {
        [.., a, b, c] => told(a) == told(b) && told(b) == told(c),
        _ => false,
    }
}

fn micros(time: Duration) -> u64 {
    time.as_micros() as u64
}

fn read(port: &mut TTYPort) -> Result<Vec<u8>> {
    let mut buffer = vec![0; 2048];
    match port.read(&mut buffer) {
        Ok(length) => buffer.truncate(length),
        Err(error) if is_not_now(error.kind()) => buffer.clear(),
        Err(error) => return Err(error).context("reading from the emulator"),
    }
    Ok(buffer)
}

fn write(port: &mut TTYPort, pending: &mut Vec<u8>) -> Result<usize> {
    if pending.is_empty() {
        return Ok(0);
    }
    match port.write(pending) {
        Ok(length) => Ok(pending.drain(..length).len()),
        Err(error) if is_not_now(error.kind()) => Ok(0),
        Err(error) => Err(error).context("writing to the emulator"),
    }
}

fn is_not_now(kind: ErrorKind) -> bool {
    matches!(
        kind,
        ErrorKind::TimedOut | ErrorKind::WouldBlock | ErrorKind::Interrupted
    )
}
