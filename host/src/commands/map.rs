//! `rugosa map FILE…`: all layers of points, scans or rasters, without a robot.

use super::merge::{self, Crop};
use crate::bridge::{Summary, Traffic, structure_plot};
use crate::config::Settings;
use crate::console::Console;
use crate::error::{Failure, Result};
use crate::export::{self, Format};
use crate::io::{self, Spacing, atomic};
use crate::layers::Layers;
use crate::offline::Cloud;
use crate::planes::HeapPlanes;
use crate::saved::{self, SavedMap};
use crate::view::{self, Data};
use rugosa::{Mapper, SweepReport};
use serde::Serialize;
use std::path::PathBuf;
use std::time::Instant;

/// Make a map of files of points or of rasters: elevation, roughness, traversability.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  rugosa map scan.ply --out map
  rugosa map dem.asc --out map --export nav2,mcap,geotiff,png
  rugosa map dem.npy --spacing 0.01 --out map --report
  rugosa map drive.mcap --resolution 0.1 --out map --export nav2,rugosa
  rugosa map a.rugosa b.rugosa --crop -5,-5,5,5 --out both --export mcap
  rugosa map a.xyz b.xyz --resolution 0.1 --noise-std 0.02 --out map --export npy,ply")]
pub struct Args {
    /// Points (.csv .xyz .ply .pcd .las .laz, .npy and .npz N×3, .mcap with PointCloud2,
    /// .perc), rasters (.asc .tif, .npy and .npz 2-D with --spacing) or saved maps (.rugosa)
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

    /// Of saved maps: keep the cells of this rectangle only [m]
    #[arg(long, value_name = "X0,Y0,X1,Y1", allow_hyphen_values = true)]
    crop: Option<Crop>,

    /// Also write report.html, a page that needs no network
    #[arg(long)]
    report: bool,
}

#[derive(Serialize)]
struct Report<'a> {
    points: usize,
    points_skipped: usize,
    resolution_m: f64,
    cells_x: usize,
    cells_y: usize,
    /// planes of the mapper and the points
    memory_bytes: usize,
    /// most that the process has used, where the system tells
    peak_memory_bytes: Option<u64>,
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

/// A map that has been made.
struct Made<'m> {
    mapper: Mapper<'m>,
    report: SweepReport,
    layers: Layers,
    saved: SavedMap,
    /// points in it, points left out
    points: [usize; 2],
}

/// Reads, maps, exports.
pub fn run(args: &Args, console: &Console) -> Result<()> {
    check(args)?;
    let settings = Settings::read(args.config.as_deref())?;
    let saved = args.files.iter().filter(|f| io::extension(f) == "rugosa");
    match saved.count() {
        0 => of_files(args, settings, console),
        n if n == args.files.len() => of_maps(args, settings, console),
        _ => Err(Failure::input(
            "saved maps (.rugosa) and other files cannot be mapped together",
        )),
    }
}

/// Maps points and rasters.
fn of_files(args: &Args, settings: Settings, console: &Console) -> Result<()> {
    let started = Instant::now();
    let mut progress = console.progress("read", Some(args.files.len() as u64));
    let mut data = Vec::new();
    for (i, file) in args.files.iter().enumerate() {
        progress.set(i as u64, || file.display().to_string());
        data.push(io::read(file, args.spacing)?);
    }
    drop(progress);
    let cloud = Cloud::of(data, args.resolution)?;
    let settings = cloud.fit(settings)?;
    let read = started.elapsed().as_secs_f64();
    let mut planes = HeapPlanes::new(settings.side);
    let memory = planes.bytes() + cloud.bytes();
    let points = cloud.points();
    let mut progress = console.progress("map", Some(points[0] as u64));
    let mapped = cloud.map(&settings, args.noise_std, &mut planes, |done| {
        progress.set(done as u64, || "points")
    })?;
    drop(progress);
    let made = Made {
        mapper: mapped.mapper,
        report: mapped.report,
        layers: mapped.layers,
        saved: mapped.saved,
        points,
    };
    finish(args, &made, (read, started, memory), console)
}

/// Layers of saved maps, merged.
fn of_maps(args: &Args, settings: Settings, console: &Console) -> Result<()> {
    let started = Instant::now();
    let saved = merge::joined(&args.files, args.crop, console)?;
    let settings = saved.fit(settings)?;
    let read = started.elapsed().as_secs_f64();
    let mut planes = HeapPlanes::new(settings.side);
    let memory = planes.bytes() + size_of_val(&saved.cells[..]);
    let (mapper, report, layers) = saved::load(&saved, &settings, &mut planes)?;
    let made = Made {
        mapper,
        report,
        layers,
        points: [saved.measured(), 0],
        saved,
    };
    finish(args, &made, (read, started, memory), console)
}

/// Exports a map and reports on it.
fn finish(
    args: &Args,
    made: &Made,
    (read, started, memory_bytes): (f64, Instant, usize),
    console: &Console,
) -> Result<()> {
    let total = started.elapsed().as_secs_f64();
    let mut seconds = Seconds {
        read,
        map: total - read,
        export: 0.0,
    };
    let summary = Summary::of(&made.mapper, Some(&made.report), &Traffic::default(), total);
    let mut files = export::save(&made.layers, &made.saved, &args.out, &args.export)?;
    if args.export.contains(&Format::Png) {
        let path = args.out.join("structure_function.png");
        structure_plot(&made.mapper, &summary).draw()?.save(&path)?;
        files.push(path);
    }
    if args.report {
        files.push(save_report(args, made, &summary, seconds)?);
    }
    let path = args.out.join("summary.json");
    files.push(path.clone());
    seconds.export = started.elapsed().as_secs_f64() - total;
    let report = Report {
        points: made.points[0],
        points_skipped: made.points[1],
        resolution_m: made.layers.resolution,
        cells_x: made.layers.columns,
        cells_y: made.layers.rows,
        memory_bytes,
        peak_memory_bytes: peak_memory(),
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

fn save_report(args: &Args, made: &Made, summary: &Summary, seconds: Seconds) -> Result<PathBuf> {
    let path = args.out.join("report.html");
    let name = args.files[0].file_name().unwrap_or_default();
    let title = format!("Map of {}", name.to_string_lossy());
    let timings = vec![
        ("reading [s]".into(), seconds.read),
        ("mapping [s]".into(), seconds.map),
    ];
    let data = Data::of(&title, &made.mapper, &made.layers, summary, timings);
    view::report(&path, &data)?;
    Ok(path)
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
    if args.crop.is_some() && args.files.iter().any(|f| io::extension(f) != "rugosa") {
        return Err(Failure::input("--crop is for saved maps (.rugosa)"));
    }
    if args.out.is_file() {
        return Err(Failure::file(
            &args.out,
            "is a file; --out is a directory here",
        ));
    }
    Ok(())
}

/// Linux: the greatest resident size of this process.
fn peak_memory() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|l| l.strip_prefix("VmHWM:"))?;
    let kib: u64 = line.split_whitespace().next()?.parse().ok()?;
    Some(kib * 1024)
}

fn text(report: &Report) -> String {
    let peak = report.peak_memory_bytes.map_or(String::new(), |bytes| {
        format!(", at most {:.0} MB in all", bytes as f64 * 1e-6)
    });
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
        "points     {} ({} skipped)\nmap        {} × {} cells of {} m, {} measured\nmemory     {:.1} MB for map and points{peak}\ndimension  {estimate}\ntime       {:.2} s reading, {:.2} s mapping, {:.2} s exporting\nfiles      {}",
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
