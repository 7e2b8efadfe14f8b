//! What `scan`, `replay` and `demo` share: options, the map's memory, Ctrl-C, progress.

use crate::bridge::{Bridge, Module, Outputs, Summary};
use crate::config::Settings;
use crate::console::{Console, Progress};
use crate::error::{Failure, Result};
use crate::link::{self, PortName};
use crate::planes::HeapPlanes;
use rugosa::Mapper;
use rugosa_wire::counter;
use serde::Serialize;
use std::path::PathBuf;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, Ordering};

/// Options of every command that makes a map.
#[derive(Debug, clap::Args)]
pub struct MapArgs {
    /// Configuration (TOML, see `rugosa config`)
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,

    /// Where the results go: a directory, or a .json, .npy, .asc or .png file
    #[arg(long, value_name = "PATH")]
    pub out: Option<PathBuf>,
}

impl MapArgs {
    /// The configuration and the outputs, both checked before anything starts.
    pub fn check(&self) -> Result<(Settings, Option<Outputs>)> {
        let settings = Settings::read(self.config.as_deref())?;
        let outputs = self.out.as_deref().map(Outputs::new).transpose()?;
        Ok((settings, outputs))
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
