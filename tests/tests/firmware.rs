//! Recorded and real sweeps through the firmware in the emulator: every bit of its map is
//! that of the host after every sweep. `cargo xtask hil` builds the image and runs these.

use anyhow::{Context, Result};
use rugosa_hil::{Bench, Settings, Summary, image, split};
use rugosa_host::recording::Recording;
use rugosa_tests::real_scan::RealScan;
use rugosa_wire::{Message, Role};
use std::path::PathBuf;
use std::time::Duration;

const LONG: Duration = Duration::from_secs(300);

/// What comes of sending these.
fn through_the_firmware(description: Vec<Message>, messages: Vec<Message>) -> Result<Summary> {
    let settings = Settings {
        image: image("mps2-an386")?,
        ..Settings::default()
    };
    let mut bench = Bench::start(settings, description, messages.into_iter())?;
    bench.connect()?;
    bench.finish(LONG)?;
    let summary = bench.summary();
    assert!(summary.parity.equal, "{summary:#?}");
    assert_eq!((summary.lines.lost, summary.lines.rejected), (0, 0));
    Ok(summary)
}

#[test]
#[ignore = "cargo xtask hil"]
fn recorded_sweeps_are_mapped_bit_for_bit() -> Result<()> {
    let file = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("recordings/perceptron.mcap");
    let entries = Recording::open(&file)?.collect::<Result<Vec<_>, _>>()?;
    let of_scanner = entries.into_iter().filter(|e| e.from == Role::Scanner);
    let (description, messages) = split(of_scanner.map(|entry| entry.frame.message));
    let sweeps = messages
        .iter()
        .filter(|m| matches!(m, Message::SweepEnd(_)));
    let sweeps = sweeps.count() as u32;
    let summary = through_the_firmware(description, messages)?;
    assert!(sweeps > 1, "{sweeps} sweeps");
    assert_eq!(summary.parity.sweeps, sweeps, "{summary:#?}");
    Ok(())
}

/// A forest floor by a lidar of 128 × 1024 beams, twice.
#[test]
#[ignore = "cargo xtask hil"]
fn a_real_scan_is_mapped_bit_for_bit() -> Result<()> {
    let Some(scan) = RealScan::read()? else {
        return Ok(());
    };
    let sweeps = (1..=2).flat_map(|number| scan.sweep(number)).collect();
    let summary = through_the_firmware(scan.description(), sweeps)?;
    assert_eq!(summary.parity.sweeps, 2, "{summary:#?}");
    let used = summary.counters.get("returns.used").context("a counter")?;
    assert!(*used > 20_000, "{summary:#?}");
    Ok(())
}
