//! `rugosa map FILE…`: all layers of points, scans or rasters, without a robot.

use crate::bridge::{Summary, Traffic, structure_plot};
use crate::config::Settings;
use crate::console::Console;
use crate::error::{Failure, Result};
use crate::export::{self, Format};
use crate::io::{self, Spacing, atomic};
use crate::offline::Cloud;
use crate::planes::HeapPlanes;
use serde::Serialize;
use std::path::PathBuf;
use std::time::Instant;

/// Make a map of files of points or of rasters: elevation, roughness, traversability.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  rugosa map scan.ply --out map
  rugosa map dem.asc --out map --export nav2,mcap,geotiff,png
  rugosa map dem.npy --spacing 0.01 --out map
  rugosa map a.xyz b.xyz --resolution 0.1 --noise-std 0.02 --out map --export npy,ply")]
pub struct Args {
    /// Points (.csv .xyz .ply .npy N×3) or rasters (.asc, .npy 2-D with --spacing)
    #[arg(required = true)]
    files: Vec<PathBuf>,

    /// Distance between the nodes of a 2-D .npy [m]
    #[arg(long)]
    spacing: Option<Spacing>,

    /// Cell edge [m]; without it that of the raster, or one with about 4 points per cell
    #[arg(long, value_name = "M")]
    resolution: Option<f64>,

    /// Standard deviation of the heights' noise [m]
    #[arg(long, value_name = "M", default_value_t = 0.005)]
    noise_std: f64,

    /// Configuration (TOML, see `rugosa config`); side and resolution follow from the files
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,

    /// Directory of the results
    #[arg(long, value_name = "DIR")]
    out: PathBuf,

    /// Formats, separated by commas
    #[arg(long, value_enum, value_delimiter = ',', default_values = ["npy", "png"])]
    export: Vec<Format>,
}

#[derive(Serialize)]
struct Report<'a> {
    points: usize,
    points_skipped: usize,
    resolution_m: f64,
    cells_x: usize,
    cells_y: usize,
    memory_bytes: usize,
    seconds_by_stage: Seconds,
    #[serde(flatten)]
    summary: &'a Summary,
    files: &'a [PathBuf],
}

#[derive(Clone, Copy, Default, Serialize)]
struct Seconds {
    read: f64,
    map: f64,
    export: f64,
}

/// Reads, maps, exports.
pub fn run(args: &Args, console: &Console) -> Result<()> {
    check(args)?;
    let settings = Settings::read(args.config.as_deref())?;
    let (started, mut seconds) = (Instant::now(), Seconds::default());
    let data: Result<Vec<_>> = args
        .files
        .iter()
        .map(|file| io::read(file, args.spacing))
        .collect();
    let cloud = Cloud::of(data?, args.resolution)?;
    let settings = cloud.fit(settings)?;
    seconds.read = started.elapsed().as_secs_f64();

    let mut planes = HeapPlanes::new(settings.side);
    let memory_bytes = planes.bytes();
    let [points, points_skipped] = cloud.points();
    let mut progress = console.progress("map", Some(points as u64));
    let mapped = cloud.map(&settings, args.noise_std, &mut planes, |done| {
        progress.set(done as u64, || "points")
    })?;
    drop(progress);
    let total = started.elapsed().as_secs_f64();
    seconds.map = total - seconds.read;

    let summary = Summary::of(
        &mapped.mapper,
        Some(&mapped.report),
        &Traffic::default(),
        total,
    );
    let mut files = export::save(&mapped.layers, &args.out, &args.export)?;
    if args.export.contains(&Format::Png) {
        let path = args.out.join("structure_function.png");
        structure_plot(&mapped.mapper, &summary)
            .draw()?
            .save(&path)?;
        files.push(path);
    }
    let path = args.out.join("summary.json");
    files.push(path.clone());
    seconds.export = started.elapsed().as_secs_f64() - total;
    let [cells_x, cells_y] = cloud.cells();
    let report = Report {
        points,
        points_skipped,
        resolution_m: cloud.resolution,
        cells_x,
        cells_y,
        memory_bytes,
        seconds_by_stage: seconds,
        summary: &summary,
        files: &files,
    };
    atomic::write(&path, |writer| {
        serde_json::to_writer_pretty(&mut *writer, &report)?;
        writeln!(writer)
    })?;
    console.result(&report, text(&report))
}

fn check(args: &Args) -> Result<()> {
    if args.resolution.is_some_and(|r| !(r.is_finite() && r > 0.0)) {
        return Err(Failure::input(
            "--resolution: a positive number of metres is needed",
        ));
    }
    if !(args.noise_std.is_finite() && args.noise_std >= 0.0) {
        return Err(Failure::input(
            "--noise-std: 0 or a positive number of metres is needed",
        ));
    }
    if args.out.is_file() {
        return Err(Failure::file(
            &args.out,
            "is a file; --out is a directory here",
        ));
    }
    Ok(())
}

fn text(report: &Report) -> String {
    let s = report.seconds_by_stage;
    let estimate = match &report.summary.estimate {
        Some(e) => format!(
            "D = {:.3} ± {:.3}, σ(1 m) = {:.4} m",
            e.dimension, e.standard_error, e.sigma
        ),
        None => format!("none: {}", report.summary.reason.as_deref().unwrap_or("?")),
    };
    let files: Vec<String> = report
        .files
        .iter()
        .map(|f| f.display().to_string())
        .collect();
    format!(
        "points     {} ({} skipped)\nmap        {} × {} cells of {} m, {} measured, {:.1} MB\ndimension  {estimate}\ntime       {:.2} s reading, {:.2} s mapping, {:.2} s exporting\nfiles      {}",
        report.points,
        report.points_skipped,
        report.cells_x,
        report.cells_y,
        report.resolution_m,
        report.summary.cells.measured,
        report.memory_bytes as f64 * 1e-6,
        s.read,
        s.map,
        s.export,
        files.join("\n           ")
    )
}
