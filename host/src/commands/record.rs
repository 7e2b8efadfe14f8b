//! `rugosa record`: what a scanner says, into a file.

use super::session;
use crate::config::Settings;
use crate::console::Console;
use crate::error::Result;
use crate::link::PortName;
use crate::planes::HeapPlanes;
use crate::recording::Recorder;
use rugosa_wire::counter;
use std::path::PathBuf;

/// Record what a scanner on a serial port sends, until Ctrl-C.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  rugosa record --port /dev/ttyACM0 --out run1.mcap
  rugosa record --port /dev/ttyACM0 --out run1.mcap --sweeps 100

The file is readable up to its last chunk (at most a second) whenever the process ends.")]
pub struct Args {
    /// Serial port, real or virtual, or usb: and the serial number of a USB device
    #[arg(long)]
    port: PortName,

    /// Symbols per second (of no effect on USB and virtual ports)
    #[arg(long, default_value_t = super::send::BAUD)]
    baud: u32,

    /// The MCAP file to be made; one that exists is not overwritten
    #[arg(long, value_name = "FILE")]
    out: PathBuf,

    /// End after this many complete sweeps
    #[arg(long)]
    sweeps: Option<u32>,
}

/// Records.
pub fn run(args: &Args, console: &Console) -> Result<()> {
    let settings = Settings {
        side: crate::config::SIDES[0],
        ..Settings::default()
    };
    let mut planes = HeapPlanes::new(settings.side);
    let mut module = session::module(&settings, &mut planes)?;
    let mut bridge = session::bridge(&module, args.port.clone(), args.baud, console)?;
    module.record_into(Recorder::create(&args.out)?);
    let mut progress = console.progress("record", None);
    let served = bridge.serve(&mut module, session::stop()?, |module| {
        session::show(&mut progress, module);
        args.sweeps
            .is_some_and(|n| module.mapper.counters().get(counter::SWEEPS) >= n)
    });
    drop(progress);
    module.finish()?;
    let sweeps = module.mapper.counters().get(counter::SWEEPS);
    let lines = module.traffic.lines;
    let report = serde_json::json!({ "file": args.out, "sweeps": sweeps, "lines": lines });
    console.result(
        &report,
        format_args!("{lines} lines of {sweeps} sweeps in {}", args.out.display()),
    )?;
    served
}
