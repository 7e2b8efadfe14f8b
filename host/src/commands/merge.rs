//! `rugosa merge MAP… --out MAP`: saved maps become one, or a part of one.

use crate::console::Console;
use crate::error::{Failure, Result};
use crate::saved::SavedMap;
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::str::FromStr;

/// Merge saved maps (.rugosa) by variance, or cut a part out of one.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  rugosa merge robot1/map.rugosa robot2/map.rugosa --out both.rugosa
  rugosa merge map.rugosa --crop 2,-1,8,4 --out part.rugosa
  rugosa map both.rugosa --out maps --export mcap,geotiff

The maps need the same resolution and height step. The result does not depend on the
order, nor on what is merged first, to the last bit.")]
pub struct Args {
    /// Saved maps, from `--export rugosa` or a run's map.rugosa
    #[arg(required = true)]
    maps: Vec<PathBuf>,

    /// Keep the cells of this rectangle only [m]
    #[arg(long, value_name = "X0,Y0,X1,Y1", allow_hyphen_values = true)]
    crop: Option<Crop>,

    /// The map that is written (.rugosa)
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
}

/// A rectangle on the command line \[m\].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Crop(pub [f64; 4]);

impl FromStr for Crop {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers: Option<Vec<f64>> = text.split(',').map(|t| t.trim().parse().ok()).collect();
        let four: Option<[f64; 4]> = numbers.and_then(|n| n.try_into().ok());
        let sound = four.filter(|[x0, y0, x1, y1]| x0 < x1 && y0 < y1);
        sound
            .map(Crop)
            .ok_or_else(|| format!("'{text}' is not X0,Y0,X1,Y1 with X0 < X1 and Y0 < Y1"))
    }
}

#[derive(Serialize)]
struct Report<'a> {
    maps: usize,
    cells_x: usize,
    cells_y: usize,
    resolution_m: f32,
    corner_m: [f64; 2],
    measured: usize,
    file: &'a Path,
}

/// Reads, merges, cuts, writes.
pub fn run(args: &Args, console: &Console) -> Result<()> {
    if crate::io::extension(&args.out) != "rugosa" {
        return Err(Failure::input(format_args!(
            "--out {}: a saved map ends in .rugosa",
            args.out.display()
        )));
    }
    let map = joined(&args.maps, args.crop, console)?;
    map.write(&args.out)?;
    let report = Report {
        maps: args.maps.len(),
        cells_x: map.columns,
        cells_y: map.rows,
        resolution_m: map.resolution,
        corner_m: map.corner(),
        measured: map.measured(),
        file: &args.out,
    };
    let text = format!(
        "map        {} × {} cells of {} m from ({}, {}), {} measured\nfile       {}",
        map.columns,
        map.rows,
        map.resolution,
        report.corner_m[0],
        report.corner_m[1],
        report.measured,
        args.out.display()
    );
    console.result(&report, text)
}

/// Saved maps as one, cut.
pub fn joined(files: &[PathBuf], crop: Option<Crop>, console: &Console) -> Result<SavedMap> {
    let mut progress = console.progress("merge", Some(files.len() as u64));
    let mut all: Option<SavedMap> = None;
    for (i, file) in files.iter().enumerate() {
        let next = SavedMap::read(file)?;
        all = Some(match all {
            None => next,
            Some(map) => map.merged(&next).map_err(|e| Failure::file(file, e))?,
        });
        progress.set(i as u64 + 1, || "maps");
    }
    let map = all.ok_or_else(|| Failure::input("no maps"))?;
    crop.map_or(Ok(map.clone()), |Crop(rectangle)| map.crop(rectangle))
}
