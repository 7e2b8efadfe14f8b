//! `rugosa replay FILE`: a recording becomes a map, or is played into a port.

use super::send::{self, PortArgs, Script};
use super::session::{self, MapArgs};
use crate::bridge::Summary;
use crate::console::Console;
use crate::error::{Failure, Result};
use crate::planes::HeapPlanes;
use crate::recording::{Ending, Recording};
use rugosa_hil_sim::stream::Stamped;
use rugosa_wire::{Message, Role, counter};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Map a recording, or play it into a serial port as the scanner did.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  rugosa replay run1.mcap --out map
  rugosa replay run1.mcap --virtual /tmp/scanner --speed 1
  rugosa replay run1.mcap --port /dev/ttyACM0 --speed 0")]
pub struct Args {
    /// A recording (MCAP)
    file: PathBuf,

    #[command(flatten)]
    port: OptionalPort,

    /// With a port: 1 = as recorded, 2 = twice as fast, …; 0 = as fast as the link takes it
    #[arg(long, default_value_t = 1.0)]
    speed: f64,

    #[command(flatten)]
    map: MapArgs,
}

#[derive(Debug, clap::Args)]
struct OptionalPort {
    /// Serial port, real or virtual, to play into
    #[arg(long, conflicts_with = "out")]
    port: Option<PathBuf>,

    /// Make a virtual serial port of this name and play into it
    #[arg(long = "virtual", value_name = "NAME", conflicts_with_all = ["port", "out"])]
    virtual_port: Option<PathBuf>,

    /// Symbols per second (of no effect on USB and virtual ports)
    #[arg(long, default_value_t = super::send::BAUD)]
    baud: u32,
}

/// Maps or plays.
pub fn run(args: &Args, console: &Console) -> Result<()> {
    if args.port.port.is_none() && args.port.virtual_port.is_none() {
        return map(args, console);
    }
    let pace = send::pace(args.speed)?;
    let (description, messages) = read(&args.file, console)?;
    let port = PortArgs::new(
        args.port.port.clone(),
        args.port.virtual_port.clone(),
        args.port.baud,
    );
    let script = Script {
        device: "recording",
        description,
        messages: Box::new(messages.into_iter()),
        pace,
    };
    send::send_all(&port, script, console)
}

/// What the scanner said: its description, and everything else with its time.
fn read(path: &Path, console: &Console) -> Result<(Vec<Message>, Vec<Stamped>)> {
    let (mut description, mut messages) = (Vec::new(), Vec::new());
    let mut recording = Recording::open(path)?;
    for entry in recording.by_ref() {
        let entry = entry?;
        match entry.frame.message {
            _ if entry.from != Role::Scanner => {}
            message @ (Message::Scanner(_) | Message::BeamTable(_)) => description.push(message),
            message @ (Message::Line(_) | Message::Pose(_) | Message::SweepEnd(_)) => messages
                .push(Stamped {
                    stamp_us: entry.time_us,
                    message,
                }),
            _ => {}
        }
    }
    tell_ending(&recording, console);
    let description = without_repeats(description);
    if messages.is_empty() {
        return Err(Failure::file(path, "holds no lines of a scanner"));
    }
    Ok((description, messages))
}

/// A scanner says its description again in every connection.
fn without_repeats(messages: Vec<Message>) -> Vec<Message> {
    messages.into_iter().fold(Vec::new(), |mut kept, message| {
        if !kept.contains(&message) {
            kept.push(message);
        }
        kept
    })
}

fn tell_ending(recording: &Recording, console: &Console) {
    if let Some(Ending::Truncated { length }) = recording.ending() {
        console.note(format_args!(
            "the recording was not completed; all of its first {length} bytes is used"
        ));
    }
}

fn map(args: &Args, console: &Console) -> Result<()> {
    let checked = args.map.check()?;
    let mut planes = HeapPlanes::new(checked.settings.side);
    let mut module = checked.module(&mut planes)?;
    module.new_session();
    let mut recording = Recording::open(&args.file)?;
    let started = Instant::now();
    let stop = session::stop()?;
    let mut progress = console.progress("replay", None);
    for entry in recording.by_ref() {
        let entry = entry?;
        if entry.from == Role::Scanner {
            module.take(&entry.frame.message, entry.time_us);
            session::show(&mut progress, &module);
        }
        if stop.load(std::sync::atomic::Ordering::Relaxed) {
            break;
        }
    }
    drop(progress);
    tell_ending(&recording, console);
    module.close();
    if module.mapper.counters().get(counter::LINES_RECEIVED) == 0 {
        return Err(Failure::file(&args.file, "holds no lines of a scanner"));
    }
    let seconds = started.elapsed().as_secs_f64();
    let summary = Summary::of(
        &module.mapper,
        module.report.as_ref(),
        &module.traffic,
        seconds,
    );
    session::finish(&module.mapper, &summary, checked.outputs.as_ref(), console)
}
