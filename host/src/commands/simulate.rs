//! `rugosa simulate`: a simulated scanner on a serial port.

use super::send::{self, PortArgs, Script};
use super::simulation::SimulationArgs;
use crate::console::Console;
use crate::error::Result;

/// Messages that are made ahead of time.
const AHEAD: usize = 2048;

/// Play a simulated scanner on a robot into a serial port.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  rugosa simulate --virtual /tmp/scanner &
  rugosa scan --port /tmp/scanner --out map

  rugosa simulate --port /dev/ttyUSB0 --device lidar --dimension 2.6 --sigma 0.05")]
pub struct Args {
    #[command(flatten)]
    port: PortArgs,

    #[command(flatten)]
    simulation: SimulationArgs,

    /// End after this many sweeps
    #[arg(long)]
    sweeps: Option<u32>,

    /// 1 = real time, 2 = twice as fast, …; 0 = as fast as the link takes it
    #[arg(long, default_value_t = 1.0)]
    speed: f64,
}

/// Sends the simulation.
pub fn run(args: &Args, console: &Console) -> Result<()> {
    let pace = send::pace(args.speed)?;
    let (simulation, _) = args.simulation.make(args.sweeps)?;
    let script = Script {
        device: simulation.scanner.device.name,
        description: simulation.description(),
        messages: Box::new(simulation.messages_ahead(AHEAD)),
        pace,
    };
    send::send_all(&args.port, script, console)
}
