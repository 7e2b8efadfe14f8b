//! The pictures of `docs/surfaces.md`: `cargo run --release -p rugosa-host --example
//! surface_pictures -- docs/img`.
//!
//! One crop of the Jacksboro DEM (tests/data), and what each model makes of a part of it.

use rand_xoshiro::Xoshiro128PlusPlus;
use rand_xoshiro::rand_core::SeedableRng;
use rugosa_fractal::codec::{decode, encode_to_size};
use rugosa_fractal::surfaces::Shape;
use rugosa_fractal::surfaces::ifs::{Options, fit};
use rugosa_fractal::surfaces::midpoint::*;
use rugosa_fractal::surfaces::rectangular::{Scale, Surface};
use rugosa_fractal::synthesis::normal;
use rugosa_host::draw::{Layer, maps};
use rugosa_host::error::{Failure, Result};
use rugosa_host::io::{Raster, npy};
use std::path::{Path, PathBuf};

/// Mean distance of two nodes of the DEM [m].
const SPACING: f64 = 83.0;

fn main() -> Result<()> {
    let folder = PathBuf::from(std::env::args().nth(1).unwrap_or("docs/img".into()));
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/data/jacksboro.npy");
    let dem = npy::read_array(&data)?;
    // the file's first row is the northernmost, a raster's the southernmost
    let crop = |side: usize| {
        let at = |i: usize| dem.values[(40 + side - 1 - i / side) * 403 + 80 + i % side] as f32;
        raster(side, (0..side * side).map(at).collect())
    };
    let truth = crop(129);
    let coarse = every(&truth, 4);
    let bilinear = interpolated(&coarse, 4, 0.0)?;
    let dense = densified(&coarse, 2)?;
    let fractal = interpolated(&coarse, 4, 0.2)?;
    draw(
        &folder.join("surfaces-detail.png"),
        &[
            ("129 x 129 nodes, truth", &truth),
            ("every 4th node, bilinear", &bilinear),
            ("every 4th node, densified (calibrated)", &dense),
            ("every 4th node, FIS with s = 0.2", &fractal),
        ],
    )?;
    let small = crop(82);
    let (ifs, deeper) = projected(&small)?;
    let coded = coded(&small, 948)?;
    draw(
        &folder.join("surfaces-bytes.png"),
        &[
            ("82 x 82 nodes, truth", &small),
            ("projected IFS, 948 bytes", &ifs),
            ("the same, tabulated 3 x finer", &deeper),
            ("codec, 948 bytes", &coded),
        ],
    )
}

fn raster(side: usize, values: Vec<f32>) -> Raster {
    Raster::square(side, side, SPACING, [0.0, 0.0], values)
}

fn every(fine: &Raster, step: usize) -> Raster {
    let side = (fine.rows - 1) / step + 1;
    let values = (0..side * side)
        .map(|i| fine.at(i / side * step, i % side * step))
        .collect();
    Raster {
        spacing_x: SPACING * step as f64,
        spacing_y: SPACING * step as f64,
        ..raster(side, values)
    }
}

fn interpolated(coarse: &Raster, step: usize, scale: f32) -> Result<Raster> {
    let lattice = Shape::new(coarse.rows, coarse.columns);
    let surface = Surface::new(
        &coarse.values,
        lattice,
        (step, step),
        Scale::Constant(scale),
    )
    .map_err(Failure::runtime)?;
    let mut values = vec![0.0; surface.shape().len()];
    surface.evaluate(&mut values).map_err(Failure::runtime)?;
    Ok(raster(surface.shape().rows, values))
}

fn densified(coarse: &Raster, levels: u32) -> Result<Raster> {
    let shape = Shape::new(coarse.rows, coarse.columns);
    let (step, fine) = (1 << levels, shape.finer(1 << levels));
    let mut grid = vec![f32::NAN; fine.len()];
    for (i, z) in coarse.values.iter().enumerate() {
        grid[i / coarse.columns * step * fine.columns + i % coarse.columns * step] = *z;
    }
    let mut entries = vec![Blend::default(); 64];
    let calibration = Calibration::measure(
        &coarse.values,
        shape,
        0.8,
        &mut Cache::new(&mut entries, Stencil::Kriged16),
    )
    .map_err(Failure::runtime)?;
    let settings = Midpoint {
        stencil: Stencil::Kriged16,
        noise: Noise::Calibrated(calibration),
        roughness: &|_, _| Roughness {
            hurst: 0.8,
            sigma: 1.0,
        },
        resolution: SPACING as f32,
    };
    let mut rng = Xoshiro128PlusPlus::seed_from_u64(1);
    settings
        .densify(
            &mut grid,
            fine,
            levels,
            (&mut || normal(&mut rng), &mut entries),
        )
        .map_err(Failure::runtime)?;
    Ok(raster(fine.rows, grid))
}

fn projected(truth: &Raster) -> Result<(Raster, Raster)> {
    let data: Vec<f64> = truth.values.iter().map(|&z| f64::from(z)).collect();
    let fitted = fit(
        &data,
        &Options {
            ridge: 1e-4,
            ..Options::default()
        },
        &[],
        &mut |_| {},
    )
    .map_err(Failure::runtime)?;
    let table = |depth: u32| {
        fitted
            .ifs
            .tabulate(depth)
            .into_iter()
            .map(|z| z as f32)
            .collect::<Vec<_>>()
    };
    let mut deeper = raster(244, table(5));
    (deeper.spacing_x, deeper.spacing_y) = (SPACING / 3.0, SPACING / 3.0);
    Ok((raster(82, table(4)), deeper))
}

fn coded(truth: &Raster, bytes: usize) -> Result<Raster> {
    let shape = Shape::new(truth.rows, truth.columns);
    let (mut work, mut out, mut back) =
        (vec![0; shape.len()], vec![0; bytes], vec![0.0; shape.len()]);
    let told = encode_to_size(&truth.values, shape, bytes, (&mut work, &mut out))
        .map_err(Failure::runtime)?;
    decode(&out[..told.bytes], (&mut work, &mut back)).map_err(Failure::runtime)?;
    Ok(raster(truth.rows, back))
}

fn draw(path: &Path, panels: &[(&str, &Raster)]) -> Result<()> {
    let truth = panels[0].1.range().unwrap_or((0.0, 1.0));
    let layers: Vec<Layer> = panels
        .iter()
        .map(|(title, raster)| Layer {
            range: Some((f64::from(truth.0), f64::from(truth.1))),
            ..Layer::elevation(title, raster)
        })
        .collect();
    maps(&layers)?.save(path)
}
