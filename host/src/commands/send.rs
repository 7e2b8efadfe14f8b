//! What `simulate`, `replay` and `demo` share: the scanner's end of a port.

use super::session;
use crate::error::{Failure, Result};
use crate::link::PortName;
use rugosa_hil_sim::clock::{Pace, RealClock};
use rugosa_hil_sim::port::{Cable, CableSettings, End};
use rugosa_hil_sim::stream::Stamped;
use rugosa_hil_sim::transmit::{Sending, Sent, Transmitter};
use rugosa_wire::{Hello, Message, Role};
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

/// Symbols per second unless told otherwise.
pub const BAUD: u32 = 921_600;
/// Time that the last bytes get before a port is closed.
const LINGER: Duration = Duration::from_millis(300);

/// Options of a sender.
#[derive(Debug, clap::Args)]
pub struct PortArgs {
    /// Serial port, real or virtual
    #[arg(long, required_unless_present = "virtual_port")]
    port: Option<PathBuf>,

    /// Make a virtual serial port of this name for the other side to open
    #[arg(long = "virtual", value_name = "NAME", conflicts_with = "port")]
    virtual_port: Option<PathBuf>,

    /// Symbols per second (of no effect on USB and virtual ports)
    #[arg(long, default_value_t = BAUD)]
    baud: u32,
}

/// A port of our own or somebody else's.
pub struct Place {
    /// keeps a virtual port alive
    cable: Option<Cable>,
    path: PathBuf,
    baud: u32,
}

impl PortArgs {
    /// The same without a command line.
    pub fn new(port: Option<PathBuf>, virtual_port: Option<PathBuf>, baud: u32) -> Self {
        PortArgs {
            port,
            virtual_port,
            baud,
        }
    }

    /// Makes the virtual port, if that was asked for.
    pub fn place(&self) -> Result<Place> {
        let Some(name) = &self.virtual_port else {
            let path = self.port.clone().unwrap_or_default();
            return Ok(Place {
                cable: None,
                path,
                baud: self.baud,
            });
        };
        let settings = CableSettings {
            names: [None, Some(name.clone())],
            ..CableSettings::default()
        };
        let cable =
            Cable::with(settings).map_err(|e| Failure::file(name, format_args!("{e:#}")))?;
        Ok(Place {
            path: cable.path(End::A),
            cable: Some(cable),
            baud: self.baud,
        })
    }
}

/// What is sent, and how.
pub struct Script<'a> {
    /// name for the greeting
    pub device: &'a str,
    /// what is said first in every connection
    pub description: Vec<Message>,
    /// everything else
    pub messages: Box<dyn Iterator<Item = Stamped> + Send>,
    /// at which pace
    pub pace: Pace,
}

impl Place {
    /// A port that exists.
    pub fn at(path: PathBuf) -> Self {
        Place {
            cable: None,
            path,
            baud: BAUD,
        }
    }

    /// Sends everything, opening the port again whenever it disappears, until `stop`.
    pub fn send(
        &self,
        mut script: Script,
        stop: &AtomicBool,
        mut watch: impl FnMut(&Sent),
    ) -> Result<Sent> {
        let hello = Hello::new(Role::Scanner, script.device, env!("CARGO_PKG_VERSION"));
        let open = || open(&self.path, self.baud);
        let mut transmitter = Transmitter::new(open()?, RealClock::start(), hello, fresh_session())
            .describe(script.description);
        let sending = Sending {
            pace: script.pace,
            patience: None,
        };
        loop {
            match transmitter.run(&mut script.messages, sending, stop, &mut watch) {
                Ok(_) => break,
                Err(error) if self.path.exists() => {
                    return Err(Failure::runtime(format_args!("{error:#}")));
                }
                Err(_) => match reopen(&open, stop) {
                    Some(port) => transmitter.reopen(port),
                    None => break,
                },
            }
        }
        let _ = transmitter.idle(LINGER);
        Ok(transmitter.sent())
    }

    /// Ends a virtual port when the other side has read everything.
    pub fn close(self) {
        if let Some(cable) = self.cable {
            cable.close();
        }
    }
}

/// A session number that differs from those of the last starts.
fn fresh_session() -> u32 {
    let now = SystemTime::now().duration_since(UNIX_EPOCH);
    (now.map_or(1, |d| d.as_micros()) as u32).max(1)
}

fn open(path: &Path, baud: u32) -> Result<Box<dyn serialport::SerialPort>> {
    let mut port = PortName::Path(path.to_string_lossy().into_owned()).open(baud)?;
    port.set_timeout(Duration::from_millis(1))
        .map_err(|e| Failure::file(path, e))?;
    Ok(port)
}

type Port = Box<dyn serialport::SerialPort>;

fn reopen(open: &impl Fn() -> Result<Port>, stop: &AtomicBool) -> Option<Port> {
    while !stop.load(Ordering::Relaxed) {
        if let Ok(port) = open() {
            return Some(port);
        }
        std::thread::sleep(Duration::from_millis(200));
    }
    None
}

/// `--speed`: 1 is real time, 0 as fast as the link takes it.
pub fn pace(speed: f64) -> Result<Pace> {
    match speed {
        0.0 => Ok(Pace::Unlimited),
        s if s.is_finite() && s > 0.0 => Ok(Pace::Times(s)),
        s => Err(Failure::input(format_args!(
            "--speed {s}: 0 or a positive number is needed"
        ))),
    }
}

/// What was sent, for `--json`.
#[derive(Serialize)]
pub struct Report {
    sweeps: u32,
    lines: u64,
    poses: u64,
    bytes: u64,
    connections: u32,
    waits_for_credit: u64,
    worst_late_ms: f64,
}

impl Report {
    /// Of what a transmitter sent.
    pub fn of(sent: &Sent) -> Self {
        Report {
            sweeps: sent.sweeps,
            lines: sent.lines,
            poses: sent.poses,
            bytes: sent.bytes,
            connections: sent.connections,
            waits_for_credit: sent.waits,
            worst_late_ms: sent.worst_late_us as f64 / 1000.0,
        }
    }
}

/// Sends a script through a port with progress, and prints what was sent.
pub fn send_all(args: &PortArgs, script: Script, console: &crate::console::Console) -> Result<()> {
    let place = args.place()?;
    if let Some(name) = &args.virtual_port {
        console.note(format_args!(
            "{} is ready; waiting for the other side",
            name.display()
        ));
    }
    let mut progress = console.progress("send", None);
    let watch = |sent: &Sent| {
        progress.set(u64::from(sent.sweeps), || {
            format!(
                "{} sweeps, {} lines, {:.1} MB",
                sent.sweeps,
                sent.lines,
                sent.bytes as f64 * 1e-6
            )
        });
    };
    let sent = place.send(script, session::stop()?, watch)?;
    place.close();
    drop(progress);
    let text = format!(
        "{} lines of {} sweeps, {} poses, {:.1} MB",
        sent.lines,
        sent.sweeps,
        sent.poses,
        sent.bytes as f64 * 1e-6
    );
    console.result(&Report::of(&sent), text)
}
