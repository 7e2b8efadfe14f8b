//! Time of one sweep by effect, against the time of a bare cast of its beams.
//!
//! `cargo run --release -p rugosa-hil-sim --example sweep_cost`

use std::sync::Arc;
use std::time::Instant;

use rugosa_hil_sim::device::Device;
use rugosa_hil_sim::robot::{Path, Robot};
use rugosa_hil_sim::scanner::{Effects, Scanner, Tally};
use rugosa_hil_sim::terrain::{FractalSettings, fractal};

fn main() -> anyhow::Result<()> {
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
            for effects in [Effects::NONE, Effects::ALL] {
                scanner.effects = effects;
                let (start, mut tally) = (Instant::now(), Tally::default());
                scanner.sweep(0).for_each(|line| tally.add(&line.tally));
                let name = scanner.device.name;
                println!(
                    "D {dimension}, {name}: {:.3} s {tally:?}",
                    start.elapsed().as_secs_f64()
                );
            }
        }
    }
    Ok(())
}
