//! `rugosa demo`: scanner → virtual serial cable → bridge → maps, nothing else needed.

use super::send::{self, Place, Script};
use super::session::{self, Live, MapArgs};
use super::simulation::SimulationArgs;
use crate::bridge::{Module, Summary};
use crate::console::Console;
use crate::error::{Failure, Result};
use crate::link::PortName;
use crate::planes::HeapPlanes;
use crate::recording::Recorder;
use crate::view::live::LOOPBACK;
use rugosa_hil_sim::faults::Faults;
use rugosa_hil_sim::port::{Cable, CableSettings, End};
use rugosa_hil_sim::transmit::Sent;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Messages that are made ahead of time.
const AHEAD: usize = 2048;
/// When the sender is done and nothing has come for so long, nothing will.
const QUIET: Duration = Duration::from_millis(400);

/// Run everything on this machine: a simulated scanner on a robot streams sweeps over a
/// virtual serial cable into the bridge, and maps come out.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  rugosa demo
  rugosa demo --dimension 2.6 --sigma 0.05 --sweeps 30 --out rough
  rugosa demo --device lidar --speed 1 --record demo.mcap
  rugosa demo --speed 1 --live --report
  rugosa demo --bit-error-rate 1e-6 --json")]
pub struct Args {
    #[command(flatten)]
    simulation: SimulationArgs,

    /// How many sweeps
    #[arg(long, default_value_t = 16)]
    sweeps: u32,

    /// 1 = real time, 2 = twice as fast, …; 0 = as fast as the link takes it
    #[arg(long, default_value_t = 0.0)]
    speed: f64,

    /// Probability that a bit is inverted on the cable
    #[arg(long, default_value_t = 0.0, value_name = "P")]
    bit_error_rate: f64,

    /// Record everything that comes into this MCAP file
    #[arg(long, value_name = "FILE")]
    record: Option<PathBuf>,

    /// Show the map in a browser as it grows (with --speed 1, say)
    #[arg(long, value_name = "ADDRESS", num_args = 0..=1, default_missing_value = LOOPBACK)]
    live: Option<SocketAddr>,

    #[command(flatten)]
    map: MapArgs,
}

/// Runs the demo.
pub fn run(args: &Args, console: &Console) -> Result<()> {
    if !(0.0..=0.1).contains(&args.bit_error_rate) {
        return Err(Failure::input("--bit-error-rate: 0 … 0.1 is possible"));
    }
    let pace = send::pace(args.speed)?;
    let map = MapArgs {
        out: Some(args.map.out.clone().unwrap_or_else(|| "out/demo".into())),
        ..args.map.clone()
    };
    let mut checked = map.check_with(true)?;
    let live = args
        .live
        .map(|address| Live::start(address, console))
        .transpose()?;
    let stop = session::stop()?;
    let (simulation, truth) = args.simulation.make(Some(args.sweeps))?;
    if let Some(outputs) = &mut checked.outputs {
        outputs.original = Some(simulation.scanner.robot.terrain.clone());
    }
    let mut planes = HeapPlanes::new(checked.settings.side);
    let mut module = checked.module(&mut planes)?;
    if let Some(path) = &args.record {
        module.record_into(Recorder::create(path)?);
    }

    let started = Instant::now();
    let cable = cable(args.bit_error_rate, args.sweeps)?;
    let script = Script {
        device: simulation.scanner.device.name,
        description: simulation.description(),
        messages: Box::new(simulation.messages_ahead(AHEAD)),
        pace,
    };
    let sent = bridge(&cable, script, stop, &mut module, (console, live));
    module.close();
    module.finish()?;
    let sent = sent?;
    let seconds = started.elapsed().as_secs_f64();
    let mut summary = Summary::of(
        &module.mapper,
        module.report.as_ref(),
        &module.traffic,
        seconds,
    );
    summary.truth = truth;
    summary.sent(sent.lines);
    session::finish(&module.mapper, &summary, checked.outputs.as_ref(), console)
}

/// A cable whose way from scanner to bridge errs.
fn cable(bit_error_rate: f64, seed: u32) -> Result<Cable> {
    let a_to_b = Faults {
        bit_error_rate,
        seed: seed.into(),
        ..Faults::default()
    };
    let settings = CableSettings {
        a_to_b,
        ..CableSettings::default()
    };
    Cable::with(settings).map_err(|e| Failure::runtime(format_args!("{e:#}")))
}

/// Sends at one end on a thread of its own and maps at the other until all has come.
/// Ctrl-C (`stop`) ends the sender; what is on the cable still arrives.
fn bridge(
    cable: &Cable,
    script: Script,
    stop: &AtomicBool,
    module: &mut Module,
    (console, mut live): (&Console, Option<Live>),
) -> Result<Sent> {
    let started = Instant::now();
    let (near, far) = (cable.path(End::A), cable.path(End::B));
    let far = PortName::Path(far.to_string_lossy().into_owned());
    let mut bridge = session::bridge(module, far, send::BAUD, console)?;
    let mut progress = console.progress("demo", None);
    std::thread::scope(|scope| {
        let sender = scope.spawn(|| Place::at(near).send(script, stop, |_| {}));
        let (mut lines, mut quiet) = (0, Instant::now());
        let never = AtomicBool::new(false);
        let served = bridge.serve(module, &never, |module| {
            session::show(&mut progress, module);
            let shown = live.as_mut().map(|live| live.show(module, started));
            if let Some(Err(failure)) = shown {
                console.note(failure);
                live = None;
            }
            if module.traffic.lines != lines || !sender.is_finished() {
                (lines, quiet) = (module.traffic.lines, Instant::now());
            }
            quiet.elapsed() > QUIET
        });
        if served.is_err() {
            stop.store(true, Ordering::Relaxed); // nobody listens to the sender any more
        }
        let sent = sender.join();
        served?;
        sent.map_err(|_| Failure::runtime("the simulated scanner failed"))?
    })
}
