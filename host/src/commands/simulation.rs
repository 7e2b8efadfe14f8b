//! What `simulate` and `demo` share: the terrain, the scanner, the robot.

use crate::bridge::Truth;
use crate::error::{Failure, Result};
use crate::io::{self, Spacing};
use clap::ValueEnum;
use rugosa_hil_sim::device::Device;
use rugosa_hil_sim::robot::{Path, Robot};
use rugosa_hil_sim::scanner::Scanner;
use rugosa_hil_sim::stream::Simulation;
use rugosa_hil_sim::terrain::{FractalSettings, fractal};
use rugosa_hil_sim::terrain::{Plane, Raster, Terrain, egg_carton};
use std::path::PathBuf;
use std::sync::Arc;

/// What the robot walks on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Ground {
    /// exact fractional Brownian surface of given D and σ
    Fractal,
    /// smooth waves, 0.2 m high, 2 m long
    Waves,
    /// a level plane
    Plane,
}

/// Which scanner.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Model {
    /// two mirrors, 60° × 60°, 256 × 256, 2 sweeps a second, 12 bits, 2.2 m up
    Perceptron,
    /// spinning, 360°, 64 × 1024, 10 sweeps a second, 16 bits, 0.8 m up
    Lidar,
}

/// Options of the simulation.
#[derive(Debug, clap::Args)]
pub struct SimulationArgs {
    /// What the robot walks on
    #[arg(long, value_enum, default_value_t = Ground::Fractal)]
    terrain: Ground,

    /// A raster to walk on instead (.asc, or .npy with --spacing)
    #[arg(long, value_name = "FILE")]
    dem: Option<PathBuf>,

    /// Distance between the nodes of --dem where it is a .npy [m]
    #[arg(long)]
    spacing: Option<Spacing>,

    /// Fractal dimension of the terrain
    #[arg(long, default_value_t = 2.3)]
    dimension: f64,

    /// Rms elevation difference at 1 m [m]
    #[arg(long, default_value_t = 0.08)]
    sigma: f64,

    /// Which scanner
    #[arg(long, value_enum, default_value_t = Model::Perceptron)]
    device: Model,

    /// Speed of the robot [m/s]
    #[arg(long, default_value_t = 0.5)]
    walk: f64,

    /// Decides terrain, noise and drop-outs
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

impl SimulationArgs {
    /// The simulation, and the truth about the terrain where it has one.
    pub fn make(&self, sweeps: Option<u32>) -> Result<(Simulation, Option<Truth>)> {
        if !self.walk.is_finite() {
            return Err(Failure::input("--walk: not a finite speed"));
        }
        let (terrain, truth) = self.terrain()?;
        let device = match self.device {
            Model::Perceptron => Device::perceptron(),
            Model::Lidar => Device::lidar(),
        };
        let path = Path::Straight {
            from: [-5.0, 0.0],
            heading: 0.0,
            speed: self.walk,
        };
        let robot = Robot::new(terrain, path);
        let mut simulation = Simulation::new(Scanner::new(device, robot, self.seed));
        simulation.sweeps = sweeps;
        Ok((simulation, truth))
    }

    fn terrain(&self) -> Result<(Arc<dyn Terrain>, Option<Truth>)> {
        if let Some(path) = &self.dem {
            return Ok((Arc::new(dem(path, self.spacing)?), None));
        }
        Ok(match self.terrain {
            Ground::Plane => (Arc::new(Plane::FLAT), None),
            Ground::Waves => (Arc::new(egg_carton(0.2, 2.0)), None),
            Ground::Fractal => {
                let settings = FractalSettings {
                    dimension: self.dimension,
                    sigma: self.sigma,
                    seed: self.seed,
                    ..FractalSettings::default()
                };
                let truth = Truth {
                    dimension: self.dimension,
                    sigma: self.sigma,
                };
                (
                    Arc::new(fractal(settings).map_err(Failure::input)?),
                    Some(truth),
                )
            }
        })
    }
}

/// A raster without holes, its middle over the origin and its mean at 0.
fn dem(path: &std::path::Path, spacing: Option<Spacing>) -> Result<Raster> {
    let mut raster = io::read_raster(path, spacing)?;
    if raster.known() < raster.values.len() {
        return Err(Failure::file(
            path,
            "has unknown nodes; a terrain to walk on must not",
        ));
    }
    if (raster.spacing_x - raster.spacing_y).abs() > 1e-6 * raster.spacing_x {
        return Err(Failure::file(
            path,
            "a terrain to walk on needs equal spacings in x and y",
        ));
    }
    let mean =
        raster.values.iter().map(|&v| f64::from(v)).sum::<f64>() / raster.values.len() as f64;
    raster.values.iter_mut().for_each(|v| *v -= mean as f32);
    let terrain = Raster::new(
        raster.values,
        raster.columns,
        raster.spacing_x,
        raster.origin,
    );
    Ok(terrain
        .map_err(|e| Failure::file(path, e))?
        .centred_on(0.0, 0.0))
}
