//! `rugosa synthesize`: a fractional Brownian surface.

use crate::console::Console;
use crate::draw::{self, Layer};
use crate::error::{Failure, Result};
use crate::io::output::{Output, write_raster};
use crate::io::{Raster, extension};
use rand_core::SeedableRng;
use rand_xoshiro::Xoshiro128PlusPlus;
use rugosa_fractal::pyramid::{Levels, MAX_SIDE, MIN_SIDE, Posterior};
use rugosa_fractal::synthesis;
use serde::Serialize;
use std::fmt;
use std::path::PathBuf;
use std::time::Instant;

/// A fractional Brownian surface of a given dimension.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  rugosa synthesize --size 257 --dimension 2.3 --out surface.npy
  rugosa synthesize --size 512 --hurst 0.5 --resolution 0.1 --sigma 0.2 --method exact --out s.png")]
pub struct Args {
    /// Nodes per edge
    #[arg(long, default_value_t = 257)]
    size: usize,

    /// Fractal dimension, between 2 and 3
    #[arg(long, short = 'D', conflicts_with = "hurst")]
    dimension: Option<f64>,

    /// Hurst exponent, between 0 and 1
    #[arg(long)]
    hurst: Option<f64>,

    /// Standard deviation of elevation differences at 1 m [m]
    #[arg(long, default_value_t = 1.0)]
    sigma: f64,

    /// Distance between nodes [m]
    #[arg(long, default_value_t = 1.0)]
    resolution: f64,

    /// Seed
    #[arg(long, default_value_t = 1)]
    seed: u64,

    /// How
    #[arg(long, value_enum, default_value_t = Method::Pyramid)]
    method: Method,

    /// Result: .npy, .asc or .png
    #[arg(long)]
    out: PathBuf,
}

#[derive(Clone, Copy, Debug, Serialize, clap::ValueEnum)]
#[serde(rename_all = "lowercase")]
enum Method {
    /// the calibrated pyramid: within 3 % of the power law
    Pyramid,
    /// classic successive random addition
    Sra,
    /// exact, by intrinsic embedding
    Exact,
}

#[derive(Serialize)]
struct Report {
    hurst: f64,
    dimension: f64,
    sigma: f64,
    size: usize,
    resolution_m: f64,
    seed: u64,
    method: Method,
    file: PathBuf,
    seconds: f64,
}

/// Draws and writes it.
pub fn run(args: &Args, console: &Console) -> Result<()> {
    let output = Output::of(&args.out);
    output.check(&["npy", "asc", "png"])?;
    let hurst = checked(args)?;
    let start = Instant::now();
    let mut waiting = console.progress("synthesize", None);
    waiting.set(0, || "drawing");
    let per_cell = args.sigma * args.resolution.powf(hurst);
    let values = draw_surface(args, hurst as f32, per_cell as f32)?;
    drop(waiting);
    let seconds = start.elapsed().as_secs_f64();
    let raster = Raster::square(args.size, args.size, args.resolution, [0.0; 2], values);
    let file = output.file("surface.npy");
    if extension(&file) == "png" {
        draw::maps(&[Layer::elevation("surface", &raster)])?.save(&file)?;
    } else {
        write_raster(&file, &raster)?;
    }
    let report = Report {
        hurst,
        dimension: 3.0 - hurst,
        sigma: args.sigma,
        size: args.size,
        resolution_m: args.resolution,
        seed: args.seed,
        method: args.method,
        file,
        seconds,
    };
    console.result(&report, &report)
}

/// The Hurst exponent, when everything else is in order.
fn checked(args: &Args) -> Result<f64> {
    let hurst = match (args.hurst, args.dimension) {
        (Some(hurst), _) => hurst,
        (None, Some(dimension)) => 3.0 - dimension,
        (None, None) => return Err(Failure::input("give --dimension or --hurst")),
    };
    let positive = |v: f64| v > 0.0 && v.is_finite();
    if !(hurst > 0.0 && hurst < 1.0) {
        return Err(Failure::input(
            "--hurst is not between 0 and 1 (--dimension 2 and 3)",
        ));
    }
    if !(positive(args.sigma) && positive(args.resolution)) {
        return Err(Failure::input("--sigma and --resolution must be positive"));
    }
    if !(2..=MAX_SIDE).contains(&args.size) {
        return Err(Failure::input(format_args!(
            "--size must be 2 to {MAX_SIDE}"
        )));
    }
    Ok(hurst)
}

/// size² heights; what needs 2^k + 1 nodes is cut out of the next such square.
fn draw_surface(args: &Args, hurst: f32, per_cell: f32) -> Result<Vec<f32>> {
    let side = ((args.size - 1).next_power_of_two() + 1).max(MIN_SIDE);
    let mut rng = Xoshiro128PlusPlus::seed_from_u64(args.seed);
    let mut square = vec![0.0; side * side];
    match args.method {
        Method::Exact => {
            let surface = synthesis::exact_fbm(args.size, f64::from(hurst), args.seed);
            return Ok(surface.into_iter().map(|z| z * per_cell).collect());
        }
        Method::Pyramid => {
            let levels = Levels::power_law(side, hurst, per_cell).map_err(Failure::input)?;
            let mut memory = vec![0.0; Posterior::need(side).map_err(Failure::input)?];
            synthesis::pyramid((side, &levels), &mut rng, &mut memory, &mut square)
                .map_err(Failure::input)?;
        }
        Method::Sra => {
            synthesis::classic(side, hurst, &mut rng, &mut square).map_err(Failure::input)?;
            square.iter_mut().for_each(|z| *z *= per_cell);
        }
    }
    let rows = square.chunks_exact(side).take(args.size);
    Ok(rows.flat_map(|row| &row[..args.size]).copied().collect())
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{0} × {0} nodes, D {1:.3}, sigma {2} m at 1 m: {3}",
            self.size,
            self.dimension,
            self.sigma,
            self.file.display()
        )
    }
}
