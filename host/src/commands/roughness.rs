//! `rugosa roughness RASTER`: local D, H, σ, standard error and R² in moving windows.

use super::dimension::{Moment, Range, not_negative, positive};
use crate::console::Console;
use crate::draw::{self, Layer};
use crate::error::{Failure, Result};
use crate::io::output::{Output, write_raster};
use crate::io::{self, Raster, Spacing};
use crate::windows::{Local, Windows};
use rugosa_fractal::roughness::irregular::{Noise, Options};
use serde::Serialize;
use std::path::PathBuf;
use std::time::Instant;

/// Local fractal dimension, Hurst exponent, σ, standard error and R² of a raster, in
/// moving windows; unknown nodes are allowed anywhere.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  rugosa roughness dem.asc --out local
  rugosa roughness dem.npy --spacing 0.01 --window 0.64 --step 0.08 --out dimension.npy
  rugosa roughness dem.asc --out dimension.png")]
pub struct Args {
    /// A raster (.asc, or .npy 2-D with --spacing)
    file: PathBuf,

    /// Distance between the nodes of a .npy, DX or DX,DY [m]
    #[arg(long)]
    spacing: Option<Spacing>,

    /// Edge of a window [m]; without it 48 nodes
    #[arg(long, value_name = "M", value_parser = positive)]
    window: Option<f64>,

    /// From one window to the next [m]; without it an eighth of a window
    #[arg(long, value_name = "M", value_parser = positive)]
    step: Option<f64>,

    /// Shortest distance [m]; without it one node
    #[arg(long, value_name = "M", value_parser = positive)]
    min_lag: Option<f64>,

    /// Longest distance [m]; without it a sixth of a window
    #[arg(long, value_name = "M", value_parser = positive)]
    max_lag: Option<f64>,

    /// Standard deviation of the heights' noise [m]
    #[arg(long, value_name = "M", value_parser = not_negative, default_value_t = 0.0)]
    noise_std: f64,

    /// E|Δz| (Yokoya 1989) or E Δz² (Pentland 1984)
    #[arg(long, value_enum, default_value_t = Moment::Pentland)]
    method: Moment,

    /// How the scaling range is found
    #[arg(long, value_enum, default_value_t = Range::All)]
    range: Range,

    /// A directory for all layers, or a .npy, .asc or .png file for the dimension
    #[arg(long, value_name = "PATH")]
    out: PathBuf,
}

/// A quantity of a window: name, unit, and how to get it.
type Quantity = (&'static str, &'static str, fn(&Local) -> f32);

const QUANTITIES: [Quantity; 5] = [
    ("dimension", "", |l| l.dimension),
    ("hurst", "", |l| l.hurst),
    ("sigma", "m", |l| l.sigma),
    ("standard_error", "", |l| l.standard_error),
    ("r2", "", |l| l.r2),
];

#[derive(Serialize)]
struct Report {
    window_nodes: usize,
    step_nodes: usize,
    rows: usize,
    columns: usize,
    windows: usize,
    estimated: usize,
    median_dimension: Option<f32>,
    files: Vec<PathBuf>,
    seconds: f64,
}

/// Reads, estimates, writes.
pub fn run(args: &Args, console: &Console) -> Result<()> {
    let output = Output::of(&args.out);
    output.check(&["npy", "asc", "png"])?;
    let raster = io::read_raster(&args.file, args.spacing)?;
    let windows = args.windows(&raster)?;
    let options = args.options(&raster, &windows);
    let (rows, columns) = (windows.along(raster.rows), windows.along(raster.columns));
    if rows * columns == 0 {
        return Err(Failure::file(
            &args.file,
            format_args!(
                "{} × {} nodes; a window of {} nodes does not fit",
                raster.rows, raster.columns, windows.side
            ),
        ));
    }
    let started = Instant::now();
    let mut progress = console.progress("roughness", Some((rows * columns) as u64));
    let locals = windows.estimate(&raster, &options, |done| {
        progress.set(done as u64, || "windows")
    });
    drop(progress);
    let seconds = started.elapsed().as_secs_f64();
    let maps: Vec<(Quantity, Raster)> = QUANTITIES
        .iter()
        .map(|&q| (q, windows.raster(&raster, &locals, q.2)))
        .collect();
    let files = save(&output, &maps)?;
    let median = median(&locals);
    let report = Report {
        window_nodes: windows.side,
        step_nodes: windows.step,
        rows,
        columns,
        windows: locals.len(),
        estimated: locals.iter().filter(|l| l.dimension.is_finite()).count(),
        median_dimension: median,
        files,
        seconds,
    };
    console.result(&report, text(&report))
}

impl Args {
    fn windows(&self, raster: &Raster) -> Result<Windows> {
        let spacing = raster.spacing_x.max(raster.spacing_y);
        let nodes = |metres: f64| (metres / spacing).round() as usize;
        let side = self.window.map_or(48, nodes);
        if side < 8 {
            return Err(Failure::input(format_args!(
                "--window: {side} nodes; 8 or more are needed"
            )));
        }
        let step = self.step.map_or(side / 8, nodes).max(1);
        Ok(Windows { side, step })
    }

    fn options(&self, raster: &Raster, windows: &Windows) -> Options {
        let spacing = raster.spacing_x.min(raster.spacing_y);
        Options {
            min_lag: Some(self.min_lag.unwrap_or(spacing)),
            max_lag: Some(
                self.max_lag
                    .unwrap_or(spacing * (windows.side as f64 / 6.0).max(4.0)),
            ),
            noise: Noise::Known(self.noise_std),
            method: self.method.into(),
            range: self.range.into(),
        }
    }
}

fn save(output: &Output, maps: &[(Quantity, Raster)]) -> Result<Vec<PathBuf>> {
    if let Output::File(path) = output {
        let dimension = &maps[0].1;
        match io::extension(path).as_str() {
            "png" => draw::maps(&[Layer::dimension("Local fractal dimension D", dimension)])?
                .save(path)?,
            _ => write_raster(path, dimension)?,
        }
        return Ok(vec![path.clone()]);
    }
    let mut files = Vec::new();
    for ((name, ..), map) in maps {
        let path = output.file(&format!("{name}.npy"));
        write_raster(&path, map)?;
        files.push(path);
    }
    let path = output.file("roughness.png");
    picture(maps)?.save(&path)?;
    files.push(path);
    Ok(files)
}

fn picture(maps: &[(Quantity, Raster)]) -> Result<draw::Picture> {
    let sigma = Layer::magnitude("Roughness σ (1 m)", maps[2].0.1, &maps[2].1);
    let error = Layer::magnitude("Standard error of D", "", &maps[3].1);
    draw::maps(&[
        Layer::dimension("Local fractal dimension D", &maps[0].1),
        sigma,
        error,
    ])
}

fn median(locals: &[Local]) -> Option<f32> {
    let mut known: Vec<f32> = locals
        .iter()
        .map(|l| l.dimension)
        .filter(|d| d.is_finite())
        .collect();
    known.sort_by(f32::total_cmp);
    known.get(known.len() / 2).copied()
}

fn text(report: &Report) -> String {
    let files: Vec<String> = report
        .files
        .iter()
        .map(|f| f.display().to_string())
        .collect();
    let median = report
        .median_dimension
        .map_or("none".into(), |d| format!("{d:.3}"));
    format!(
        "windows    {} × {} of {} nodes, {} nodes apart; {} of {} have a dimension\nmedian D   {median}\ntime       {:.2} s\nfiles      {}",
        report.rows,
        report.columns,
        report.window_nodes,
        report.step_nodes,
        report.estimated,
        report.windows,
        report.seconds,
        files.join("\n           ")
    )
}
