//! Processor time of one sweep, bare and with all effects.
//!
//! `cargo run --release -p rugosa-hil-sim --example sweep_cost`

use std::sync::Arc;

use anyhow::{Context, Result};
use rugosa_hil_sim::device::Device;
use rugosa_hil_sim::robot::{Path, Robot};
use rugosa_hil_sim::scanner::{Effects, Scanner, Tally};
use rugosa_hil_sim::terrain::{FractalSettings, fractal};

/// Seconds that this thread has run.
fn processor_time() -> Result<f64> {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat")?;
    let nanos: u64 = text.split(' ').next().context("empty schedstat")?.parse()?;
    Ok(nanos as f64 * 1e-9)
}

fn main() -> Result<()> {
    for dimension in [2.2, 2.5, 2.8] {
        let terrain = Arc::new(fractal(FractalSettings {
            dimension,
            ..FractalSettings::default()
        })?);
        let path = Path::Straight {
            from: [-5.0, 0.0],
            heading: 0.0,
            speed: 0.5,
        };
        for device in [Device::perceptron(), Device::lidar()] {
            let robot = Robot::new(terrain.clone(), path.clone());
            let mut scanner = Scanner::new(device, robot, 1);
            let mut seconds = Vec::new();
            let mut tally = Tally::default();
            for effects in [Effects::NONE, Effects::ALL] {
                scanner.effects = effects;
                let start = processor_time()?;
                tally = Tally::default();
                scanner.sweep(0).for_each(|line| tally.add(&line.tally));
                seconds.push(processor_time()? - start);
            }
            let (name, returns) = (scanner.device.name, tally.returns);
            println!(
                "D {dimension}, {name}: {returns} returns, {} mixed; {:.0} ms bare, {:.0} ms with all effects",
                tally.mixed,
                seconds[0] * 1e3,
                seconds[1] * 1e3,
            );
        }
    }
    Ok(())
}
