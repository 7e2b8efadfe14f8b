//! `rugosa reconstruct FILE`: a full surface from sparse points or a raster with holes.

use crate::console::Console;
use crate::draw::{self, Layer};
use crate::error::{Failure, Result};
use crate::io::output::{Output, write_raster};
use crate::io::{self, Dataset, Points, Raster, Spacing, extension};
use crate::reconstruct::{
    Grid, Roughness, Seen, Solve, Solver, Tiles, cut, estimate, estimate_of_raster,
};
use crate::relaxation::Relaxation;
use rugosa_fractal::pyramid::{Draws, Progress};
use rugosa_fractal::roughness::irregular::Estimate;
use serde::Serialize;
use std::fmt;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// A full surface from sparse points or a raster with holes.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Node (row i, column j) of the result lies at X + j R, Y + i R. Without --hurst and --sigma
both are estimated from the points, and so is the noise without --noise-std.

Examples:
  rugosa reconstruct scan.ply --resolution 0.1 --out mean.npy
  rugosa reconstruct dem.asc --realisation 1 --seed 7 --out surface.png
  rugosa reconstruct dem.npy --spacing 0.1 --hurst 0.5 --sigma 0.2 --std 32 --out mean.npy --json
  rugosa reconstruct dem.asc --method ak96 --realisation 1 --out relaxed.png")]
pub struct Args {
    /// Points (.csv .xyz .ply .npy N×3) or a raster with NaN holes (.asc, .npy 2-D with --spacing)
    file: PathBuf,

    /// Distance between the nodes of a 2-D .npy [m]
    #[arg(long)]
    spacing: Option<Spacing>,

    /// Where node (0, 0) lies, X,Y [m]; default: the raster's, or the least x and y
    #[arg(long, allow_hyphen_values = true, value_parser = pair)]
    origin: Option<[f64; 2]>,

    /// Distance between nodes [m]; default: the raster's
    #[arg(long, value_parser = positive)]
    resolution: Option<f64>,

    /// Nodes per edge; default: the raster's, or what covers the points
    #[arg(long)]
    size: Option<usize>,

    /// The posterior mean: least error, but too smooth (the default)
    #[arg(long, conflicts_with = "realisation")]
    mean: bool,

    /// This many draws from the posterior, with the ground's own roughness
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    realisation: Option<u16>,

    /// Seed of the draws
    #[arg(long, default_value_t = 1)]
    seed: u64,

    /// Temperature of the draws: 0 is the mean, 1 the posterior
    #[arg(long, default_value_t = 1.0, value_parser = not_negative)]
    temperature: f64,

    /// Also write the standard deviation, from K draws, as NAME_std
    #[arg(long, value_name = "K", value_parser = clap::value_parser!(u16).range(2..))]
    std: Option<u16>,

    /// Hurst exponent, between 0 and 1
    #[arg(long, value_parser = hurst)]
    hurst: Option<f64>,

    /// Standard deviation of elevation differences at 1 m [m]
    #[arg(long, value_parser = positive)]
    sigma: Option<f64>,

    /// Standard deviation of the noise of a height [m]
    #[arg(long, value_parser = not_negative)]
    noise_std: Option<f64>,

    /// The pyramid's posterior, or relaxation and Gibbs sampling as published in 1996: a
    /// reference, hundreds of times slower
    #[arg(long, value_enum, default_value_t = Method::Pyramid)]
    method: Method,

    /// Structure function of the prior: a power law, or as measured
    #[arg(long, value_enum, default_value_t = PriorKind::Power)]
    prior: PriorKind,

    /// Let the roughness change in space, as far as the points show it
    #[arg(long, conflicts_with = "prior")]
    adaptive: bool,

    /// Most iterations of a solve; default 20, for ak96 200 sweeps
    #[arg(long)]
    iterations: Option<usize>,

    /// Result: .npy, .asc or .png
    #[arg(long)]
    out: PathBuf,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum, Serialize)]
#[serde(rename_all = "lowercase")]
enum Method {
    Pyramid,
    Ak96,
}

impl Args {
    fn iterations(&self) -> usize {
        self.iterations.unwrap_or(match self.method {
            Method::Pyramid => 20,
            Method::Ak96 => 200,
        })
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum PriorKind {
    Power,
    Measured,
}

fn number(text: &str, what: &str, good: impl Fn(f64) -> bool) -> Result<f64, String> {
    match text.trim().parse::<f64>() {
        Ok(v) if good(v) => Ok(v),
        _ => Err(format!("'{text}' is not {what}")),
    }
}

fn positive(text: &str) -> Result<f64, String> {
    number(text, "a positive number", |v| v > 0.0 && v.is_finite())
}

fn not_negative(text: &str) -> Result<f64, String> {
    number(text, "a number from 0", |v| v >= 0.0 && v.is_finite())
}

fn hurst(text: &str) -> Result<f64, String> {
    number(text, "between 0 and 1", |v| v > 0.0 && v < 1.0)
}

fn pair(text: &str) -> Result<[f64; 2], String> {
    let (x, y) = text.split_once(',').ok_or("two numbers X,Y are needed")?;
    let finite = |t| number(t, "a number", f64::is_finite);
    Ok([finite(x)?, finite(y)?])
}

#[derive(Serialize)]
struct Seconds {
    read: f64,
    solve: f64,
    write: f64,
}

#[derive(Serialize)]
struct Report {
    method: Method,
    hurst: f64,
    sigma: f64,
    noise_std: f64,
    iterations: usize,
    residual: f32,
    rows: usize,
    columns: usize,
    resolution_m: f64,
    origin_m: [f64; 2],
    points: usize,
    skipped: usize,
    outside: usize,
    shared: usize,
    refused: usize,
    known: usize,
    #[serde(skip_serializing_if = "Option::is_none")]
    local_tiles: Option<usize>,
    files: Vec<PathBuf>,
    seconds: Seconds,
}

/// Reads, solves, writes.
pub fn run(args: &Args, console: &Console) -> Result<()> {
    if args.method == Method::Ak96 && (args.adaptive || args.prior == PriorKind::Measured) {
        return Err(Failure::input(
            "--method ak96 knows one power law: leave --adaptive and --prior out",
        ));
    }
    let output = Output::of(&args.out);
    output.check(&["npy", "asc", "png"])?;
    let start = Instant::now();
    let source = read(args)?;
    let (points, grid) = (&source.points, source.grid);
    let read = start.elapsed().as_secs_f64();
    let solved = solve(args, &source, console)?;
    let solve = start.elapsed().as_secs_f64() - read;
    let files = write(&solved.outcome.layers, &output.file("reconstruction.npy"))?;
    let write = start.elapsed().as_secs_f64() - read - solve;
    let report = Report {
        method: args.method,
        hurst: solved.roughness.hurst,
        sigma: solved.roughness.sigma,
        noise_std: solved.roughness.noise,
        iterations: solved.outcome.progress.iterations,
        residual: solved.outcome.progress.residual,
        rows: grid.rows,
        columns: grid.columns,
        resolution_m: grid.resolution,
        origin_m: grid.origin,
        points: points.xyz.len(),
        skipped: points.skipped,
        outside: solved.seen.outside,
        shared: solved.seen.shared,
        refused: solved.outcome.refused,
        known: solved.seen.known,
        local_tiles: solved.local,
        files,
        seconds: Seconds { read, solve, write },
    };
    console.result(&report, &report)
}

/// The data and the grid of the result.
struct Source {
    points: Points,
    raster: Option<Raster>,
    grid: Grid,
}

impl Source {
    fn estimate(&self, noise: Option<f64>) -> Estimate {
        match &self.raster {
            Some(raster) => estimate_of_raster(raster, noise),
            None => estimate(&self.points.xyz, noise),
        }
    }
}

fn read(args: &Args) -> Result<Source> {
    let (points, raster) = match io::read(&args.file, args.spacing)? {
        Dataset::Points(points) => (points, None),
        Dataset::Raster(raster) => (Points::of(&args.file, raster.points())?, Some(raster)),
    };
    let own = match &raster {
        Some(raster) if args.resolution.is_none() => Some(own_grid(&args.file, raster)?),
        _ => None,
    };
    let resolution = args
        .resolution
        .or(own.map(|g| g.resolution))
        .ok_or_else(|| {
            Failure::input(format_args!(
                "{}: holds points: give --resolution",
                args.file.display()
            ))
        })?;
    let mut grid = match own {
        Some(own) => own,
        None => Grid::covering(&points, resolution),
    };
    grid.origin = args.origin.unwrap_or(grid.origin);
    if let Some(size) = args.size {
        (grid.rows, grid.columns) = (size, size);
    }
    grid.side()?;
    Ok(Source {
        points,
        raster,
        grid,
    })
}

fn own_grid(path: &Path, raster: &Raster) -> Result<Grid> {
    if (raster.spacing_x / raster.spacing_y - 1.0).abs() > 1e-6 {
        return Err(Failure::file(
            path,
            "its cells are not square: give --resolution",
        ));
    }
    Ok(Grid {
        origin: raster.origin,
        resolution: raster.spacing_x,
        rows: raster.rows,
        columns: raster.columns,
    })
}

/// What is to be written, by suffix, and how the solver fared.
struct Outcome {
    layers: Vec<(String, Raster)>,
    progress: Progress,
    refused: usize,
}

/// The same with what it rests on.
struct Solved {
    outcome: Outcome,
    roughness: Roughness,
    seen: Seen,
    local: Option<usize>,
}

fn solve(args: &Args, source: &Source, console: &Console) -> Result<Solved> {
    let (points, grid) = (&source.points, &source.grid);
    let side = grid.side()?;
    let given = (args.hurst, args.sigma, args.noise_std);
    let measure = || source.estimate(args.noise_std);
    let roughness = Roughness::given_or_estimated(given, measure)?;
    let (seen, level) = Seen::new(&points.xyz, grid, roughness.noise)?;
    let task = Task {
        args,
        console,
        grid,
        level,
        side,
    };
    let mut local = None;
    let outcome = if args.method == Method::Ak96 {
        task.run(&mut Relaxation::new(&seen, &roughness, grid.resolution)?)?
    } else if args.adaptive {
        let tiles = Tiles::new(&points.xyz, grid, side, &roughness)?;
        local = Some(tiles.local);
        task.run(&mut Solver::new(&seen, &tiles.field()?)?)?
    } else {
        let levels = match args.prior {
            PriorKind::Power => roughness.levels(side, grid.resolution)?,
            PriorKind::Measured => roughness.measured(&measure().bins, side, grid.resolution)?,
        };
        task.run(&mut Solver::new(&seen, &levels)?)?
    };
    Ok(Solved {
        outcome,
        roughness,
        seen,
        local,
    })
}

/// What a run needs besides data and prior.
struct Task<'a> {
    args: &'a Args,
    console: &'a Console,
    grid: &'a Grid,
    level: f64,
    side: usize,
}

impl Task<'_> {
    fn run(&self, solver: &mut dyn Solve) -> Result<Outcome> {
        let iterations = self.args.iterations();
        let draws = usize::from(self.args.realisation.unwrap_or(0));
        let deviations = usize::from(self.args.std.unwrap_or(0));
        let total = (draws.max(1) + deviations) * iterations;
        let mut progress = self.console.progress("reconstruct", Some(total as u64));
        let mut count = 0;
        let mut done = || {
            count += 1;
            progress.set(count, || "iterations");
        };
        let mut outcome = Outcome {
            layers: Vec::new(),
            progress: Progress {
                iterations: 0,
                residual: 0.0,
            },
            refused: 0,
        };
        for i in 0..draws.max(1) {
            let (square, state) = if draws == 0 {
                solver.mean(iterations, &mut done)?
            } else {
                let draw = (self.args.temperature as f32, self.args.seed + i as u64);
                solver.realisation(draw, iterations, &mut done)?
            };
            let suffix = if draws > 1 {
                format!("_{}", i + 1)
            } else {
                String::new()
            };
            let raster = cut(&square, self.side, self.grid, self.level);
            outcome.layers.push((suffix, raster));
            outcome.progress = state;
        }
        outcome.refused = solver.refused();
        if deviations > 0 {
            let draws = Draws {
                count: deviations,
                iterations,
            };
            let square = solver.deviation(draws, !self.args.seed)?;
            let raster = cut(&square, self.side, self.grid, 0.0);
            outcome.layers.push(("_std".into(), raster));
        }
        Ok(outcome)
    }
}

/// Writes every layer beside `path`.
fn write(layers: &[(String, Raster)], path: &Path) -> Result<Vec<PathBuf>> {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let kind = extension(path);
    let mut files = Vec::new();
    for (suffix, raster) in layers {
        let file = path.with_file_name(format!("{stem}{suffix}.{kind}"));
        if kind == "png" {
            let layer = match suffix.as_str() {
                "_std" => Layer::magnitude("standard deviation", "m", raster),
                _ => Layer::elevation("reconstruction", raster),
            };
            draw::maps(&[layer])?.save(&file)?;
        } else {
            write_raster(&file, raster)?;
        }
        files.push(file);
    }
    Ok(files)
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "roughness   H {:.3} (D {:.3}), sigma {:.4} m at 1 m, noise {:.4} m",
            self.hurst,
            3.0 - self.hurst,
            self.sigma,
            self.noise_std
        )?;
        writeln!(
            f,
            "data        {} points: {} nodes of {} known, {} points share a node, {} outside",
            self.points,
            self.known,
            self.rows * self.columns,
            self.shared,
            self.outside
        )?;
        writeln!(
            f,
            "solve       {} iterations, residual {:.1e}, {:.3} s",
            self.iterations, self.residual, self.seconds.solve
        )?;
        let files: Vec<_> = self.files.iter().map(|p| p.display().to_string()).collect();
        write!(f, "written     {}", files.join(", "))
    }
}
