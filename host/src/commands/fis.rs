//! `rugosa fis`: a rectangular fractal interpolation surface through every T-th node.

use super::compress::{Quality, read_whole_grid, write_grid};
use crate::console::Console;
use crate::error::{Failure, Result};
use crate::io::{Raster, Spacing};
use rugosa_fractal::surfaces::rectangular::{
    Base, Equation, Scale, Surface, dimension, scale_for_hurst,
};
use rugosa_fractal::surfaces::{Shape, SurfaceError};
use serde_json::json;
use std::path::PathBuf;
use std::str::FromStr;
use std::time::Instant;

/// Rebuild a raster from every T-th node with a fractal interpolation surface.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
The last row and column must be among the nodes: sides of the form k T + 1.
--scale: a number in (-1, 1); hurst: n^-H with --hurst; best: least squares, one for all;
field: least squares, one per node, bilinear between them (continuous);
tiles: least squares, one per tile on a Coons base (continuous, straight tile edges).

Examples:
  rugosa fis dem.asc --step 8 --scale best --out surface.asc
  rugosa fis map.npy --step 16 --scale hurst --hurst 0.7 --out surface.npy --json")]
pub struct Args {
    /// Raster without holes: .asc or 2-D .npy
    file: PathBuf,
    /// Distance of the nodes that are kept, in samples
    #[arg(long, value_name = "T", value_parser = clap::value_parser!(u32).range(1..=4096))]
    step: u32,
    /// Vertical scale: a number, hurst, best, field or tiles
    #[arg(
        long,
        value_name = "S",
        default_value = "best",
        allow_hyphen_values = true
    )]
    scale: Choice,
    /// Hurst exponent for --scale hurst
    #[arg(
        long,
        value_name = "H",
        default_value_t = 0.7,
        allow_negative_numbers = true
    )]
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
    /// least squares, a continuous field
    Field,
    /// least squares per tile on a Coons base
    Tiles,
}

impl FromStr for Choice {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Self, String> {
        match text {
            "hurst" => Ok(Choice::Hurst),
            "best" => Ok(Choice::Best),
            "field" => Ok(Choice::Field),
            "tiles" => Ok(Choice::Tiles),
            number => match number.parse::<f32>() {
                Ok(s) if s.abs() < 1.0 => Ok(Choice::Value(s)),
                _ => Err(format!(
                    "'{number}' is not hurst, best, field, tiles or a number in (-1, 1)"
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
    /// vertical scales
    pub scales: Scales,
}

/// Vertical scales, owned.
#[derive(Debug)]
pub enum Scales {
    /// the same everywhere
    Constant(f32),
    /// one per node, bilinear between them
    Nodes(Vec<f32>),
    /// one per tile, on a Coons base
    Tiles(Vec<f32>),
}

impl Scales {
    /// The values.
    pub fn values(&self) -> &[f32] {
        match self {
            Scales::Constant(s) => std::slice::from_ref(s),
            Scales::Nodes(s) | Scales::Tiles(s) => s,
        }
    }

    /// Mean of |s|, which the dimension depends on: n² mean |s| = Σ |s_i|.
    fn mean_size(&self) -> f32 {
        let values = self.values();
        values.iter().map(|s| s.abs()).sum::<f32>() / values.len() as f32
    }
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
            scales: Scales::Constant(0.0),
        };
        model.scales = match choice {
            Choice::Value(s) => Scales::Constant(s),
            Choice::Hurst => Scales::Constant(scale_for_hurst(model.tiles_per_side(), hurst)),
            _ => model.fitted(choice, &raster.values)?,
        };
        Ok(model)
    }

    /// The scales that fit `data` best.
    fn fitted(&self, choice: Choice, data: &[f32]) -> Result<Scales, SurfaceError> {
        let (flat, mut scratch) = (self.surface()?, vec![0.0; data.len()]);
        match choice {
            Choice::Tiles => {
                let mut scales = vec![0.0; flat.tiles().0 * flat.tiles().1];
                let coons = flat.on(Base::Coons);
                coons.best_tile_scales(data, &mut scratch, &mut scales)?;
                Ok(Scales::Tiles(scales))
            }
            Choice::Field => {
                let mut scales = vec![0.0; self.nodes.len()];
                let mut equations = vec![Equation::default(); self.nodes.len()];
                let lent = (scratch.as_mut_slice(), equations.as_mut_slice());
                flat.best_node_scales(data, lent, &mut scales)?;
                Ok(Scales::Nodes(scales))
            }
            _ => Ok(Scales::Constant(flat.best_scale(data, &mut scratch)?)),
        }
    }

    /// The surface.
    pub fn surface(&self) -> Result<Surface<'_>, SurfaceError> {
        let (scale, base) = match &self.scales {
            Scales::Constant(s) => (Scale::Constant(*s), Base::Corners),
            Scales::Nodes(s) => (Scale::Nodes(s), Base::Corners),
            Scales::Tiles(s) => (Scale::Tiles(s), Base::Coons),
        };
        let tile = (self.tile, self.tile);
        Ok(Surface::new(&self.nodes, self.lattice, tile, scale)?.on(base))
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
        4 * (self.nodes.len() + self.scales.values().len())
    }

    /// √(n_y n_x).
    pub fn tiles_per_side(&self) -> f32 {
        (((self.lattice.rows - 1) * (self.lattice.columns - 1)) as f32).sqrt()
    }
}

/// Rebuilds a raster.
pub fn run(args: &Args, console: &Console) -> Result<()> {
    let started = Instant::now();
    let raster = read_whole_grid(&args.file, args.spacing)?;
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
    let scales = model.scales.values();
    let mean = scales.iter().sum::<f32>() / scales.len() as f32;
    let fractal_dimension = dimension(model.tiles_per_side(), model.scales.mean_size());
    if fractal_dimension == 2.0 {
        console.note("n |s| <= 1: the surface has dimension 2, it is not fractal");
    }
    write_grid(&args.out, &Raster { values, ..raster })?;
    let object = json!({
        "psnr": quality.psnr, "bytes": model.bytes(), "max_error": quality.max_error,
        "scale": mean, "scales": scales.len(), "passes": passes,
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
