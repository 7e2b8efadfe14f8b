//! `rugosa scan --device`: listens to a module that maps by itself.

use super::hil::layers;
use super::session;
use crate::bridge::outputs::save_layers;
use crate::console::{Console, Progress};
use crate::error::{Failure, Result};
use crate::io::atomic;
use crate::link::{Connection, News, PortName, Settings};
use rugosa_hil::SentMap;
use rugosa_wire::{Event, Hello, Message, Role, Status, counter};
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

const TICK: Duration = Duration::from_millis(50);
/// A map is complete when so long neither a sweep was mapped nor a patch has come: what a sweep
/// changed is sent after the module has told of it.
const QUIET: Duration = Duration::from_millis(1500);

/// What a module has told.
#[derive(Default)]
struct Told {
    module: Option<Hello>,
    map: SentMap,
    status: Option<Status>,
    statuses: u32,
    restarts_seen: u32,
}

#[derive(Serialize)]
struct Report<'a> {
    device: &'a str,
    version: &'a str,
    sweeps: u32,
    patches: u32,
    restarts_seen: u32,
    port_losses: u32,
    seconds: f64,
    counters: BTreeMap<&'static str, u32>,
    files: Vec<String>,
}

impl Told {
    fn counter(&self, index: usize) -> u32 {
        let counters = self.status.as_ref().map(|status| &status.counters);
        let value = counters.and_then(|all| all.get(index));
        value.copied().unwrap_or(0)
    }

    /// Sweeps that it has mapped, and what it has sent of the map.
    fn progress(&self) -> [u32; 2] {
        [self.counter(counter::SWEEPS), self.map.patches()]
    }

    fn take(&mut self, message: Message) {
        match message {
            Message::Patch(patch) => self.map.place(&patch),
            Message::Status(status) => {
                self.statuses += 1;
                self.status = Some(status);
            }
            _ => {}
        }
    }

    /// The module has started: what it told before is of another map.
    fn forget(&mut self) {
        self.restarts_seen += u32::from(self.status.is_some());
        (self.map, self.status) = (SentMap::default(), None);
    }
}

/// Listens until Ctrl-C, or until the module has mapped so many sweeps and has sent what
/// they changed.
pub fn run(
    (port, baud): (&PortName, u32),
    sweeps: Option<u32>,
    out: Option<&Path>,
    console: &Console,
) -> Result<()> {
    if let Some(out) = out.filter(|out| out.extension().is_some() && !out.is_dir()) {
        return Err(Failure::input(format_args!(
            "--out {}: with --device a directory is needed",
            out.display()
        )));
    }
    let hello = Hello::new(Role::Host, "rugosa", env!("CARGO_PKG_VERSION"));
    let mut connection = Connection::open(Settings {
        baud,
        ..Settings::new(port.clone(), hello)
    })?;
    let (started, mut told) = (Instant::now(), Told::default());
    listen(&mut connection, &mut told, sweeps, console)?;
    let Some(module) = &told.module else {
        return Err(Failure::runtime(format_args!(
            "no module has greeted on {port}"
        )));
    };
    let report = Report {
        device: &module.device,
        version: &module.version,
        sweeps: told.counter(counter::SWEEPS),
        patches: told.map.patches(),
        restarts_seen: told.restarts_seen,
        port_losses: connection.state().port_losses,
        seconds: started.elapsed().as_secs_f64(),
        counters: named(&told),
        files: match out {
            Some(folder) => save(folder, &told)?,
            None => Vec::new(),
        },
    };
    if let Some(folder) = out {
        atomic::write(&folder.join("summary.json"), |file| {
            serde_json::to_writer_pretty(&mut *file, &report)?;
            writeln!(file)
        })?;
    }
    console.result(&report, text(&report))
}

fn listen(
    connection: &mut Connection,
    told: &mut Told,
    sweeps: Option<u32>,
    console: &Console,
) -> Result<()> {
    let (stop, mut progress) = (session::stop()?, console.progress("device", None));
    let mut news = Instant::now();
    while !stop.load(Ordering::Relaxed) {
        if let Some(arrival) = connection.next(TICK) {
            match arrival.news {
                News::Link(Event::Message(frame)) => {
                    let before = told.progress();
                    told.take(frame.message);
                    if told.progress() != before {
                        news = Instant::now();
                    }
                }
                News::Link(Event::Connected { resumed }) => {
                    greet(connection, told, resumed, console)?;
                    news = Instant::now();
                }
                News::Link(Event::Refused(refusal)) => return Err(Failure::runtime(refusal)),
                News::Link(Event::Silent) => {
                    console.note("the module has fallen silent; greeting it again");
                }
                News::Link(Event::Broken(_)) => {} // counted by the link
                News::PortLost(why) => {
                    console.note(format_args!("the port has disappeared ({why}); waiting"));
                }
                News::PortFound => console.note("the port is there again"),
            }
        }
        show(&mut progress, told);
        let mapped = sweeps.is_some_and(|n| told.counter(counter::SWEEPS) >= n);
        if mapped && news.elapsed() > QUIET {
            break;
        }
    }
    Ok(())
}

/// Asks for the whole map: parts of it may have been sent to somebody else.
fn greet(connection: &Connection, told: &mut Told, resumed: bool, console: &Console) -> Result<()> {
    let Some(peer) = connection.state().peer else {
        return Ok(());
    };
    if peer.role != Role::Module {
        return Err(Failure::input(format_args!(
            "{} {} is no module: leave --device out to map what a scanner sends",
            peer.device, peer.version
        )));
    }
    console.note(format_args!(
        "connected to {} {}: {} × {} cells of {} mm",
        peer.device,
        peer.version,
        peer.map_side,
        peer.map_side,
        peer.resolution_um / 1000
    ));
    if !resumed {
        told.forget();
    }
    told.module = Some(peer);
    let _ = connection.send(Message::Refresh); // a link that breaks now is greeted again
    Ok(())
}

fn show(progress: &mut Progress, told: &Told) {
    progress.set(u64::from(told.counter(counter::SWEEPS)), || {
        format!(
            "{} sweeps, {} lines, {} lost, {} cells, {} patches",
            told.counter(counter::SWEEPS),
            told.counter(counter::LINES_RECEIVED),
            told.counter(counter::LINES_LOST),
            told.counter(counter::CELLS_MEASURED),
            told.map.patches()
        )
    });
}

fn named(told: &Told) -> BTreeMap<&'static str, u32> {
    let names = counter::NAMES.iter().enumerate();
    names.map(|(i, &name)| (name, told.counter(i))).collect()
}

fn save(folder: &Path, told: &Told) -> Result<Vec<String>> {
    let resolution = told.module.as_ref().map_or(0, |hello| hello.resolution_um);
    let Some(extent) = told.map.extent().filter(|_| resolution > 0) else {
        return Ok(Vec::new());
    };
    let layers = layers(&told.map, &extent, resolution as f32 * 1e-6);
    let files = save_layers(folder, &layers)?;
    Ok(files.iter().map(|f| f.display().to_string()).collect())
}

fn text(report: &Report) -> String {
    let counters = report.counters.iter().filter(|(_, value)| **value > 0);
    let counters: Vec<String> = counters.map(|(name, n)| format!("{name} {n}")).collect();
    format!(
        "module     {} {}\nsweeps     {}\npatches    {}\nrestarts   {}\ncounters   {}\nfiles      {}",
        report.device,
        report.version,
        report.sweeps,
        report.patches,
        report.restarts_seen,
        counters.join("\n           "),
        report.files.join("\n           ")
    )
}
