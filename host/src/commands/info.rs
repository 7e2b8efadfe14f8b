//! `rugosa info FILE`: what a file holds.

use crate::console::Console;
use crate::error::Result;
use crate::io::{self, Dataset, Points, Raster, Spacing};
use crate::recording::{Recording, Summary};
use crate::saved::SavedMap;
use rugosa_grid::State;
use serde::Serialize;
use std::fmt;
use std::path::{Path, PathBuf};

/// Say what a file of points, a raster, a bag, a recording or a saved map holds.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  rugosa info scan.ply
  rugosa info sweeps.mcap
  rugosa info rosbag2_0.mcap
  rugosa info out/demo/map.rugosa
  rugosa info dem.npy --spacing 0.1 --json")]
pub struct Args {
    /// Points (.csv .xyz .ply .las .npy N×3 …), a raster (.asc .tif, .npy 2-D with --spacing),
    /// a recording or a bag of point clouds (.mcap), a saved map (.rugosa)
    file: PathBuf,

    /// Distance between the nodes of a 2-D .npy, DX or DX,DY [m]
    #[arg(long)]
    spacing: Option<Spacing>,
}

#[derive(Serialize)]
#[serde(tag = "kind", rename_all = "lowercase")]
enum Report {
    Recording(Summary),
    Points {
        points: usize,
        skipped: usize,
        min_m: [f64; 3],
        max_m: [f64; 3],
        per_square_metre: f64,
    },
    Raster {
        rows: usize,
        columns: usize,
        spacing_m: [f64; 2],
        origin_m: [f64; 2],
        known: usize,
        min_m: Option<f32>,
        max_m: Option<f32>,
    },
    Map {
        rows: usize,
        columns: usize,
        resolution_m: f32,
        corner_m: [f64; 2],
        measured: usize,
        seen_through: usize,
        /// of the measured cells
        min_m: Option<f64>,
        max_m: Option<f64>,
        sweep: u32,
        merged: bool,
    },
}

/// Reads the file and describes it.
pub fn run(args: &Args, console: &Console) -> Result<()> {
    if is_recording(&args.file)? {
        let mut progress = console.progress("reading", None);
        let summary = Summary::of(&args.file, |n| progress.set(n, || format!("{n} messages")))?;
        drop(progress);
        let report = Report::Recording(summary);
        return console.result(&report, &report);
    }
    if io::extension(&args.file) == "rugosa" {
        let report = Report::map(&SavedMap::read(&args.file)?);
        return console.result(&report, &report);
    }
    let report = match io::read(&args.file, args.spacing)? {
        Dataset::Points(points) => Report::points(&points),
        Dataset::Raster(raster) => Report::raster(&raster),
    };
    console.result(&report, &report)
}

/// Is this a recording, rather than a bag of other programs' messages?
fn is_recording(path: &Path) -> Result<bool> {
    let extension = path.extension();
    if !extension.is_some_and(|e| e.eq_ignore_ascii_case("mcap")) {
        return Ok(false);
    }
    // a bag has no messages of rugosa, or chunks that are too large for a recording
    Ok(!matches!(Recording::open(path)?.next(), Some(Err(_))))
}

impl Report {
    fn points(points: &Points) -> Self {
        let (min_m, max_m) = points.bounds();
        let area = (max_m[0] - min_m[0]) * (max_m[1] - min_m[1]);
        Report::Points {
            points: points.xyz.len(),
            skipped: points.skipped,
            min_m,
            max_m,
            per_square_metre: if area > 0.0 {
                points.xyz.len() as f64 / area
            } else {
                0.0
            },
        }
    }

    fn raster(raster: &Raster) -> Self {
        let range = raster.range();
        Report::Raster {
            rows: raster.rows,
            columns: raster.columns,
            spacing_m: [raster.spacing_x, raster.spacing_y],
            origin_m: raster.origin,
            known: raster.known(),
            min_m: range.map(|r| r.0),
            max_m: range.map(|r| r.1),
        }
    }

    fn map(map: &SavedMap) -> Self {
        let in_state = |state| map.cells.iter().filter(move |cell| cell.state == state);
        let datum = map.rise as f64 * f64::from(map.height_step);
        let heights = || in_state(State::Measured).map(|cell| f64::from(cell.elevation) + datum);
        Report::Map {
            rows: map.rows,
            columns: map.columns,
            resolution_m: map.resolution,
            corner_m: map.corner(),
            measured: map.measured(),
            seen_through: in_state(State::SeenThrough).count(),
            min_m: heights().reduce(f64::min),
            max_m: heights().reduce(f64::max),
            sweep: map.sweep,
            merged: map.evidence.is_some(),
        }
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Report::Recording(summary) => summary.fmt(f),
            Report::Points {
                points,
                skipped,
                min_m,
                max_m,
                per_square_metre,
            } => {
                writeln!(f, "points     {points} ({skipped} skipped: not finite)")?;
                for (axis, name) in ["x", "y", "z"].iter().enumerate() {
                    writeln!(
                        f,
                        "{name}          {:.3} … {:.3} m",
                        min_m[axis], max_m[axis]
                    )?;
                }
                write!(f, "density    {per_square_metre:.2} points per m²")
            }
            Report::Raster {
                rows,
                columns,
                spacing_m: [dx, dy],
                origin_m: [x, y],
                known,
                min_m,
                max_m,
            } => {
                writeln!(
                    f,
                    "raster     {rows} rows × {columns} columns, {dx} × {dy} m"
                )?;
                writeln!(f, "origin     {x}, {y} m (node of row 0, column 0)")?;
                write!(f, "known      {known} of {} nodes", rows * columns)?;
                match (min_m, max_m) {
                    (Some(low), Some(high)) => write!(f, ", {low:.3} … {high:.3} m"),
                    _ => Ok(()),
                }
            }
            Report::Map {
                rows,
                columns,
                resolution_m,
                corner_m: [x, y],
                measured,
                seen_through,
                min_m,
                max_m,
                sweep,
                merged,
            } => {
                let merged = if *merged { ", merged" } else { "" };
                writeln!(
                    f,
                    "map        {rows} rows × {columns} columns of {resolution_m} m, after sweep {sweep}{merged}"
                )?;
                writeln!(f, "corner     {x:.3}, {y:.3} m (south-west)")?;
                write!(f, "measured   {measured} of {} cells", rows * columns)?;
                if let (Some(low), Some(high)) = (min_m, max_m) {
                    write!(f, ", {low:.3} … {high:.3} m")?;
                }
                write!(f, "\nholes      {seen_through} cells seen through")
            }
        }
    }
}
