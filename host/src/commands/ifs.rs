//! `rugosa ifs fit` and `rugosa ifs tabulate`: projected iterated function systems.

use super::compress::{Quality, read_whole_grid, write_grid};
use crate::console::Console;
use crate::error::{Failure, Result};
use crate::io::{Raster, Spacing, atomic};
use clap::{Subcommand, ValueEnum};
use rugosa_fractal::surfaces::Shape;
use rugosa_fractal::surfaces::ifs::{self, Fit, Mosaic, Options, Start, depth_of, side_of};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Fit a projected IFS to a raster, or tabulate one to any depth.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  rugosa ifs fit crop.npy --iterations 7 --out crop.ifs
  rugosa ifs tabulate crop.ifs --depth 5 --out finer.npy")]
pub struct Args {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Fit 232 parameters per patch of (3^p + 1)² samples
    Fit(FitArgs),
    /// Write the surface of a fitted file as a raster
    Tabulate(TabulateArgs),
}

#[derive(Debug, clap::Args)]
#[command(after_help = "\
A patch has 28, 82, 244, ... samples per side. A raster of several patches
(k · 27 + 1 samples and so on) is fitted patch by patch, without seams.

Examples:
  rugosa ifs fit crop.npy --iterations 7 --out crop.ifs
  rugosa ifs fit large.npy --patch 82 --iterations 10 --out large.ifs --json")]
struct FitArgs {
    /// Raster without holes: .asc or 2-D .npy
    file: PathBuf,
    /// Most Levenberg–Marquardt iterations per patch
    #[arg(long, value_name = "N", default_value_t = 15)]
    iterations: u32,
    /// Penalty on weights away from bilinear; larger makes deeper tables safer
    #[arg(
        long,
        value_name = "R",
        default_value_t = 1e-5,
        allow_negative_numbers = true
    )]
    ridge: f64,
    /// How neighbouring patches are made to meet
    #[arg(long, value_enum, default_value_t = Variant::Tied)]
    variant: Variant,
    /// Start from the collage fit instead of bilinear weights
    #[arg(long)]
    collage: bool,
    /// Samples per side of a patch (28, 82, 244, ...); the largest that fits if absent
    #[arg(long, value_name = "SIDE")]
    patch: Option<usize>,
    /// File to write
    #[arg(long, value_name = "F")]
    out: PathBuf,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum Variant {
    /// the published model, 232 parameters
    Tied,
    /// every second patch mirrored, 268 parameters
    Mirrored,
}

#[derive(Debug, clap::Args)]
struct TabulateArgs {
    /// A file of `rugosa ifs fit`
    file: PathBuf,
    /// Depth p: 3^p + 1 samples per side of a patch; that of the fit if absent
    #[arg(long, value_name = "P", value_parser = clap::value_parser!(u32).range(1..=9))]
    depth: Option<u32>,
    /// Distance between samples in an .asc [m]
    #[arg(long, value_name = "DX[,DY]")]
    spacing: Option<Spacing>,
    /// Raster to write: .npy or .asc
    #[arg(long, value_name = "G")]
    out: PathBuf,
}

/// Most samples of a table.
const MOST_SAMPLES: usize = 1 << 28;

/// Fits or tabulates.
pub fn run(args: &Args, console: &Console) -> Result<()> {
    match &args.command {
        Command::Fit(args) => fit(args, console),
        Command::Tabulate(args) => tabulate(args, console),
    }
}

fn fit(args: &FitArgs, console: &Console) -> Result<()> {
    let started = Instant::now();
    let raster = read_whole_grid(&args.file, None)?;
    if !(args.ridge >= 0.0 && args.ridge.is_finite()) {
        return Err(Failure::input("--ridge must be 0 or more"));
    }
    let depth = depth(&raster, args.patch).map_err(|m| Failure::file(&args.file, m))?;
    let options = Options {
        variant: match args.variant {
            Variant::Tied => ifs::Variant::Tied,
            Variant::Mirrored => ifs::Variant::Mirrored,
        },
        start: if args.collage {
            Start::Collage
        } else {
            Start::Bilinear
        },
        iterations: args.iterations,
        ridge: args.ridge,
        ..Options::default()
    };
    let (mosaic, fits) =
        fit_raster(&raster, depth, &options, console).map_err(|e| Failure::file(&args.file, e))?;
    let bytes = mosaic.to_bytes();
    atomic::write(&args.out, |w| w.write_all(&bytes))?;
    let table = heights(&mosaic, depth);
    let quality = Quality::of(&table.values, &raster.values);
    report(
        args,
        console,
        (&mosaic, &fits, bytes.len()),
        (quality, started),
    )
}

/// Fits patch by patch with progress per iteration.
pub fn fit_raster(
    raster: &Raster,
    depth: u32,
    options: &Options,
    console: &Console,
) -> Result<(Mosaic, Vec<Fit>), rugosa_fractal::surfaces::SurfaceError> {
    let data: Vec<f64> = raster.values.iter().map(|&z| f64::from(z)).collect();
    let shape = Shape::new(raster.rows, raster.columns);
    let cells = side_of(depth) - 1;
    let patches = (raster.rows / cells * (raster.columns / cells)) as u64;
    let each = u64::from(options.iterations) + 1;
    let mut progress = console.progress("fitting", Some(patches * each));
    Mosaic::fit(&data, shape, depth, options, &mut |patch, iteration| {
        let done = patch as u64 * each + u64::from(iteration.number) + 1;
        progress.set(done, || {
            format!(
                "patch {} iteration {}: {:.2} dB",
                patch + 1,
                iteration.number,
                iteration.psnr
            )
        });
    })
}

/// The depth of the patches: given by their side, or the largest that divides the raster.
pub fn depth(raster: &Raster, patch: Option<usize>) -> Result<u32, String> {
    let fits = |depth: u32| {
        Shape::new(raster.rows, raster.columns)
            .coarser(side_of(depth) - 1)
            .is_some()
    };
    match patch {
        Some(side) => depth_of(side)
            .filter(|&depth| depth >= 3 && fits(depth))
            .ok_or(format!(
                "{} × {} samples are not made of patches of {side}",
                raster.rows, raster.columns
            )),
        None => (3..=6).rev().find(|&depth| fits(depth)).ok_or(format!(
            "{} × {} samples; sides of k · 27 + 1 are needed (28, 55, 82, 244, ...)",
            raster.rows, raster.columns
        )),
    }
}

/// The table of a mosaic as a raster of unit spacing.
pub fn heights(mosaic: &Mosaic, depth: u32) -> Raster {
    let (table, shape) = mosaic.tabulate(depth);
    let values = table.into_iter().map(|z| z as f32).collect();
    Raster::square(shape.rows, shape.columns, 1.0, [0.0, 0.0], values)
}

/// The worst verdict of all patches.
fn verdict(fits: &[Fit]) -> &'static str {
    let rank = |v: ifs::Verdict| match v {
        ifs::Verdict::Proved => 0,
        ifs::Verdict::NotDisproved => 1,
        ifs::Verdict::Diverges => 2,
    };
    let worst = fits
        .iter()
        .map(|f| f.contractivity.verdict)
        .max_by_key(|v| rank(*v));
    worst.map_or("proved", ifs::Verdict::as_str)
}

fn finite(psnr: &f64) -> Value {
    if psnr.is_finite() {
        json!(psnr)
    } else {
        Value::Null
    }
}

fn report(
    args: &FitArgs,
    console: &Console,
    (mosaic, fits, bytes): (&Mosaic, &[Fit], usize),
    (quality, started): (Quality, Instant),
) -> Result<()> {
    let verdict = verdict(fits);
    if verdict == "diverges" {
        console.note("deeper tables diverge: raise --ridge tenfold before tabulating deeper");
    }
    let per_patch: Vec<Vec<Value>> = fits
        .iter()
        .map(|f| f.psnr.iter().map(finite).collect())
        .collect();
    let psnr = match per_patch.as_slice() {
        [one] => json!(one),
        all => json!(all),
    };
    let largest = |get: fn(&Fit) -> f64| fits.iter().map(get).fold(0.0, f64::max);
    let object = json!({
        "psnr": psnr, "contractivity": verdict, "seconds": started.elapsed().as_secs_f64(),
        "psnr_all": quality.psnr, "max_error": quality.max_error, "bytes": bytes,
        "patches": [mosaic.lattice().rows, mosaic.lattice().columns], "depth": mosaic.depth(),
        "tau": [largest(|f| f.contractivity.tau[0]), largest(|f| f.contractivity.tau[1]), largest(|f| f.contractivity.tau[2])],
        "radius": largest(|f| f.contractivity.radius),
    });
    console.result(
        &object,
        format_args!(
            "{}: {quality}, {} patches of depth {}, {bytes} bytes, contractivity {verdict}, {:.2} s",
            args.out.display(), fits.len(), mosaic.depth(), started.elapsed().as_secs_f64(),
        ),
    )
}

/// Reads a file of `ifs fit`.
pub fn read(path: &Path) -> Result<Mosaic> {
    let bytes = std::fs::read(path).map_err(|e| Failure::file(path, e))?;
    Mosaic::from_bytes(&bytes).map_err(|e| Failure::file(path, e))
}

fn tabulate(args: &TabulateArgs, console: &Console) -> Result<()> {
    let mosaic = read(&args.file)?;
    let depth = args.depth.unwrap_or(mosaic.depth());
    let lattice = mosaic.lattice();
    let cells = side_of(depth) - 1;
    let samples = lattice
        .rows
        .saturating_mul(cells)
        .saturating_mul(lattice.columns)
        .saturating_mul(cells);
    if samples > MOST_SAMPLES {
        return Err(Failure::input(format_args!(
            "--depth {depth} makes {samples} samples; at most 2^28 are possible"
        )));
    }
    let _progress = console.progress("tabulating", None);
    let mut raster = heights(&mosaic, depth);
    if let Some(spacing) = args.spacing {
        (raster.spacing_x, raster.spacing_y) = (spacing.x, spacing.y);
    }
    write_grid(&args.out, &raster)?;
    let object = json!({ "rows": raster.rows, "columns": raster.columns, "depth": depth, "fitted_depth": mosaic.depth() });
    console.result(
        &object,
        format_args!(
            "{}: {} × {} samples, depth {depth}",
            args.out.display(),
            raster.rows,
            raster.columns
        ),
    )
}
