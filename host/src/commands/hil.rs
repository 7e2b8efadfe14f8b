//! `rugosa hil`: the firmware in the emulator, fed by a scanner over a line that may be
//! bad, and compared with the same mapper on this machine.

use super::session;
use crate::bridge::outputs::save_layers;
use crate::config::decimal;
use crate::console::Console;
use crate::error::{Failure, Result};
use crate::io::atomic;
use crate::layers::Layers;
use crate::recording::Recording;
use rugosa_hil::{
    Bench, Extent, Log, Parity, Scene, Schedule, SentMap, Settings, Summary, image, split,
};
use rugosa_hil_sim::faults::Faults;
use rugosa_hil_sim::qemu::Emulator;
use rugosa_wire::{Decoder, Message, Role};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::atomic::Ordering;
use std::time::Duration;

/// Run the firmware in the emulator and compare it with this machine, bit for bit.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  rugosa hil --out hil
  rugosa hil --baud 115200 --faults ber=1e-4,drop=0.001,seed=7
  rugosa hil --sweeps run1.mcap --json
  rugosa hil --baud 115200 --rate 24 --raster 256x256 --count 60

The image is built when it is missing and this is a checkout. QEMU (qemu-system-arm) must
be installed. Ctrl-C ends the run and reports what there is. The exit code is 1 when
module and host differ.")]
pub struct Args {
    /// Sweeps from a recording (.mcap, or link frames as bytes) instead of the simulator
    #[arg(long, value_name = "FILE")]
    sweeps: Option<PathBuf>,

    /// Sweeps of the simulated scanner
    #[arg(long, default_value_t = 4, value_parser = clap::value_parser!(u32).range(1..))]
    count: u32,

    /// Lines and columns of a simulated sweep
    #[arg(long, value_name = "LINESxCOLUMNS", default_value = "64x64", value_parser = raster)]
    raster: (u16, u16),

    /// Faults of the line to the module, NAME=VALUE,…: ber, drop, double (probabilities),
    /// delay and jitter (milliseconds), seed
    #[arg(long, value_name = "LIST", value_parser = faults, default_value = "")]
    faults: Faults,

    /// Baud rate of the scanner's line; without it as fast as the emulator takes it
    #[arg(long, value_parser = clap::value_parser!(u32).range(300..))]
    baud: Option<u32>,

    /// Lines per second of the scanner, which says how late they went out; scanner and line
    /// go by the board's clock then, which is as slow as the computer. Without it as fast as
    /// the module takes them
    #[arg(long, value_name = "LINES", value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    rate: Option<u32>,

    /// Board; mps2-an386 is the one that QEMU emulates
    #[arg(long, default_value = "mps2-an386", value_parser = ["mps2-an386"])]
    board: String,

    /// Image of the firmware instead of the checkout's
    #[arg(long, value_name = "ELF")]
    image: Option<PathBuf>,

    /// Directory for summary.json, device.log and the map that the module has sent
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

/// Runs it.
pub fn run(args: &Args, console: &Console) -> Result<()> {
    let (description, messages) = source(args)?;
    if !Emulator::is_available() {
        return Err(Failure::runtime(
            "qemu-system-arm is not installed (Debian, Ubuntu: apt install qemu-system-arm)",
        ));
    }
    let image = match &args.image {
        Some(image) => {
            Log::of(image).map_err(|error| Failure::input(format_args!("{error:#}")))?;
            image.clone()
        }
        None => built_image(&args.board, console)?,
    };
    let settings = Settings {
        image,
        to_module: Faults {
            baud: args.baud,
            ..args.faults.clone()
        },
        from_module: args.baud.map_or_else(Faults::default, Faults::paced),
        in_board_time: args.rate.is_some(),
    };
    let mut bench = Bench::start(settings, description, messages).map_err(Failure::from)?;
    bench.feeder.schedule = args
        .rate
        .map(|rate| Schedule::new(1_000_000 / u64::from(rate)));
    follow(&mut bench, console)?;
    let summary = bench.summary();
    if let Some(folder) = &args.out {
        write(folder, &bench, &summary)?;
    }
    console.result(&summary, text(&summary))?;
    verdict(&summary.parity)
}

type Messages = Box<dyn Iterator<Item = Message>>;

fn source(args: &Args) -> Result<(Vec<Message>, Messages)> {
    let Some(file) = &args.sweeps else {
        let (lines, columns) = args.raster;
        let scene = Scene {
            lines,
            columns,
            sweeps: args.count,
            speed: 0.5,
            seed: 1,
        };
        let (description, messages) = scene.messages().map_err(Failure::from)?;
        return Ok((description, Box::new(messages)));
    };
    let (description, messages) = split(recorded(file)?);
    if description.is_empty() || messages.is_empty() {
        let message = "holds no frames of a scanner and its lines";
        return Err(Failure::file(file, message));
    }
    Ok((description, Box::new(messages.into_iter())))
}

/// What a scanner sent into this recording.
fn recorded(file: &Path) -> Result<Vec<Message>> {
    if crate::io::extension(file) == "mcap" {
        let entries = Recording::open(file)?.filter(|entry| match entry {
            Ok(entry) => entry.from == Role::Scanner,
            Err(_) => true,
        });
        return entries.map(|e| e.map(|e| e.frame.message)).collect();
    }
    let bytes = std::fs::read(file).map_err(|error| Failure::file(file, error))?;
    let (mut bytes, mut decoder) = (&bytes[..], Decoder::new());
    let frames = std::iter::from_fn(|| decoder.pull(&mut bytes));
    Ok(frames.flatten().map(|frame| frame.message).collect())
}

/// The checkout's image; built when it is missing.
fn built_image(board: &str, console: &Console) -> Result<PathBuf> {
    if let Ok(image) = image(board) {
        return Ok(image);
    }
    console.note(format_args!("building the firmware for {board}"));
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let built = Command::new("cargo")
        .args(["xtask", "firmware", board])
        .current_dir(&root)
        .stdout(Stdio::null())
        .status();
    if !built.is_ok_and(|status| status.success()) {
        return Err(Failure::runtime(
            "there is no image and it cannot be built here; give one with --image",
        ));
    }
    image(board).map_err(Failure::from)
}

/// Runs to the end, or to Ctrl-C, and shows the module's log.
fn follow<M: Iterator<Item = Message>>(bench: &mut Bench<M>, console: &Console) -> Result<()> {
    let stop = session::stop()?;
    let (mut shown, mut progress) = (0, console.progress("hil", None));
    bench.connect().map_err(Failure::from)?;
    while !bench.feeder.is_finished() && !stop.load(Ordering::Relaxed) {
        bench.turn().map_err(Failure::from)?;
        for entry in &bench.entries[shown..] {
            console.note(entry);
        }
        shown = bench.entries.len();
        let (sweeps, lines) = (bench.listener.sweeps(), bench.feeder.lines);
        progress.set(lines, || format!("lines sent, {sweeps} sweeps mapped"));
    }
    drop(progress);
    bench.settle().map_err(Failure::from)
}

fn write<M: Iterator<Item = Message>>(
    folder: &Path,
    bench: &Bench<M>,
    summary: &Summary,
) -> Result<()> {
    atomic::write(&folder.join("summary.json"), |file| {
        serde_json::to_writer_pretty(&mut *file, summary)?;
        writeln!(file)
    })?;
    atomic::write(&folder.join("device.log"), |file| {
        bench
            .entries
            .iter()
            .try_for_each(|entry| writeln!(file, "{entry}"))
    })?;
    if let Some((extent, resolution)) = bench.window() {
        save_layers(folder, &layers(&bench.listener.map, &extent, resolution))?;
    }
    Ok(())
}

/// A map as it was sent.
pub fn layers(map: &SentMap, extent: &Extent, resolution: f32) -> Layers {
    let resolution = decimal(resolution);
    let mut layers = Layers {
        rows: extent.rows,
        columns: extent.columns,
        resolution,
        corner: [extent.origin.x, extent.origin.y].map(|i| f64::from(i) * resolution),
        shift: [0.0; 2],
        layers: Vec::new(),
    };
    for (name, unit, values) in map.layers(extent) {
        layers.add(name, unit, values);
    }
    layers
}

fn text(summary: &Summary) -> String {
    let (lines, parity) = (&summary.lines, &summary.parity);
    let verdict = match parity.equal {
        true => "every bit agrees",
        false => "MODULE AND HOST DIFFER",
    };
    let late = lines.lateness.map_or_else(String::new, |l| {
        let [worst_ms, away_ms] = [l.worst_us, l.away_us].map(|us| us as f64 * 1e-3);
        let late = l.late;
        format!(", {late} late (at most {worst_ms:.1} ms; scanner away {away_ms:.1} ms)")
    });
    let board = summary
        .board_seconds
        .map_or_else(String::new, |s| format!(", {s:.1} s of the board"));
    let costs = summary.instructions.iter();
    let costs: Vec<String> = costs.map(|(name, n)| format!("{name} {n}")).collect();
    format!(
        "lines         {} sent, {} received, {} lost, {} rejected{late}\n\
         compared      {} sweeps and {} values: {verdict}\n\
         instructions  {:.0} per return; last sweep: {}\n\
         memory        stack {} bytes, receive queue at most {} bytes\n\
         restarts      {}\n\
         duration      {:.1} s{board}",
        lines.sent,
        lines.received,
        lines.lost,
        lines.rejected,
        parity.sweeps,
        parity.values,
        summary.instructions_per_return,
        costs.join(", "),
        summary.stack,
        summary.queue,
        summary.restarts,
        summary.seconds
    )
}

fn verdict(parity: &Parity) -> Result<()> {
    if parity.equal {
        return Ok(());
    }
    let what = match parity.differences.as_slice() {
        [] => "no sweep was mapped".to_owned(),
        some => some.join("; "),
    };
    Err(Failure::runtime(format_args!(
        "module and host differ: {what}"
    )))
}

fn raster(text: &str) -> Result<(u16, u16), String> {
    let parts = text.split_once('x');
    let (lines, columns) = parts.ok_or("must read LINESxCOLUMNS, such as 64x64")?;
    let number = |part: &str| match part.parse() {
        Ok(number @ 1..=256) => Ok(number),
        _ => Err(format!("{part:?} is no number from 1 to 256")),
    };
    Ok((number(lines)?, number(columns)?))
}

fn faults(text: &str) -> Result<Faults, String> {
    let mut faults = Faults::default();
    for item in text.split(',').filter(|item| !item.is_empty()) {
        let parts = item.split_once('=');
        let (name, value) = parts.ok_or_else(|| format!("{item} must read NAME=VALUE"))?;
        let number = value.parse::<f64>();
        let number = number.map_err(|_| format!("{item}: {value:?} is no number"))?;
        let most = match name {
            "ber" | "drop" | "double" => 1.0,
            "delay" | "jitter" => 60_000.0,
            _ => f64::from(u32::MAX),
        };
        if !(0.0..=most).contains(&number) {
            return Err(format!("{item}: must lie between 0 and {most}"));
        }
        let time = || Duration::from_secs_f64(number * 1e-3);
        match name {
            "ber" => faults.bit_error_rate = number,
            "drop" => faults.drop_rate = number,
            "double" => faults.duplicate_rate = number,
            "delay" => faults.delay = time(),
            "jitter" => faults.jitter = time(),
            "seed" => faults.seed = number as u64,
            _ => {
                return Err(format!(
                    "{name} is no fault; known are ber, drop, double, delay, jitter, seed"
                ));
            }
        }
    }
    Ok(faults)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faults_are_read_and_checked() {
        let read = faults("ber=1e-4,drop=0.01,delay=3,seed=9").unwrap();
        assert_eq!(
            (read.bit_error_rate, read.drop_rate, read.seed),
            (1e-4, 0.01, 9)
        );
        assert_eq!(read.delay, Duration::from_millis(3));
        for bad in ["ber", "ber=x", "noise=1", "drop=-1", "drop=2", "ber=NaN"] {
            assert!(faults(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn rasters_are_read_and_checked() {
        assert_eq!(raster("32x128"), Ok((32, 128)));
        for bad in ["", "32", "0x4", "4x257", "ax4"] {
            assert!(raster(bad).is_err(), "{bad}");
        }
    }
}
