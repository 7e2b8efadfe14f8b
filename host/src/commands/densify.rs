//! `rugosa densify`: a denser map with the roughness of the ground, by midpoint interpolation.

use super::compress::{factor, read_grid, write_grid};
use crate::console::Console;
use crate::error::{Failure, Result};
use crate::io::{Raster, Spacing};
use clap::ValueEnum;
use rand_xoshiro::Xoshiro128PlusPlus;
use rand_xoshiro::rand_core::SeedableRng;
use rugosa_fractal::surfaces::Shape;
use rugosa_fractal::surfaces::midpoint::{
    self as midpoint, Blend, Cache, Calibration, Counts, Midpoint, Roughness,
};
use rugosa_fractal::synthesis::normal;
use serde_json::{Value, json};
use std::path::PathBuf;
use std::time::Instant;

/// Double the resolution of a raster, once or more, with natural roughness.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Measured nodes keep their heights to the last bit; unknown ones stay unknown.
The mean (--noise none) has the least error; noise gives the right roughness instead.

Examples:
  rugosa densify dem.asc --levels 2 --noise calibrated --out dense.asc
  rugosa densify map.npy --spacing 0.1 --levels 1 --noise fbm --hurst 0.6 --sigma 0.05 --out d.npy")]
pub struct Args {
    /// Raster: .asc or 2-D .npy
    file: PathBuf,
    /// Doublings of the resolution
    #[arg(long, value_name = "L", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=10))]
    levels: u32,
    /// What is added to the interpolated heights
    #[arg(long, value_enum, default_value_t = Noise::Calibrated)]
    noise: Noise,
    /// How midpoints are interpolated
    #[arg(long, value_enum, default_value_t = Stencil::Kriged)]
    stencil: Stencil,
    /// Hurst exponent; estimated from the raster if absent
    #[arg(long, value_name = "H", allow_negative_numbers = true)]
    hurst: Option<f32>,
    /// Standard deviation of an elevation difference at 1 m [m]; estimated if absent
    #[arg(long, value_name = "SIGMA", allow_negative_numbers = true)]
    sigma: Option<f32>,
    /// Local Hurst exponents: a raster over the same ground, any size
    #[arg(long, value_name = "FILE", requires = "sigma_map")]
    hurst_map: Option<PathBuf>,
    /// Local standard deviations at 1 m [m], same size as the exponents
    #[arg(long, value_name = "FILE", requires = "hurst_map")]
    sigma_map: Option<PathBuf>,
    /// Distance between nodes of a .npy [m]
    #[arg(long, value_name = "DX[,DY]")]
    spacing: Option<Spacing>,
    /// Seed of the noise
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Raster to write: .npy or .asc
    #[arg(long, value_name = "G")]
    out: PathBuf,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum Noise {
    /// residuals of fractional Brownian terrain of (H, sigma)
    Fbm,
    /// residuals as measured on the raster, extrapolated to the new scale
    Calibrated,
    /// none: the kriged mean
    None,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum Stencil {
    /// 16 neighbours, kriged
    Kriged,
    /// four neighbours with their right variance
    Four,
    /// four neighbours with the variances of Fang et al. 2004, Euclidean distance
    Fang2004,
    /// the same, chessboard distance
    Fang2004Chessboard,
    /// the same, street distance
    Fang2004Street,
}

impl Stencil {
    fn of_library(self) -> midpoint::Stencil {
        use midpoint::{Distance, Stencil as Library};
        match self {
            Stencil::Kriged => Library::Kriged16,
            Stencil::Four => Library::Four,
            Stencil::Fang2004 => Library::Fang2004(Distance::Euclidean),
            Stencil::Fang2004Chessboard => Library::Fang2004(Distance::Chessboard),
            Stencil::Fang2004Street => Library::Fang2004(Distance::Street),
        }
    }
}

/// Most nodes of a result.
const MOST_NODES: usize = 1 << 28;
/// Solved weights that are kept.
const CACHE: usize = 4096;

/// Densifies a raster.
pub fn run(args: &Args, console: &Console) -> Result<()> {
    let started = Instant::now();
    if args.hurst.is_some_and(|h| !(h > 0.0 && h < 1.0)) {
        return Err(Failure::input("--hurst must lie in (0, 1)"));
    }
    if args.sigma.is_some_and(|s| !(s >= 0.0 && s.is_finite())) {
        return Err(Failure::input("--sigma must be 0 or more"));
    }
    let coarse = read_grid(&args.file, args.spacing)?;
    let shape = Shape::new(coarse.rows, coarse.columns).finer(1 << args.levels);
    if shape.len() > MOST_NODES {
        return Err(Failure::input(format_args!(
            "{} levels make {} × {} nodes; at most 2^28 are possible",
            args.levels, shape.rows, shape.columns
        )));
    }
    let constant = roughness(args, &coarse)?;
    let maps = Maps::read(args)?;
    let noise = noise(args, &coarse, constant)?;
    let local = |row: usize, column: usize| match &maps {
        Some(maps) => maps.at(shape, row, column),
        None => constant,
    };
    let settings = Midpoint {
        stencil: args.stencil.of_library(),
        noise,
        roughness: &local,
        resolution: (mean_spacing(&coarse) / f64::from(1u32 << args.levels)) as f32,
    };
    let (values, counts) = densify(&settings, &coarse, args, console)?;
    let fine = finer(&coarse, shape, values, args.levels);
    write_grid(&args.out, &fine)?;
    report(args, console, (&fine, constant, noise), (counts, started))
}

/// Level by level, so that there is progress to show.
fn densify(
    settings: &Midpoint,
    coarse: &Raster,
    args: &Args,
    console: &Console,
) -> Result<(Vec<f32>, Counts)> {
    let mut rng = Xoshiro128PlusPlus::seed_from_u64(args.seed);
    let mut draw = || normal(&mut rng);
    let mut cache = vec![Blend::default(); CACHE];
    let step = 1usize << args.levels;
    let shape = Shape::new(coarse.rows, coarse.columns).finer(step);
    let mut grid = vec![f32::NAN; shape.len()];
    for (i, &z) in coarse.values.iter().enumerate() {
        let (row, column) = (i / coarse.columns, i % coarse.columns);
        grid[row * step * shape.columns + column * step] = z;
    }
    let _progress = console.progress("densifying", None);
    let counts = settings
        .densify(&mut grid, shape, args.levels, (&mut draw, &mut cache))
        .map_err(|e| Failure::file(&args.file, e))?;
    Ok((grid, counts))
}

fn finer(coarse: &Raster, shape: Shape, values: Vec<f32>, levels: u32) -> Raster {
    let step = f64::from(1u32 << levels);
    Raster {
        rows: shape.rows,
        columns: shape.columns,
        spacing_x: coarse.spacing_x / step,
        spacing_y: coarse.spacing_y / step,
        origin: coarse.origin,
        values,
    }
}

fn mean_spacing(raster: &Raster) -> f64 {
    (raster.spacing_x * raster.spacing_y).sqrt()
}

/// (H, σ): what was given, and for the rest an estimate from the raster.
fn roughness(args: &Args, raster: &Raster) -> Result<Roughness> {
    if let (Some(hurst), Some(sigma)) = (args.hurst, args.sigma) {
        return Ok(Roughness { hurst, sigma });
    }
    let estimated = estimate(raster);
    let needed = matches!(args.noise, Noise::Fbm) && args.hurst_map.is_none();
    match estimated {
        Some(found) => Ok(Roughness {
            hurst: args.hurst.unwrap_or(found.hurst),
            sigma: args.sigma.unwrap_or(found.sigma),
        }),
        None if needed => Err(Failure::file(
            &args.file,
            "too small or too flat to estimate its roughness: give --hurst and --sigma",
        )),
        // only the weights need an exponent, and hardly depend on it
        None => Ok(Roughness {
            hurst: args.hurst.unwrap_or(0.8),
            sigma: args.sigma.unwrap_or(0.0),
        }),
    }
}

/// Least squares of ln E|Δz| against ln d over lags 1 … 8 (Yokoya), H kept in 0.05 … 0.95.
fn estimate(raster: &Raster) -> Option<Roughness> {
    let points: Vec<(f64, f64)> = (1..=8)
        .filter_map(|lag| {
            let mean = mean_increment(raster, lag)?;
            Some(((lag as f64 * mean_spacing(raster)).ln(), mean.ln()))
        })
        .collect();
    if points.len() < 3 {
        return None;
    }
    let n = points.len() as f64;
    let (mx, my) = points
        .iter()
        .fold((0.0, 0.0), |m, p| (m.0 + p.0 / n, m.1 + p.1 / n));
    let slope = points.iter().map(|p| (p.0 - mx) * (p.1 - my)).sum::<f64>()
        / points.iter().map(|p| (p.0 - mx).powi(2)).sum::<f64>();
    let hurst = slope.clamp(0.05, 0.95);
    let sigma = (my - hurst * mx).exp() * (std::f64::consts::PI / 2.0).sqrt();
    Some(Roughness {
        hurst: hurst as f32,
        sigma: sigma as f32,
    })
}

fn mean_increment(raster: &Raster, lag: usize) -> Option<f64> {
    let (mut sum, mut count) = (0.0, 0u32);
    for row in 0..raster.rows {
        for column in 0..raster.columns {
            for (r, c) in [(row + lag, column), (row, column + lag)] {
                if r < raster.rows && c < raster.columns {
                    let d = f64::from((raster.at(row, column) - raster.at(r, c)).abs());
                    if d.is_finite() {
                        sum += d;
                        count += 1;
                    }
                }
            }
        }
    }
    (count > 30 && sum > 0.0).then(|| sum / f64::from(count))
}

fn noise(args: &Args, coarse: &Raster, roughness: Roughness) -> Result<midpoint::Noise> {
    Ok(match args.noise {
        Noise::None => midpoint::Noise::None,
        Noise::Fbm => midpoint::Noise::Fbm,
        Noise::Calibrated => {
            let mut entries = vec![Blend::default(); 64];
            let mut cache = Cache::new(&mut entries, args.stencil.of_library());
            let shape = Shape::new(coarse.rows, coarse.columns);
            let measured = Calibration::measure(&coarse.values, shape, roughness.hurst, &mut cache);
            midpoint::Noise::Calibrated(measured.map_err(|e| {
                Failure::file(
                    &args.file,
                    format_args!("cannot calibrate: {e} (needs about 20 × 20 known nodes)"),
                )
            })?)
        }
    })
}

/// Local roughness.
struct Maps {
    hurst: Raster,
    sigma: Raster,
}

impl Maps {
    fn read(args: &Args) -> Result<Option<Maps>> {
        let (Some(hurst), Some(sigma)) = (&args.hurst_map, &args.sigma_map) else {
            return Ok(None);
        };
        let maps = Maps {
            hurst: read_grid(hurst, None)?,
            sigma: read_grid(sigma, None)?,
        };
        if (maps.hurst.rows, maps.hurst.columns) != (maps.sigma.rows, maps.sigma.columns) {
            return Err(Failure::file(
                sigma,
                "another size than the map of exponents",
            ));
        }
        Ok(Some(maps))
    }

    /// Of the cell that holds this node; exponents in steps of 0.01, so that weights are
    /// solved for a hundred times at most.
    fn at(&self, shape: Shape, row: usize, column: usize) -> Roughness {
        let r = row * self.hurst.rows / shape.rows;
        let c = column * self.hurst.columns / shape.columns;
        let hurst = (self.hurst.at(r, c) * 100.0).round() / 100.0;
        let known = hurst.is_finite() && self.sigma.at(r, c) >= 0.0;
        match known {
            true => Roughness {
                hurst: hurst.clamp(0.05, 0.95),
                sigma: self.sigma.at(r, c),
            },
            false => Roughness {
                hurst: 0.8,
                sigma: 0.0,
            },
        }
    }
}

fn report(
    args: &Args,
    console: &Console,
    (fine, roughness, noise): (&Raster, Roughness, midpoint::Noise),
    (counts, started): (Counts, Instant),
) -> Result<()> {
    let calibration = match noise {
        midpoint::Noise::Calibrated(c) => json!({
            "square_sd": c.square.deviation, "square_exponent": c.square.exponent,
            "diamond_sd": c.diamond.deviation, "diamond_exponent": c.diamond.exponent,
        }),
        _ => Value::Null,
    };
    let unknown = fine.values.iter().filter(|z| z.is_nan()).count();
    let object = json!({
        "rows": fine.rows, "columns": fine.columns,
        "spacing": [fine.spacing_x, fine.spacing_y],
        "filled": counts.filled, "unknown": unknown,
        "hurst": roughness.hurst, "sigma": roughness.sigma,
        "calibration": calibration, "seconds": started.elapsed().as_secs_f64(),
    });
    console.result(
        &object,
        format_args!(
            "{}: {} × {} nodes ({}× denser), {} filled, {} unknown; H {:.3}, sigma {:.4} m at 1 m",
            args.out.display(),
            fine.rows,
            fine.columns,
            factor(args.levels),
            counts.filled,
            unknown,
            roughness.hurst,
            roughness.sigma,
        ),
    )
}
