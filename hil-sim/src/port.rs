//! A virtual serial cable: two pseudo-terminals and a thread that carries bytes.
//!
//! Each end has a name that any program can open as a serial port (`/dev/pts/N`, or a
//! symbolic link of a fixed name). Both directions are [`Line`]s, so the cable can be
//! slow and bad. The cable itself loses nothing:
//!
//! - it holds its own handle on both ends, in raw mode from the start: nothing is
//!   echoed, nothing is lost while nobody has an end open, and an end may be opened,
//!   closed and opened again;
//! - when an end's reader is slow, the other end's writer has to wait;
//! - [`Cable::close`], and dropping, wait for readers that are still reading, and say
//!   how many bytes nobody took.
//!
//! [`Cable::unplug`] takes an end away as when a USB adapter is pulled: its name
//! disappears and whoever has it open gets an error. [`Cable::plug`] brings it back.

use std::fs::{self, File};
use std::io::{ErrorKind, Read, Write};
use std::os::fd::OwnedFd;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, Sender, TryRecvError, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use anyhow::{Context, Result, anyhow};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::{Mode, OFlags};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{OptionalActions, tcgetattr, tcsetattr};
use serialport::TTYPort;

use crate::clock::{Clock, RealClock};
use crate::faults::{Faults, Injected, Line};

/// The thread looks for commands at least this often.
const TICK: Duration = Duration::from_millis(5);
/// A reader that takes nothing for so long does not read any more.
const PATIENCE: Duration = Duration::from_millis(250);
/// The kernel has passed on by now what was written before.
const SETTLED: Duration = Duration::from_millis(30);
const CHUNK: usize = 1024;
/// On a paced line bytes are carried in bursts, as by the FIFO of a UART: the thread
/// sleeps between them.
const BURST: usize = 128;
const NAP: Duration = Duration::from_millis(1);

/// One end of a cable.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum End {
    /// the first
    A,
    /// the second
    B,
}

impl End {
    fn index(self) -> usize {
        self as usize
    }
}

/// How a cable is made. The default is perfect and has no fixed names.
#[derive(Clone, Debug, Default)]
pub struct CableSettings {
    /// faults of what is written to A and read from B
    pub a_to_b: Faults,
    /// faults of what is written to B and read from A
    pub b_to_a: Faults,
    /// symbolic links to be made for A and B; they must not exist yet, unless they are
    /// links that point nowhere
    pub names: [Option<PathBuf>; 2],
}

/// A virtual serial cable.
pub struct Cable {
    ends: Arc<Mutex<[Place; 2]>>,
    injected: Arc<Mutex<[Injected; 2]>>,
    commands: Sender<Command>,
    thread: Option<JoinHandle<[u64; 2]>>,
}

/// Where an end can be found.
#[derive(Clone, Debug)]
struct Place {
    device: Option<PathBuf>,
    name: Option<PathBuf>,
}

enum Command {
    /// puts a terminal at an end, or none, and answers
    Set(usize, Option<Terminal>, Sender<()>),
    Close,
}

impl Cable {
    /// A perfect cable.
    pub fn new() -> Result<Self> {
        Cable::with(CableSettings::default())
    }

    /// A cable with faults or names.
    pub fn with(settings: CableSettings) -> Result<Self> {
        let terminals = [Terminal::open()?, Terminal::open()?];
        let mut places = Vec::new();
        for (terminal, name) in terminals.iter().zip(settings.names) {
            let device = Some(terminal.path.clone());
            let place = Place { device, name };
            place.link()?;
            places.push(place);
        }
        let ends = Arc::new(Mutex::new([places.remove(0), places.remove(0)]));
        let injected = Arc::new(Mutex::new([Injected::default(); 2]));
        let (commands, inbox) = channel();
        let pump = Pump {
            ways: [Way::new(settings.a_to_b), Way::new(settings.b_to_a)],
            terminals: terminals.map(Some),
            injected: injected.clone(),
            clock: RealClock::start(),
        };
        let thread = std::thread::Builder::new()
            .name("serial cable".into())
            .spawn(move || pump.run(inbox))
            .context("cannot start the thread of a virtual cable")?;
        Ok(Cable {
            ends,
            injected,
            commands,
            thread: Some(thread),
        })
    }

    /// The name of an end: its link, or its device.
    pub fn path(&self, end: End) -> PathBuf {
        let ends = self.ends.lock().unwrap_or_else(PoisonError::into_inner);
        let place = &ends[end.index()];
        place
            .name
            .clone()
            .or(place.device.clone())
            .unwrap_or_default()
    }

    /// Opens an end in this process; reads wait for up to `timeout`.
    pub fn connect(&self, end: End, timeout: Duration) -> Result<TTYPort> {
        let path = self.path(end);
        serialport::new(path.to_string_lossy(), 115_200)
            .timeout(timeout)
            .open_native()
            .with_context(|| format!("cannot open {}", path.display()))
    }

    /// What was injected from A to B and from B to A, as of a few milliseconds ago.
    pub fn injected(&self) -> [Injected; 2] {
        *self.injected.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Takes an end away; bytes under way to it are lost and counted as cut.
    pub fn unplug(&self, end: End) -> Result<()> {
        let mut ends = self.ends.lock().unwrap_or_else(PoisonError::into_inner);
        let place = &mut ends[end.index()];
        place.unlink();
        place.device = None;
        self.set(end, None)
    }

    /// Brings an end back, as a new device under the old name.
    pub fn plug(&self, end: End) -> Result<()> {
        let terminal = Terminal::open()?;
        let mut ends = self.ends.lock().unwrap_or_else(PoisonError::into_inner);
        let place = &mut ends[end.index()];
        place.device = Some(terminal.path.clone());
        place.link()?;
        self.set(end, Some(terminal))
    }

    /// Ends the cable when all has been read or nobody reads any more; returns the
    /// bytes that nobody took at A and at B.
    pub fn close(mut self) -> [u64; 2] {
        self.end()
    }

    fn set(&self, end: End, terminal: Option<Terminal>) -> Result<()> {
        let (done, wait) = channel();
        let command = Command::Set(end.index(), terminal, done);
        let sent = self.commands.send(command).is_ok();
        (sent && wait.recv().is_ok())
            .then_some(())
            .ok_or_else(|| anyhow!("the thread of the virtual cable is gone"))
    }

    fn end(&mut self) -> [u64; 2] {
        let Some(thread) = self.thread.take() else {
            return [0; 2];
        };
        let _ = self.commands.send(Command::Close);
        let left = thread.join().unwrap_or_default();
        for place in self
            .ends
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .iter()
        {
            place.unlink();
        }
        left
    }
}

impl Drop for Cable {
    fn drop(&mut self) {
        self.end();
    }
}

impl Place {
    fn link(&self) -> Result<()> {
        let (Some(name), Some(device)) = (&self.name, &self.device) else {
            return Ok(());
        };
        if name.is_symlink() && !name.exists() {
            fs::remove_file(name).with_context(|| format!("cannot replace {}", name.display()))?;
        }
        std::os::unix::fs::symlink(device, name).with_context(|| match name.is_symlink() {
            true => format!(
                "cannot make the port {0}: remove {0} if no other program uses it",
                name.display()
            ),
            false => format!("cannot make the port {}", name.display()),
        })
    }

    fn unlink(&self) {
        if let Some(name) = self
            .name
            .as_ref()
            .filter(|name| points_to(name, &self.device))
        {
            let _ = fs::remove_file(name);
        }
    }
}

fn points_to(name: &Path, device: &Option<PathBuf>) -> bool {
    fs::read_link(name).ok() == *device && device.is_some()
}

/// A pseudo-terminal: the side of the cable, and a handle on the side of the programs.
struct Terminal {
    inner: File,
    outer: OwnedFd,
    path: PathBuf,
}

impl Terminal {
    fn open() -> Result<Self> {
        Terminal::try_open().context("cannot make a pseudo-terminal")
    }

    fn try_open() -> std::io::Result<Self> {
        let inner = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC)?;
        grantpt(&inner)?;
        unlockpt(&inner)?;
        let name = ptsname(&inner, Vec::new())?;
        let flags = OFlags::RDWR | OFlags::NOCTTY | OFlags::CLOEXEC;
        let outer = rustix::fs::open(name.as_c_str(), flags, Mode::empty())?;
        let mut settings = tcgetattr(&outer)?;
        settings.make_raw();
        tcsetattr(&outer, OptionalActions::Now, &settings)?;
        rustix::io::ioctl_fionbio(&inner, true)?;
        Ok(Terminal {
            inner: File::from(inner),
            outer,
            path: PathBuf::from(name.to_string_lossy().into_owned()),
        })
    }

    /// Bytes that programs have not read yet.
    fn unread(&self) -> u64 {
        rustix::io::ioctl_fionread(&self.outer).unwrap_or(0)
    }
}

/// One direction: the line, and what came out of it but was not taken yet.
struct Way {
    line: Line,
    arrived: Vec<u8>,
    cut: u64,
}

impl Way {
    fn new(faults: Faults) -> Self {
        Way {
            line: Line::new(faults),
            arrived: Vec::new(),
            cut: 0,
        }
    }

    fn injected(&self) -> Injected {
        let mut injected = self.line.injected();
        injected.cut += self.cut;
        injected.bytes_out -= self.cut;
        injected
    }

    fn room(&self, now: Duration) -> usize {
        let room = self.line.room(now).min(CHUNK);
        match self.arrived.len() < CHUNK && room >= BURST {
            true => room,
            false => 0,
        }
    }

    fn discard(&mut self) {
        self.line.pull(Duration::MAX, &mut self.arrived);
        self.cut += self.arrived.len() as u64;
        self.arrived.clear();
    }
}

/// The thread's state: way 0 goes from terminal 0 to terminal 1, way 1 back.
struct Pump {
    ways: [Way; 2],
    terminals: [Option<Terminal>; 2],
    injected: Arc<Mutex<[Injected; 2]>>,
    clock: RealClock,
}

impl Pump {
    fn run(mut self, inbox: Receiver<Command>) -> [u64; 2] {
        loop {
            match inbox.try_recv() {
                Ok(Command::Set(end, terminal, done)) => {
                    self.terminals[end] = terminal;
                    let _ = done.send(());
                }
                Ok(Command::Close) | Err(TryRecvError::Disconnected) => return self.drain(),
                Err(TryRecvError::Empty) => {
                    self.turn();
                }
            }
        }
    }

    /// Waits for something to do and does it; returns the bytes moved.
    fn turn(&mut self) -> usize {
        self.wait();
        let moved = self.carry(0) + self.carry(1);
        let injected = [self.ways[0].injected(), self.ways[1].injected()];
        *self.injected.lock().unwrap_or_else(PoisonError::into_inner) = injected;
        moved
    }

    fn wait(&self) {
        let now = self.clock.now();
        let due = self.ways.iter().filter_map(|way| way.line.next_due()).min();
        let timeout = due.map_or(TICK, |due| due.saturating_sub(now).clamp(NAP, TICK));
        let timeout = Timespec {
            tv_sec: 0,
            tv_nsec: timeout.as_nanos() as _,
        };
        let interest = |end: usize| {
            let mut flags = PollFlags::empty();
            flags.set(PollFlags::IN, self.ways[end].room(now) > 0);
            flags.set(PollFlags::OUT, !self.ways[1 - end].arrived.is_empty());
            self.terminals[end]
                .as_ref()
                .map(|t| PollFd::new(&t.inner, flags))
        };
        let mut handles: Vec<_> = [interest(0), interest(1)].into_iter().flatten().collect();
        let _ = poll(&mut handles, Some(&timeout));
    }

    /// Moves bytes from terminal `from` to the other.
    fn carry(&mut self, from: usize) -> usize {
        let (now, way) = (self.clock.now(), &mut self.ways[from]);
        let mut buffer = [0; CHUNK];
        let room = way.room(now);
        let taken = match &mut self.terminals[from] {
            Some(terminal) => terminal.inner.read(&mut buffer[..room]).unwrap_or(0),
            None => 0,
        };
        way.line.push(&buffer[..taken], now);
        way.line.pull(now, &mut way.arrived);
        let Some(terminal) = &mut self.terminals[1 - from] else {
            way.discard();
            return taken;
        };
        match terminal.inner.write(&way.arrived) {
            Ok(written) => {
                way.arrived.drain(..written);
                taken + written
            }
            Err(error) if error.kind() == ErrorKind::WouldBlock => taken,
            Err(_) => taken,
        }
    }

    /// Goes on until all is read or nothing moves any more.
    fn drain(mut self) -> [u64; 2] {
        let (mut last, mut since) = (u64::MAX, self.clock.now());
        loop {
            let moved = self.turn();
            let left = [self.left(0), self.left(1)];
            let total = left[0] + left[1];
            let paced = self.ways.iter().any(|way| way.line.waiting() > 0);
            if moved > 0 || total != last || paced {
                (last, since) = (total, self.clock.now());
            }
            let quiet = self.clock.now() - since;
            if quiet > if total == 0 { SETTLED } else { PATIENCE } {
                return left;
            }
            std::thread::sleep(Duration::from_millis(1));
        }
    }

    /// Bytes that the programs at an end have not taken.
    fn left(&self, end: usize) -> u64 {
        let way = &self.ways[1 - end];
        let unread = self.terminals[end].as_ref().map_or(0, Terminal::unread);
        unread + (way.arrived.len() + way.line.waiting()) as u64
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;
    use serialport::SerialPort;

    const WAIT: Duration = Duration::from_secs(20);

    fn bytes(n: usize, seed: u64) -> Vec<u8> {
        let mut random = Random::new(seed);
        (0..n).map(|_| random.bits() as u8).collect()
    }

    fn send(mut port: TTYPort, bytes: Vec<u8>) -> JoinHandle<TTYPort> {
        std::thread::spawn(move || {
            port.write_all(&bytes).unwrap();
            port
        })
    }

    fn receive(port: &mut TTYPort, n: usize) -> Vec<u8> {
        let mut got = vec![0; n];
        port.read_exact(&mut got).unwrap();
        got
    }

    #[test]
    fn both_ways_at_once_and_nothing_is_lost() {
        let cable = Cable::new().unwrap();
        let (a, b) = (
            cable.connect(End::A, WAIT).unwrap(),
            cable.connect(End::B, WAIT).unwrap(),
        );
        let (mut a2, mut b2) = (a.try_clone_native().unwrap(), b.try_clone_native().unwrap());
        let (east, west) = (bytes(200_000, 1), bytes(150_000, 2));
        let (ta, tb) = (send(a, east.clone()), send(b, west.clone()));
        let reader = std::thread::spawn(move || receive(&mut a2, 150_000));
        assert!(receive(&mut b2, 200_000) == east);
        assert!(reader.join().unwrap() == west);
        ta.join().unwrap();
        tb.join().unwrap();
        assert_eq!(cable.close(), [0, 0]);
    }

    #[test]
    fn bytes_sent_before_the_other_end_is_open_or_after_it_closed_arrive() {
        let cable = Cable::new().unwrap();
        let mut a = cable.connect(End::A, WAIT).unwrap();
        a.write_all(b"early\n\r\x03\x04").unwrap();
        drop(a);
        let mut b = cable.connect(End::B, WAIT).unwrap();
        assert_eq!(receive(&mut b, 9), b"early\n\r\x03\x04");
        drop(b);
        cable
            .connect(End::A, WAIT)
            .unwrap()
            .write_all(b"again")
            .unwrap();
        assert_eq!(
            receive(&mut cable.connect(End::B, WAIT).unwrap(), 5),
            b"again"
        );
    }

    #[test]
    fn closing_waits_for_a_reader_and_tells_what_nobody_took() {
        let cable = Cable::new().unwrap();
        let mut b = cable.connect(End::B, WAIT).unwrap();
        let sent = bytes(60_000, 3);
        let a = send(cable.connect(End::A, WAIT).unwrap(), sent.clone());
        let reader = std::thread::spawn(move || {
            let mut got = Vec::new();
            let mut buffer = [0; 500];
            while let Ok(n @ 1..) = b.read(&mut buffer) {
                got.extend_from_slice(&buffer[..n]);
                std::thread::sleep(Duration::from_micros(200));
            }
            got
        });
        a.join().unwrap();
        assert_eq!(cable.close(), [0, 0]);
        assert!(reader.join().unwrap() == sent);

        let cable = Cable::new().unwrap();
        cable
            .connect(End::B, WAIT)
            .unwrap()
            .write_all(&[1; 77])
            .unwrap();
        assert_eq!(cable.close(), [77, 0]);
    }

    #[test]
    fn fixed_names_appear_and_disappear() {
        let folder = tempfile::tempdir().unwrap();
        let names = ["scanner", "bridge"].map(|name| folder.path().join(name));
        let settings = CableSettings {
            names: names.clone().map(Some),
            ..Default::default()
        };
        let cable = Cable::with(settings.clone()).unwrap();
        assert_eq!([cable.path(End::A), cable.path(End::B)], names);
        cable
            .connect(End::A, WAIT)
            .unwrap()
            .write_all(b"x")
            .unwrap();
        assert_eq!(receive(&mut cable.connect(End::B, WAIT).unwrap(), 1), b"x");
        let taken = format!(
            "{:#}",
            Cable::with(settings).err().expect("a name that is taken")
        );
        assert!(
            taken.contains("remove") && taken.contains("scanner"),
            "{taken}"
        );
        drop(cable);
        assert!(names.iter().all(|name| !name.is_symlink()));
    }

    #[test]
    fn a_pulled_plug_is_an_error_and_comes_back_under_its_name() {
        let folder = tempfile::tempdir().unwrap();
        let name = folder.path().join("port");
        let cable = Cable::with(CableSettings {
            names: [None, Some(name.clone())],
            ..Default::default()
        });
        let cable = cable.unwrap();
        let mut a = cable.connect(End::A, WAIT).unwrap();
        let mut b = cable.connect(End::B, Duration::from_millis(500)).unwrap();
        cable.unplug(End::B).unwrap();
        let error = b.read(&mut [0; 8]).unwrap_err();
        assert_ne!(error.kind(), ErrorKind::TimedOut);
        assert!(!name.exists());
        a.write_all(b"lost").unwrap();
        let deadline = std::time::Instant::now() + WAIT;
        while cable.injected()[0].cut < 4 && std::time::Instant::now() < deadline {
            std::thread::sleep(TICK);
        }
        assert_eq!(cable.injected()[0].cut, 4);
        cable.plug(End::B).unwrap();
        a.write_all(b"back").unwrap();
        assert_eq!(
            receive(&mut cable.connect(End::B, WAIT).unwrap(), 4),
            b"back"
        );
    }

    #[test]
    fn a_bad_cable_counts_what_it_does() {
        let faults = Faults {
            drop_rate: 0.01,
            bit_error_rate: 1e-3,
            seed: 4,
            ..Faults::default()
        };
        let settings = CableSettings {
            a_to_b: faults,
            ..Default::default()
        };
        let cable = Cable::with(settings).unwrap();
        let mut b = cable.connect(End::B, Duration::from_millis(300)).unwrap();
        let a = send(cable.connect(End::A, WAIT).unwrap(), bytes(50_000, 5));
        let (mut got, mut buffer) = (0, [0; 4096]);
        while let Ok(n) = b.read(&mut buffer) {
            got += n as u64;
        }
        a.join().unwrap();
        let [there, back] = cable.injected();
        assert_eq!((there.bytes_in, there.bytes_out), (50_000, got));
        assert_eq!(there.bytes_out, there.bytes_in - there.dropped);
        assert!(there.dropped > 300 && there.bits_flipped > 200);
        assert_eq!(back, Injected::default());
    }

    #[test]
    fn ports_can_be_cleared_and_have_a_name() {
        let cable = Cable::new().unwrap();
        let port = cable.connect(End::A, WAIT).unwrap();
        port.clear(serialport::ClearBuffer::All).unwrap();
        assert_eq!(port.name().map(PathBuf::from), Some(cable.path(End::A)));
    }
}
