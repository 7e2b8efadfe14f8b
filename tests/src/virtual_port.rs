//! Messages through a virtual serial port into a map, with the command's own parts:
//! transmitter → pseudo-terminals → connection → module.

use anyhow::{Result, ensure};
use rugosa::{Config, Mapper};
use rugosa_hil_sim::clock::RealClock;
use rugosa_hil_sim::port::{Cable, End};
use rugosa_hil_sim::stream::Stamped;
use rugosa_hil_sim::transmit::{Sending, Transmitter};
use rugosa_host::bridge::{Bridge, Module};
use rugosa_host::console::Console;
use rugosa_host::link::{PortName, Settings};
use rugosa_host::planes::HeapPlanes;
use rugosa_wire::{Hello, Message, Role, counter};
use std::io::{Read, Write};
use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};

/// Nothing more will come after so long.
const QUIET: Duration = Duration::from_millis(500);
/// A test that takes longer has failed.
const TOO_LONG: Duration = Duration::from_secs(240);

/// What a scanner says, and the map it is to become.
pub struct Script {
    /// what is said first
    pub description: Vec<Message>,
    /// the rest
    pub messages: Vec<Message>,
    /// cells a side
    pub side: usize,
    /// parameters
    pub config: Config,
}

/// A port whose writes are cut into pieces of at most so many bytes.
struct Chunked<P> {
    port: P,
    most: usize,
}

impl<P: Read> Read for Chunked<P> {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        self.port.read(buffer)
    }
}

impl<P: Write> Write for Chunked<P> {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.port.write(&bytes[..bytes.len().min(self.most)])
    }

    fn flush(&mut self) -> std::io::Result<()> {
        self.port.flush()
    }
}

impl Script {
    /// Lines in it.
    pub fn lines(&self) -> u64 {
        let is_line = |m: &&Message| matches!(m, Message::Line(_));
        self.messages.iter().filter(is_line).count() as u64
    }

    /// Feeds the messages to a mapper without a link.
    pub fn map_directly<R>(&self, read: impl FnOnce(&Mapper) -> R) -> Result<R> {
        let mut planes = HeapPlanes::new(self.side);
        let mut mapper = Mapper::new(self.config, planes.lend())?;
        for message in self.description.iter().chain(&self.messages) {
            mapper.message(message);
        }
        Ok(read(&mapper))
    }

    /// Sends the messages through a virtual port in pieces of at most `most` bytes.
    pub fn map_through_port<R>(&self, most: usize, read: impl FnOnce(&Mapper) -> R) -> Result<R> {
        let cable = Cable::new()?;
        let mut planes = HeapPlanes::new(self.side);
        let mut module = Module::new(Mapper::new(self.config, planes.lend())?);
        let port = PortName::Path(cable.path(End::B).to_string_lossy().into_owned());
        let console = Console {
            quiet: true,
            json: false,
        };
        let mut bridge = Bridge::open(Settings::new(port, module.hello()), &console)?;
        let stop = AtomicBool::new(false);
        let started = Instant::now();
        let (mut lines, mut quiet) = (0, Instant::now());
        std::thread::scope(|scope| -> Result<()> {
            let sender = scope.spawn(|| self.send(&cable, most));
            bridge.serve(&mut module, &stop, |module| {
                if module.traffic.lines != lines || !sender.is_finished() {
                    (lines, quiet) = (module.traffic.lines, Instant::now());
                }
                quiet.elapsed() > QUIET || started.elapsed() > TOO_LONG
            })?;
            let sent = sender
                .join()
                .map_err(|_| anyhow::anyhow!("the sender panicked"))??;
            ensure!(sent == self.lines(), "{sent} lines sent");
            Ok(())
        })?;
        ensure!(
            started.elapsed() < TOO_LONG,
            "no end of the stream in {TOO_LONG:?}"
        );
        Ok(read(&module.mapper))
    }

    fn send(&self, cable: &Cable, most: usize) -> Result<u64> {
        let port = Chunked {
            port: cable.connect(End::A, Duration::ZERO)?,
            most,
        };
        let hello = Hello::new(Role::Scanner, "test", "1");
        let mut transmitter = Transmitter::new(port, RealClock::start(), hello, 77)
            .describe(self.description.clone());
        let mut messages = self
            .messages
            .iter()
            .enumerate()
            .map(|(i, message)| Stamped {
                stamp_us: i as u64,
                message: message.clone(),
            });
        let stop = AtomicBool::new(false);
        let sent = transmitter.run(&mut messages, Sending::UNLIMITED, &stop, &mut |_| {})?;
        transmitter.idle(Duration::from_millis(300))?;
        Ok(sent.lines)
    }
}

/// What a map came to, to the last bit.
pub fn outcome(mapper: &Mapper) -> serde_json::Value {
    let get = |index| mapper.counters().get(index);
    let rejected: u32 = (0..counter::NAMES.len())
        .filter(|&i| counter::NAMES[i].starts_with("lines.rejected"))
        .map(get)
        .sum();
    let roughness = rugosa_fractal::roughness::estimate(&mapper.pool(), &mapper.settings()).ok();
    serde_json::json!({
        "sweeps": get(counter::SWEEPS),
        "lines": { "used": get(counter::LINES_USED), "lost": get(counter::LINES_LOST), "rejected": rejected },
        "returns_used": get(counter::RETURNS_USED),
        "cells_measured": get(counter::CELLS_MEASURED),
        "dimension": roughness.map(|r| f64::from(r.dimension)),
        "fingerprint": format!("{:016x}", fingerprint(mapper)),
    })
}

/// A number that changes with every bit of the map (FNV-1a over the layers).
pub fn fingerprint(mapper: &Mapper) -> u64 {
    let mut hash = 0xcbf2_9ce4_8422_2325u64;
    let mut plane = vec![0.0; mapper.window().len()];
    for layer in rugosa::LAYERS {
        mapper.fill(layer.layer, &mut plane);
        for byte in plane.iter().flat_map(|v| v.to_bits().to_le_bytes()) {
            hash = (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3);
        }
    }
    hash
}
