//! `rugosa dimension FILE`: fractal dimension of points or of a raster.

use crate::console::Console;
use crate::draw::StructurePlot;
use crate::draw::loglog::PowerLaw;
use crate::error::{Failure, Result};
use crate::io::output::Output;
use crate::io::{self, Dataset, Spacing, atomic};
use crate::scaling::Candidates;
use clap::ValueEnum;
use rugosa_fractal::roughness::irregular::{
    self, Estimate, Noise, Options, estimate_points, estimate_raster,
};
use rugosa_fractal::roughness::{Method, Reason, scaling_range};
use serde::Serialize;
use std::fmt;
use std::path::PathBuf;
use std::time::Instant;

/// Estimate the fractal dimension of irregular points or of a raster with holes.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  rugosa dimension scan.ply
  rugosa dimension points.csv --min-lag 0.2 --max-lag 3 --noise-std 0.01
  rugosa dimension dem.npy --spacing 0.1 --range all --json
  rugosa dimension dem.asc --explain
  rugosa dimension dem.asc --out dimension.png")]
pub struct Args {
    /// Points (.csv .xyz .ply .npy N×3) or a raster (.asc, .npy 2-D with --spacing)
    file: PathBuf,

    /// Distance between the nodes of a 2-D .npy, DX or DX,DY [m]
    #[arg(long)]
    spacing: Option<Spacing>,

    /// Shortest distance [m]
    #[arg(long, value_name = "M", value_parser = positive)]
    min_lag: Option<f64>,

    /// Longest distance [m]
    #[arg(long, value_name = "M", value_parser = positive)]
    max_lag: Option<f64>,

    /// Standard deviation of the heights' noise [m]; without it the noise is fitted too
    #[arg(long, value_name = "M", value_parser = not_negative)]
    noise_std: Option<f64>,

    /// E|Δz| (Yokoya 1989) or E Δz² (Pentland 1984)
    #[arg(long, value_enum, default_value_t = Moment::Pentland)]
    method: Moment,

    /// How the scaling range is found
    #[arg(long, value_enum, default_value_t = Range::Robust)]
    range: Range,

    /// Also print what was compared: the BIC table of the robust range, the polyline's segments
    #[arg(long)]
    explain: bool,

    /// Where the result goes: a directory, a .json file or a .png file (log–log plot)
    #[arg(long, value_name = "PATH")]
    out: Option<PathBuf>,
}

/// Which moment of the elevation differences is fitted.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Moment {
    /// E|Δz|
    Yokoya,
    /// E Δz²
    Pentland,
}

impl From<Moment> for Method {
    fn from(moment: Moment) -> Self {
        match moment {
            Moment::Yokoya => Method::Yokoya,
            Moment::Pentland => Method::Pentland,
        }
    }
}

/// How the scaling range is found.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Range {
    /// iterative least squares
    Lsq,
    /// segments of a minimax polyline
    Polyline,
    /// line and polynomial (Fang 2004)
    Fang,
    /// elongation criterion (Yokoya 1989)
    Elongation,
    /// longest range that a line describes as well as a curve
    Robust,
    /// every lag
    All,
}

impl From<Range> for scaling_range::Method {
    fn from(range: Range) -> Self {
        let tolerance = TOLERANCE;
        match range {
            Range::Lsq => scaling_range::Method::LeastSquares { tolerance },
            Range::Polyline => scaling_range::Method::Polyline { tolerance },
            Range::Fang => scaling_range::Method::Fang { guarded: true },
            Range::Elongation => scaling_range::Method::Elongation,
            Range::Robust => scaling_range::Method::Robust { tolerance },
            Range::All => scaling_range::Method::Whole,
        }
    }
}

/// Deviation from a line that still counts as one \[ln σ\].
const TOLERANCE: f64 = 0.02;

/// A positive length on the command line.
pub fn positive(text: &str) -> Result<f64, String> {
    number(text, |v| v > 0.0).ok_or_else(|| "a positive number of metres is needed".into())
}

/// A length that may be zero on the command line.
pub fn not_negative(text: &str) -> Result<f64, String> {
    number(text, |v| v >= 0.0).ok_or_else(|| "0 or a positive number of metres is needed".into())
}

fn number(text: &str, valid: impl Fn(f64) -> bool) -> Option<f64> {
    text.parse()
        .ok()
        .filter(|v: &f64| v.is_finite() && valid(*v))
}

#[derive(Serialize)]
struct Report {
    dimension: Option<f64>,
    hurst: Option<f64>,
    sigma: Option<f64>,
    standard_error: Option<f64>,
    noise_std: f64,
    scaling_range_m: Option<[f64; 2]>,
    residual: Option<f64>,
    pairs: u64,
    fractal: bool,
    clamped: bool,
    reason: Option<&'static str>,
    points: usize,
    points_skipped: usize,
    bins: Vec<Bin>,
    #[serde(skip_serializing_if = "Option::is_none")]
    candidates: Option<Candidates>,
    seconds: Seconds,
}

#[derive(Clone, Copy, Serialize)]
struct Bin {
    lag_m: f64,
    mean_abs_dz: Option<f64>,
    rms_dz: Option<f64>,
    pairs: u64,
}

#[derive(Clone, Copy, Serialize)]
struct Seconds {
    read: f64,
    estimate: f64,
}

/// Reads, estimates, prints.
pub fn run(args: &Args, console: &Console) -> Result<()> {
    if let Some((low, high)) = args
        .min_lag
        .zip(args.max_lag)
        .filter(|(low, high)| low >= high)
    {
        return Err(Failure::input(format_args!(
            "--max-lag {high} must be greater than --min-lag {low}"
        )));
    }
    let output = args.out.as_deref().map(Output::of);
    output
        .as_ref()
        .map_or(Ok(()), |o| o.check(&["json", "png"]))?;
    let started = Instant::now();
    let data = io::read(&args.file, args.spacing)?;
    let read = started.elapsed().as_secs_f64();
    let started = Instant::now();
    let progress = console.progress("estimating", None);
    let (estimate, points, points_skipped) = estimate(&data, &args.options());
    drop(progress);
    let seconds = Seconds {
        read,
        estimate: started.elapsed().as_secs_f64(),
    };
    let mut report = Report::new(&estimate, [points, points_skipped], seconds);
    if args.explain {
        report.candidates = Some(Candidates::new(&report.without_noise(), TOLERANCE));
    }
    match &output {
        Some(Output::File(path)) if io::extension(path) == "png" => {
            report.plot().draw()?.save(path)?
        }
        Some(Output::File(path)) => report.save(path)?,
        Some(directory) => {
            report.save(&directory.file("dimension.json"))?;
            report
                .plot()
                .draw()?
                .save(&directory.file("structure_function.png"))?;
        }
        None => {}
    }
    console.result(&report, &report)
}

fn estimate(data: &Dataset, options: &Options) -> (Estimate, usize, usize) {
    match data {
        Dataset::Points(points) => (
            estimate_points(&points.xyz, options),
            points.xyz.len(),
            points.skipped,
        ),
        Dataset::Raster(raster) => {
            let known = raster.known();
            let holes = raster.values.len() - known;
            let view = irregular::Raster {
                values: &raster.values,
                columns: raster.columns,
                spacing: [raster.spacing_x, raster.spacing_y],
            };
            (estimate_raster(&view, options), known, holes)
        }
    }
}

impl Args {
    fn options(&self) -> Options {
        Options {
            min_lag: self.min_lag,
            max_lag: self.max_lag,
            noise: self.noise_std.map_or(Noise::Fitted, Noise::Known),
            method: self.method.into(),
            range: self.range.into(),
        }
    }
}

fn words(reason: Reason) -> &'static str {
    match reason {
        Reason::TooFewPairs => "too few pairs: fewer than three lags have enough of them",
        Reason::Noise => "the differences are not larger than the noise",
        Reason::NoLine => "no three lags lie on a line in the log-log plot",
        Reason::Slope => "the slope of the log-log plot lies outside (0, 1)",
    }
}

impl Report {
    fn new(estimate: &Estimate, [points, points_skipped]: [usize; 2], seconds: Seconds) -> Self {
        let law = estimate.law.as_ref().ok();
        let finite = |v: f64| v.is_finite().then_some(v);
        let bin = |b: &irregular::Bin| Bin {
            lag_m: b.lag,
            mean_abs_dz: finite(b.mean_abs_dz),
            rms_dz: finite(b.rms_dz),
            pairs: b.pairs,
        };
        Report {
            dimension: law.map(|l| l.dimension),
            hurst: law.map(|l| l.hurst),
            sigma: law.map(|l| l.sigma),
            standard_error: law.map(|l| l.standard_error),
            noise_std: estimate.noise_std,
            scaling_range_m: law.map(|l| l.range),
            residual: law.map(|l| l.residual),
            pairs: law.map_or_else(|| estimate.bins.iter().map(|b| b.pairs).sum(), |l| l.pairs),
            fractal: law.is_some(),
            clamped: law.is_some_and(|l| l.clamped),
            reason: estimate.law.as_ref().err().copied().map(words),
            points,
            points_skipped,
            bins: estimate.bins.iter().map(bin).collect(),
            candidates: None,
            seconds,
        }
    }

    fn save(&self, path: &std::path::Path) -> Result<()> {
        atomic::write(path, |writer| {
            serde_json::to_writer_pretty(&mut *writer, self)?;
            writeln!(writer)
        })
    }

    /// (lag, rms difference) of the bins that have one.
    fn measured(&self) -> impl Iterator<Item = (f64, f64)> + '_ {
        let measured = self.bins.iter().filter_map(|b| Some((b.lag_m, b.rms_dz?)));
        measured.filter(|b| b.1 > 0.0)
    }

    /// The same with the heights' noise taken off.
    fn without_noise(&self) -> Vec<(f64, f64)> {
        let noise = 2.0 * self.noise_std * self.noise_std;
        self.measured()
            .map(|(lag, rms)| (lag, (rms * rms - noise).max(0.0).sqrt()))
            .filter(|b| b.1 > 0.0)
            .collect()
    }

    fn plot(&self) -> StructurePlot {
        StructurePlot {
            title: "Structure function".into(),
            corrected: match self.noise_std > 0.0 {
                true => self.without_noise(),
                false => Vec::new(),
            },
            measured: self.measured().collect(),
            fit: self
                .hurst
                .zip(self.sigma)
                .map(|(hurst, sigma)| PowerLaw { hurst, sigma }),
            scaling_range: self.scaling_range_m.map(Into::into),
            truth: None,
        }
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "points     {} ({} skipped or unknown)",
            self.points, self.points_skipped
        )?;
        match (
            self.dimension,
            self.hurst,
            self.sigma,
            self.standard_error,
            self.scaling_range_m,
        ) {
            (Some(dimension), Some(hurst), Some(sigma), Some(error), Some([low, high])) => {
                writeln!(
                    f,
                    "dimension  D = {dimension:.3} ± {error:.3}  (H = {hurst:.3})"
                )?;
                writeln!(f, "sigma      {sigma:.5} m at 1 m")?;
                writeln!(f, "range      {low:.4} … {high:.4} m, {} pairs", self.pairs)?;
                writeln!(
                    f,
                    "residual   {:.2} % of σ(d)",
                    100.0 * self.residual.unwrap_or_default()
                )?;
            }
            _ => writeln!(f, "dimension  none: {}", self.reason.unwrap_or("?"))?,
        }
        writeln!(f, "noise      {:.5} m", self.noise_std)?;
        if let Some(candidates) = &self.candidates {
            writeln!(f, "{candidates}")?;
        }
        write!(
            f,
            "time       {:.3} s reading, {:.4} s estimating",
            self.seconds.read, self.seconds.estimate
        )
    }
}
