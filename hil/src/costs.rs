//! What the stages cost on the target: recorded frames through the image `costs`.

use crate::log::{Entry, Log};
use anyhow::{Context, Result, bail};
use rugosa::{Config, Mapper, Planes65, Solver65};
use rugosa_wire::{Decoder, Header, MAX_FRAME, Message, counter, encode};
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// One sweep on the target. All costs are instructions.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SweepCost {
    /// complete sweeps
    pub sweep: u32,
    /// returns since the start
    pub returns: u32,
    /// bytes to messages
    pub receive: u32,
    /// lines to cells
    pub lines: u32,
    /// new samples into the pair counters
    pub counters: u32,
    /// counters to roughness
    pub roughness: u32,
    /// iterations of the reconstruction
    pub reconstruction: u32,
    /// roughness and mean to costs
    pub traversability: u32,
    /// digest of the map
    pub digest: u32,
    /// deepest use of the stack, bytes
    pub stack: u32,
}

/// The frames of these messages, as a recording of the link holds them.
pub fn frames(messages: impl IntoIterator<Item = Message>) -> Vec<u8> {
    let (mut bytes, mut buffer) = (Vec::new(), [0; MAX_FRAME]);
    for (i, message) in messages.into_iter().enumerate() {
        let header = Header {
            session: 1 << 31,
            sequence: i as u16,
        };
        let length = encode(&header, &message, &mut buffer).unwrap_or(0);
        bytes.extend(&buffer[..length]);
    }
    bytes
}

/// Runs an image beside a file `frames.bin` to its end and returns what it logged.
pub fn logged(image: &Path, frames: &[u8]) -> Result<Vec<Entry>> {
    let folder = tempfile::tempdir()?;
    std::fs::write(folder.path().join("frames.bin"), frames)?;
    let output = emulate(image, folder.path())?;
    Ok(Log::of(image)?.take(&output))
}

/// Maps `frames` on the target.
pub fn on_target(image: &Path, frames: &[u8]) -> Result<Vec<SweepCost>> {
    let entries = logged(image, frames)?;
    let sweeps = entries.iter().map(|entry| parse(&entry.text)).collect();
    Option::context(
        sweeps,
        format!("the log of {} reads {entries:?}", image.display()),
    )
}

/// What the parts of a reconstruction cost on the target, in instructions.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SolverCost {
    /// taking the data in
    pub observe: u32,
    /// one iteration
    pub iteration: u32,
    /// the mean
    pub mean: u32,
    /// residual after ten iterations, in parts per million of the first
    pub ppm: u32,
}

/// Runs the image `solver`.
pub fn of_solver(image: &Path) -> Result<SolverCost> {
    let entries = logged(image, &[])?;
    let found = entries.iter().find_map(|entry| {
        let value = |name| value(&entry.text, name);
        Some(SolverCost {
            observe: value("observe")?,
            iteration: value("iteration")?,
            mean: value("mean")?,
            ppm: value("ppm")?,
        })
    });
    found.with_context(|| format!("the log of {} reads {entries:?}", image.display()))
}

/// Maps `frames` here; the digest after each sweep.
pub fn on_host(mut frames: &[u8]) -> Vec<u32> {
    let (mut planes, mut solver) = (Box::new(Planes65::new()), Box::new(Solver65::new()));
    let Ok(mut mapper) = Mapper::new(Config::default(), planes.lend_with(&mut solver)) else {
        return Vec::new();
    };
    let (mut decoder, mut digests) = (Decoder::new(), Vec::new());
    while let Some(frame) = decoder.pull(&mut frames) {
        let ended = frame.is_ok_and(|frame| mapper.message(&frame.message).is_some());
        if ended {
            digests.push(mapper.digest());
        }
    }
    debug_assert_eq!(mapper.counters().get(counter::SWEEPS), digests.len() as u32);
    digests
}

/// Runs an image in `folder` to its end and returns what it logged.
fn emulate(image: &Path, folder: &Path) -> Result<Vec<u8>> {
    let arguments = "-M mps2-an386 -nodefaults -nic none -monitor none -display none \
        -semihosting-config enable=on,target=native,chardev=log \
        -chardev stdio,id=log,signal=off -icount shift=3 -kernel";
    let mut child = Command::new("qemu-system-arm")
        .args(arguments.split_whitespace())
        .arg(image.canonicalize()?)
        .current_dir(folder)
        .stdin(Stdio::null())
        .stdout(std::fs::File::create(folder.join("log"))?)
        .stderr(Stdio::null())
        .spawn()
        .context("cannot start qemu-system-arm")?;
    let end = Instant::now() + Duration::from_secs(300);
    let status = loop {
        if let Some(status) = child.try_wait()? {
            break status;
        }
        if Instant::now() > end {
            child.kill()?;
        }
        std::thread::sleep(Duration::from_millis(20));
    };
    if !status.success() {
        bail!("{} ended with {status}", image.display());
    }
    Ok(std::fs::read(folder.join("log"))?)
}

/// The number behind a word: `sweep 1 returns 65536 receive …`
fn value(text: &str, name: &str) -> Option<u32> {
    let mut words = text.split(' ').skip_while(|&word| word != name);
    words.nth(1)?.parse().ok()
}

fn parse(text: &str) -> Option<SweepCost> {
    let value = |name| value(text, name);
    Some(SweepCost {
        sweep: value("sweep")?,
        returns: value("returns")?,
        receive: value("receive")?,
        lines: value("lines")?,
        counters: value("counters")?,
        roughness: value("roughness")?,
        reconstruction: value("reconstruction")?,
        traversability: value("traversability")?,
        digest: value("digest")?,
        stack: value("stack")?,
    })
}
