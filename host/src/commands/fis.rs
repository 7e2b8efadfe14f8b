//! `rugosa fis`: a rectangular fractal interpolation surface through every T-th node.

use super::compress::{Quality, read_grid, write_grid};
use crate::console::Console;
use crate::error::{Failure, Result};
use crate::io::{Raster, Spacing};
use rugosa_fractal::surfaces::rectangular::{Base, Scale, Surface, dimension, scale_for_hurst};
use rugosa_fractal::surfaces::{Shape, SurfaceError};
use serde_json::json;
use std::path::PathBuf;
use std::str::FromStr;
use std::time::Instant;

/// Rebuild a raster from every T-th node with a fractal interpolation surface.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
The last row and column must be among the nodes: sides of the form k T + 1.
--scale: a number in (-1, 1); hurst: n^-H with --hurst; best: least squares;
tiles: least squares for every tile on a Coons base (continuous, straight tile edges).

Examples:
  rugosa fis dem.asc --step 8 --scale best --out surface.asc
  rugosa fis map.npy --step 16 --scale hurst --hurst 0.7 --out surface.npy --json")]
pub struct Args {
    /// Raster without holes: .asc or 2-D .npy
    file: PathBuf,
    /// Distance of the nodes that are kept, in samples
    #[arg(long, value_name = "T", value_parser = clap::value_parser!(u32).range(1..=4096))]
    step: u32,
    /// Vertical scale: a number, hurst, best or tiles
    #[arg(
        long,
        value_name = "S",
        default_value = "best",
        allow_hyphen_values = true
    )]
    scale: Choice,
    /// Hurst exponent for --scale hurst
    #[arg(long, value_name = "H", default_value_t = 0.7)]
    hurst: f32,
    /// Distance between nodes of a .npy [m]
    #[arg(long, value_name = "DX[,DY]")]
    spacing: Option<Spacing>,
    /// Raster to write: .npy or .asc
    #[arg(long, value_name = "G")]
    out: PathBuf,
}

/// Where the vertical scale comes from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Choice {
    /// given
    Value(f32),
    /// n^−H
    Hurst,
    /// least squares, one for all
    Best,
    /// least squares per tile on a Coons base
    Tiles,
}

impl FromStr for Choice {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Self, String> {
        match text {
            "hurst" => Ok(Choice::Hurst),
            "best" => Ok(Choice::Best),
            "tiles" => Ok(Choice::Tiles),
            number => match number.parse::<f32>() {
                Ok(s) if s.abs() < 1.0 => Ok(Choice::Value(s)),
                _ => Err(format!(
                    "'{number}' is not hurst, best, tiles or a number in (-1, 1)"
                )),
            },
        }
    }
}

/// Nodes and scales of a surface: what would have to be stored.
pub struct Model {
    /// node heights
    pub nodes: Vec<f32>,
    /// their number
    pub lattice: Shape,
    /// samples per tile
    pub tile: usize,
    /// one scale, or one per tile
    pub scales: Vec<f32>,
}

impl Model {
    /// Every `step`-th node of a raster and the scale that is asked for.
    pub fn of(
        raster: &Raster,
        step: usize,
        choice: Choice,
        hurst: f32,
    ) -> Result<Model, SurfaceError> {
        let shape = Shape::new(raster.rows, raster.columns);
        let lattice = shape.coarser(step).ok_or(SurfaceError::Size(shape))?;
        let at = |i: usize| (i / lattice.columns * step, i % lattice.columns * step);
        let nodes = (0..lattice.len())
            .map(|i| raster.at(at(i).0, at(i).1))
            .collect();
        let mut model = Model {
            nodes,
            lattice,
            tile: step,
            scales: vec![0.0],
        };
        let mut scratch = vec![0.0; shape.len()];
        match choice {
            Choice::Value(s) => model.scales = vec![s],
            Choice::Hurst => model.scales = vec![scale_for_hurst(model.tiles_per_side(), hurst)],
            Choice::Best => {
                model.scales = vec![model.surface()?.best_scale(&raster.values, &mut scratch)?];
            }
            Choice::Tiles => {
                let mut scales = vec![0.0; (lattice.rows - 1) * (lattice.columns - 1)];
                let coons = model.surface()?.on(Base::Coons);
                coons.best_tile_scales(&raster.values, &mut scratch, &mut scales)?;
                model.scales = scales;
            }
        }
        Ok(model)
    }

    /// The surface.
    pub fn surface(&self) -> Result<Surface<'_>, SurfaceError> {
        let tile = (self.tile, self.tile);
        match self.scales.as_slice() {
            &[s] => Surface::new(&self.nodes, self.lattice, tile, Scale::Constant(s)),
            scales => Ok(
                Surface::new(&self.nodes, self.lattice, tile, Scale::Tiles(scales))?
                    .on(Base::Coons),
            ),
        }
    }

    /// The surface as heights, and the passes it took.
    pub fn evaluate(&self) -> Result<(Vec<f32>, u32), SurfaceError> {
        let surface = self.surface()?;
        let mut out = vec![0.0; surface.shape().len()];
        let passes = surface.evaluate(&mut out)?;
        Ok((out, passes))
    }

    /// Bytes of nodes and scales as f32.
    pub fn bytes(&self) -> usize {
        4 * (self.nodes.len() + self.scales.len())
    }

    /// √(n_y n_x).
    pub fn tiles_per_side(&self) -> f32 {
        (((self.lattice.rows - 1) * (self.lattice.columns - 1)) as f32).sqrt()
    }
}

/// Rebuilds a raster.
pub fn run(args: &Args, console: &Console) -> Result<()> {
    let started = Instant::now();
    let raster = read_grid(&args.file, args.spacing)?;
    let failed = |e| Failure::file(&args.file, e);
    if args.scale == Choice::Hurst && !(args.hurst > 0.0 && args.hurst < 1.0) {
        return Err(Failure::input("--hurst must lie in (0, 1)"));
    }
    let step = args.step as usize;
    if Shape::new(raster.rows, raster.columns)
        .coarser(step)
        .is_none()
    {
        return Err(Failure::file(
            &args.file,
            format_args!(
                "{} × {} samples: with --step {step} sides of k · {step} + 1 are needed",
                raster.rows, raster.columns
            ),
        ));
    }
    let _progress = console.progress("fitting", None);
    let model = Model::of(&raster, step, args.scale, args.hurst).map_err(failed)?;
    let (values, passes) = model.evaluate().map_err(failed)?;
    let quality = Quality::of(&values, &raster.values);
    let mean = model.scales.iter().sum::<f32>() / model.scales.len() as f32;
    let fractal_dimension = dimension(model.tiles_per_side(), mean);
    if model.scales.len() == 1 && fractal_dimension == 2.0 {
        console.note("n |s| <= 1: the surface has dimension 2, it is not fractal");
    }
    write_grid(&args.out, &Raster { values, ..raster })?;
    let object = json!({
        "psnr": quality.psnr, "bytes": model.bytes(), "max_error": quality.max_error,
        "scale": mean, "scales": model.scales.len(), "passes": passes,
        "dimension": fractal_dimension, "nodes": [model.lattice.rows, model.lattice.columns],
        "seconds": started.elapsed().as_secs_f64(),
    });
    console.result(
        &object,
        format_args!(
            "{}: {} from {} × {} nodes ({} bytes), s = {mean:.4}, dimension {fractal_dimension:.3}",
            args.out.display(),
            quality,
            model.lattice.rows,
            model.lattice.columns,
            model.bytes(),
        ),
    )
}
