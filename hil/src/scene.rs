//! What the simulated scanner sees: a robot that walks over fractal ground.

use anyhow::Result;
use rugosa_hil_sim::device::Device;
use rugosa_hil_sim::robot::{Path, Robot};
use rugosa_hil_sim::scanner::Scanner;
use rugosa_hil_sim::stream::Simulation;
use rugosa_hil_sim::terrain::{FractalSettings, fractal};
use rugosa_wire::Message;
use std::sync::Arc;

/// A scene, repeatable by its seed.
#[derive(Clone, Copy, Debug)]
pub struct Scene {
    /// lines of a sweep
    pub lines: u16,
    /// columns of a line
    pub columns: u16,
    /// how many sweeps
    pub sweeps: u32,
    /// speed of the robot \[m/s\]
    pub speed: f64,
    /// decides terrain, noise and everything else
    pub seed: u64,
}

impl Scene {
    /// The messages that describe the scanner, and those of all sweeps.
    pub fn messages(&self) -> Result<(Vec<Message>, impl Iterator<Item = Message> + use<>)> {
        let terrain = fractal(FractalSettings {
            side: 513,
            spacing: 0.04,
            seed: self.seed,
            ..FractalSettings::default()
        })?;
        let path = Path::Straight {
            from: [-2.0, 0.0],
            heading: 0.0,
            speed: self.speed,
        };
        let robot = Robot::new(Arc::new(terrain), path);
        let mut device = Device::perceptron().thinned(self.lines, self.columns);
        device.set_mount([0.0, 0.0, 2.2], 55.0);
        let simulation = Simulation {
            sweeps: Some(self.sweeps),
            reflectances: false,
            pose_period_us: 20_000,
            ..Simulation::new(Scanner::new(device, robot, self.seed))
        };
        let messages = simulation.messages().map(|stamped| stamped.message);
        Ok((simulation.description(), messages))
    }
}
