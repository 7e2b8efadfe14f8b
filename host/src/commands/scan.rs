//! `rugosa scan`: the bridge from a scanner on a serial port to a map.

use super::device;
use super::session::{self, Live, MapArgs};
use crate::bridge::Summary;
use crate::console::Console;
use crate::error::Result;
use crate::link::PortName;
use crate::planes::HeapPlanes;
use crate::recording::Recorder;
use rugosa_wire::counter;
use std::path::PathBuf;
use std::time::Instant;

/// Map what a scanner on a serial port sends, until Ctrl-C.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  rugosa scan --port /dev/ttyACM0 --out map
  rugosa scan --port /dev/ttyUSB0 --baud 921600 --record run1.mcap --out map
  rugosa scan --port /tmp/scanner --sweeps 10 --json
  rugosa scan --device --port /dev/ttyUSB1 --baud 921600 --out map

A port that disappears is waited for. Ctrl-C ends cleanly with everything saved.")]
pub struct Args {
    /// Serial port, real or virtual, or usb: and the serial number of a USB device
    #[arg(long)]
    port: PortName,

    /// Symbols per second (of no effect on USB and virtual ports)
    #[arg(long, default_value_t = super::send::BAUD)]
    baud: u32,

    /// The port leads to a module that maps by itself: show and save what it tells
    #[arg(long, conflicts_with_all = ["record", "config", "report", "resume"])]
    device: bool,

    /// Record everything that comes into this MCAP file
    #[arg(long, value_name = "FILE")]
    record: Option<PathBuf>,

    /// End after this many complete sweeps
    #[arg(long)]
    sweeps: Option<u32>,

    #[command(flatten)]
    map: MapArgs,
}

/// Serves the port.
pub fn run(args: &Args, console: &Console) -> Result<()> {
    if args.device {
        let port = (&args.port, args.baud);
        return device::run(port, args.sweeps, args.map.out.as_deref(), console);
    }
    serve(args, None, console)
}

/// Serves the port, with a live view.
pub fn serve(args: &Args, mut live: Option<Live>, console: &Console) -> Result<()> {
    let checked = args.map.check()?;
    let mut planes = HeapPlanes::new(checked.settings.side);
    let mut module = checked.module(&mut planes)?;
    let mut bridge = session::bridge(&module, args.port.clone(), args.baud, console)?;
    if let Some(path) = &args.record {
        module.record_into(Recorder::create(path)?);
    }
    let started = Instant::now();
    let mut progress = console.progress("scan", None);
    let mut shown = Ok(());
    let served = bridge.serve(&mut module, session::stop()?, |module| {
        session::show(&mut progress, module);
        shown = live
            .as_mut()
            .map_or(Ok(()), |live| live.show(module, started));
        let sweeps = module.mapper.counters().get(counter::SWEEPS);
        shown.is_err() || args.sweeps.is_some_and(|n| sweeps >= n)
    });
    drop(progress);
    // what had arrived is saved before an error is told
    module.close();
    module.finish()?;
    let seconds = started.elapsed().as_secs_f64();
    let summary = Summary::of(
        &module.mapper,
        module.report.as_ref(),
        &module.traffic,
        seconds,
    );
    session::finish(&module.mapper, &summary, checked.outputs.as_ref(), console)?;
    shown.and(served)
}
