//! What `scan`, `replay` and `demo` share: options, the map's memory, Ctrl-C, progress.

use crate::bridge::{Bridge, Extras, Module, Outputs, Summary, known_part, layers_of, timings};
use crate::config::Settings;
use crate::console::{Console, Progress};
use crate::error::{Failure, Result};
use crate::link::{self, PortName};
use crate::planes::HeapPlanes;
use crate::saved::SavedMap;
use crate::view::Data;
use crate::view::live::Server;
use rugosa::Mapper;
use rugosa_wire::counter;
use serde::Serialize;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Least time between two states of a live view.
const LIVE_INTERVAL: Duration = Duration::from_secs(1);

/// Options of every command that makes a map.
#[derive(Clone, Debug, clap::Args)]
pub struct MapArgs {
    /// Configuration (TOML, see `rugosa config`)
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,

    /// Where the results go: a directory, or a .json, .npy, .asc or .png file
    #[arg(long, value_name = "PATH")]
    pub out: Option<PathBuf>,

    /// Also write report.html, a page that needs no network, into the directory
    #[arg(long)]
    pub report: bool,

    /// Go on with the map of an earlier run (its map.rugosa)
    #[arg(long, value_name = "FILE")]
    pub resume: Option<PathBuf>,
}

impl MapArgs {
    /// The configuration and the outputs, both checked before anything starts.
    pub fn check(&self) -> Result<Checked> {
        self.check_with(false)
    }

    /// The same; `plan` also draws a way across the map.
    pub fn check_with(&self, plan: bool) -> Result<Checked> {
        if self.report && self.out.is_none() {
            return Err(Failure::input("--report: --out DIR is needed"));
        }
        let extras = Extras {
            report: self.report,
            plan,
        };
        let outputs = self.out.as_deref().map(|path| Outputs::new(path, extras));
        let mut settings = Settings::read(self.config.as_deref())?;
        let earlier = self.resume.as_deref().map(earlier).transpose()?;
        if let Some(map) = &earlier {
            let fitted = map.fit(settings)?;
            settings = Settings {
                side: settings.side.max(fitted.side),
                ..fitted
            };
        }
        Ok(Checked {
            settings,
            outputs: outputs.transpose()?,
            earlier,
        })
    }
}

/// The map of an earlier run, in the robot's own coordinates.
fn earlier(path: &Path) -> Result<SavedMap> {
    let map = SavedMap::read(path)?;
    if map.rise != 0 || map.shift.iter().any(|s| s.abs() > 1e-6) {
        return Err(Failure::file(
            path,
            "a map of files, not of a robot: its coordinates are not those of a scanner",
        ));
    }
    Ok(map)
}

/// Options that were found good.
pub struct Checked {
    /// the configuration
    pub settings: Settings,
    /// where results go
    pub outputs: Option<Outputs>,
    earlier: Option<SavedMap>,
}

impl Checked {
    /// A module that maps into `planes`, beginning with the map of the earlier run.
    pub fn module<'m>(&self, planes: &'m mut HeapPlanes) -> Result<Module<'m>> {
        let mut module = module(&self.settings, planes)?;
        if let Some(map) = &self.earlier {
            map.load(&mut module.mapper)?;
        }
        Ok(module)
    }
}

/// The live view of a module's map, brought up to date at most once a second.
pub struct Live {
    server: Server,
    sweeps: u32,
    shown: Option<Instant>,
}

impl Live {
    /// Starts the server and says where it is.
    pub fn start(address: SocketAddr, console: &Console) -> Result<Self> {
        let server = Server::start(address)?;
        console.note(format_args!("live view at http://{}/", server.address));
        if !address.ip().is_loopback() {
            console.note("everybody who can reach this address can see the map");
        }
        Ok(Live {
            server,
            sweeps: 0,
            shown: None,
        })
    }

    /// Shows the map if a sweep has been completed.
    pub fn show(&mut self, module: &Module, started: Instant) -> Result<()> {
        let sweeps = module.mapper.counters().get(counter::SWEEPS);
        let soon = self.shown.is_some_and(|at| at.elapsed() < LIVE_INTERVAL);
        if sweeps == self.sweeps || soon {
            return Ok(());
        }
        (self.sweeps, self.shown) = (sweeps, Some(Instant::now()));
        let (mapper, report) = (&module.mapper, module.report.as_ref());
        let seconds = started.elapsed().as_secs_f64();
        let summary = Summary::of(mapper, report, &module.traffic, seconds);
        let layers = known_part(&layers_of(mapper));
        let data = Data::of("Live map", mapper, &layers, &summary, timings(&summary));
        self.server.publish(data.json()?);
        Ok(())
    }
}

/// A module that maps into `planes`.
pub fn module<'m>(settings: &Settings, planes: &'m mut HeapPlanes) -> Result<Module<'m>> {
    let mapper = Mapper::new(settings.mapper, planes.lend()).map_err(Failure::input)?;
    Ok(Module::new(mapper))
}

/// Opens a port for the module.
pub fn bridge(module: &Module, port: PortName, baud: u32, console: &Console) -> Result<Bridge> {
    let settings = link::Settings {
        baud,
        measure_latency: true,
        ..link::Settings::new(port, module.hello())
    };
    Bridge::open(settings, console)
}

/// Set by Ctrl-C (or a termination signal); a second Ctrl-C ends the process at once.
pub fn stop() -> Result<&'static AtomicBool> {
    static STOP: AtomicBool = AtomicBool::new(false);
    static HANDLER: OnceLock<bool> = OnceLock::new();
    let installed = HANDLER.get_or_init(|| {
        let handler = || {
            if STOP.swap(true, Ordering::Relaxed) {
                std::process::exit(1);
            }
        };
        ctrlc::set_handler(handler).is_ok()
    });
    if *installed {
        Ok(&STOP)
    } else {
        Err(Failure::runtime("cannot handle Ctrl-C"))
    }
}

/// Shows rate, lines, losses and latency.
pub fn show(progress: &mut Progress, module: &Module) {
    let get = |index| module.mapper.counters().get(index);
    progress.set(u64::from(get(counter::SWEEPS)), || {
        let traffic = &module.traffic;
        let lost = get(counter::LINES_LOST).max(get(counter::LINK_LOST));
        format!(
            "{} sweeps, {} lines ({:.0}/s), {lost} lost, {} cells, {:.1} ms a sweep, round trip {:.1} ms",
            get(counter::SWEEPS),
            traffic.lines,
            traffic.rate(),
            get(counter::CELLS_MEASURED),
            traffic.sweep.mean,
            traffic.round_trip.mean_us().unwrap_or(0) as f64 / 1000.0,
        )
    });
}

#[derive(Serialize)]
struct Report<'a> {
    #[serde(flatten)]
    summary: &'a Summary,
    files: &'a [PathBuf],
}

/// Saves the outputs and prints the summary.
pub fn finish(
    mapper: &Mapper,
    summary: &Summary,
    outputs: Option<&Outputs>,
    console: &Console,
) -> Result<()> {
    let files = match outputs {
        Some(outputs) => outputs.save(mapper, summary)?,
        None => Vec::new(),
    };
    let list: Vec<String> = files.iter().map(|f| f.display().to_string()).collect();
    let text = if list.is_empty() {
        summary.to_string()
    } else {
        format!("{summary}\nfiles      {}", list.join("\n           "))
    };
    let report = Report {
        summary,
        files: &files,
    };
    console.result(&report, text)
}
