//! `rugosa compress` and `rugosa decompress`: rasters as few bytes.

use super::{fis, ifs};
use crate::console::Console;
use crate::error::{Failure, Result};
use crate::io::{Raster, Spacing, atomic, output, read_raster};
use clap::ValueEnum;
use rugosa_fractal::codec::{self, CodecError, Precision};
use rugosa_fractal::surfaces::Shape;
use rugosa_fractal::surfaces::ifs::{Mosaic, Options};
use serde_json::{Value, json};
use std::fmt;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Compress a raster of heights, with a bound on the error or on the size.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
wavelet (the default) is the one to use; fis and ifs are there for comparison: they have
no bound on the error and need more bytes for the same one.
A prefix of a compressed file decompresses to a coarser map.
--quick is for files and fast links: several times faster, and a fifth longer.

Examples:
  rugosa compress dem.asc --max-error 0.05 --out dem.rz
  rugosa compress dem.asc --max-error 0.05 --quick --out dem.rz
  rugosa compress map.npy --bytes 2000 --out map.rz --json
  rugosa compress crop.npy --bytes 1000 --model ifs --out crop.ifs")]
pub struct Args {
    /// Raster: .asc or 2-D .npy; NaN is unknown
    file: PathBuf,
    /// Largest error of any height [m]
    #[arg(
        long,
        value_name = "M",
        allow_negative_numbers = true,
        required_unless_present = "bytes",
        conflicts_with = "bytes"
    )]
    max_error: Option<f32>,
    /// Most bytes; the best quality within them
    #[arg(long, value_name = "N")]
    bytes: Option<usize>,
    /// Pack heights for speed instead of coding them well
    #[arg(long, conflicts_with_all = ["bytes", "model"])]
    quick: bool,
    /// How heights are modelled
    #[arg(long, value_enum, default_value_t = Model::Wavelet)]
    model: Model,
    /// File to write
    #[arg(long, value_name = "F")]
    out: PathBuf,
}

#[derive(Clone, Copy, Debug, PartialEq, ValueEnum)]
enum Model {
    /// integer wavelet and context coder
    Wavelet,
    /// fractal interpolation surface through every T-th node, best scale
    Fis,
    /// projected IFS, 232 parameters per patch
    Ifs,
}

/// Decompress what `rugosa compress` wrote.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  rugosa decompress dem.rz --out dem.npy
  rugosa decompress dem.rz --out dem.asc --spacing 0.1 --json")]
pub struct DecompressArgs {
    /// A compressed file, or the beginning of one
    file: PathBuf,
    /// Distance between nodes in an .asc [m]
    #[arg(long, value_name = "DX[,DY]")]
    spacing: Option<Spacing>,
    /// Raster to write: .npy or .asc
    #[arg(long, value_name = "G")]
    out: PathBuf,
}

/// Reads a raster; heights do not depend on the spacing, so a `.npy` needs none.
pub fn read_grid(path: &Path, spacing: Option<Spacing>) -> Result<Raster> {
    read_raster(path, Some(spacing.unwrap_or(Spacing { x: 1.0, y: 1.0 })))
}

/// Reads a raster for a model that cannot have holes.
pub fn read_whole_grid(path: &Path, spacing: Option<Spacing>) -> Result<Raster> {
    let raster = read_grid(path, spacing)?;
    match raster.values.iter().position(|z| !z.is_finite()) {
        Some(i) => Err(Failure::file(
            path,
            format_args!(
                "node ({}, {}) is unknown (row, column from 0): this model needs a raster without holes",
                i / raster.columns,
                i % raster.columns
            ),
        )),
        None => Ok(raster),
    }
}

/// Writes a raster as `.npy` or `.asc`.
pub fn write_grid(path: &Path, raster: &Raster) -> Result<()> {
    output::write_raster(path, raster)
}

/// 2^levels.
pub fn factor(levels: u32) -> u32 {
    1 << levels
}

/// How well one raster stands for another.
#[derive(Clone, Copy, Debug)]
pub struct Quality {
    /// 20 lg (relief of the original / rms error) \[dB\]; `None` where nothing differs
    pub psnr: Option<f64>,
    /// largest difference \[m\]
    pub max_error: f64,
}

impl Quality {
    /// Of known heights.
    pub fn of(found: &[f32], original: &[f32]) -> Quality {
        let (mut low, mut high) = (f64::MAX, f64::MIN);
        let (mut squares, mut largest, mut count) = (0.0, 0.0f64, 0u32);
        for (&a, &b) in found.iter().zip(original).filter(|(_, b)| b.is_finite()) {
            let (a, b) = (f64::from(a), f64::from(b));
            (low, high) = (low.min(b), high.max(b));
            squares += (a - b) * (a - b);
            largest = largest.max((a - b).abs());
            count += 1;
        }
        let rms = (squares / f64::from(count.max(1))).sqrt();
        let psnr = (rms > 0.0).then(|| 20.0 * ((high - low) / rms).log10());
        Quality {
            psnr: psnr.filter(|p| p.is_finite()),
            max_error: largest,
        }
    }
}

impl fmt::Display for Quality {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.psnr {
            Some(psnr) => write!(f, "{psnr:.2} dB, largest error {:.4} m", self.max_error),
            None => write!(f, "exact"),
        }
    }
}

/// Compresses a raster.
pub fn run(args: &Args, console: &Console) -> Result<()> {
    let raster = match args.model {
        Model::Wavelet => read_grid(&args.file, None)?,
        Model::Fis | Model::Ifs => read_whole_grid(&args.file, None)?,
    };
    if args
        .max_error
        .is_some_and(|bound| !(bound > 0.0 && bound.is_finite()))
    {
        return Err(Failure::input("--max-error must be above 0"));
    }
    let started = Instant::now();
    let _progress = console.progress("compressing", None);
    let (bytes, found) = match args.model {
        Model::Wavelet => wavelet(args, &raster)?,
        Model::Fis => interpolation(args, &raster)?,
        Model::Ifs => functions(args, &raster, console)?,
    };
    let seconds = started.elapsed().as_secs_f64();
    let quality = Quality::of(&found, &raster.values);
    atomic::write(&args.out, |w| w.write_all(&bytes))?;
    let raw = 4 * raster.values.len();
    let object = json!({
        "bytes": bytes.len(), "psnr": quality.psnr, "max_error": quality.max_error, "seconds": seconds,
        "raw_bytes": raw, "rows": raster.rows, "columns": raster.columns,
    });
    console.result(
        &object,
        format_args!(
            "{}: {} bytes ({:.1} % of float32), {quality}",
            args.out.display(),
            bytes.len(),
            100.0 * bytes.len() as f64 / raw as f64
        ),
    )
}

/// The codec's bytes and what they decode to.
fn wavelet(args: &Args, raster: &Raster) -> Result<(Vec<u8>, Vec<f32>)> {
    let failed = |e: CodecError| Failure::file(&args.file, e);
    let shape = Shape::new(raster.rows, raster.columns);
    let mut work = vec![0; shape.len()];
    let mut out = vec![0; shape.len() * 6 + 1024];
    let lent = (work.as_mut_slice(), out.as_mut_slice());
    let told = match (args.max_error, args.bytes) {
        (Some(bound), _) if args.quick => codec::encode_quickly(&raster.values, shape, bound, lent),
        (Some(bound), _) => codec::encode_within(&raster.values, shape, bound, lent),
        (None, Some(bytes)) => codec::encode_to_size(&raster.values, shape, bytes, lent),
        (None, None) => codec::encode(&raster.values, shape, Precision::Within(0.001), lent),
    };
    out.truncate(told.map_err(failed)?.bytes);
    let mut found = vec![0.0; shape.len()];
    codec::decode(&out, (&mut work, &mut found)).map_err(failed)?;
    Ok((out, found))
}

fn needs_bytes(args: &Args) -> Result<usize> {
    args.bytes.ok_or(Failure::input(
        "--model fis and ifs have no bound on the error: give --bytes instead of --max-error",
    ))
}

/// The smallest step whose nodes fit.
fn interpolation(args: &Args, raster: &Raster) -> Result<(Vec<u8>, Vec<f32>)> {
    let limit = needs_bytes(args)?;
    let failed = |e| Failure::file(&args.file, e);
    let shape = Shape::new(raster.rows, raster.columns);
    let fits = |step: &usize| {
        shape
            .coarser(*step)
            .is_some_and(|l| l.rows > 1 && l.columns > 1 && 4 * l.len() + FIS_EXTRA <= limit)
    };
    let step = (1..shape.rows.min(shape.columns))
        .find(fits)
        .ok_or_else(|| {
            Failure::file(
                &args.file,
                format_args!(
                    "no lattice of nodes within {limit} bytes reaches the last row and column"
                ),
            )
        })?;
    let model = fis::Model::of(raster, step, fis::Choice::Best, 0.5).map_err(failed)?;
    let (found, _) = model.evaluate().map_err(failed)?;
    Ok((fis_bytes(&model), found))
}

/// The largest patches whose parameters fit.
fn functions(args: &Args, raster: &Raster, console: &Console) -> Result<(Vec<u8>, Vec<f32>)> {
    let limit = needs_bytes(args)?;
    let depth = ifs::depth(raster, None).map_err(|m| Failure::file(&args.file, m))?;
    let (mosaic, _) = ifs::fit_raster(raster, depth, &Options::default(), console)
        .map_err(|e| Failure::file(&args.file, e))?;
    let bytes = mosaic.to_bytes();
    if bytes.len() > limit {
        return Err(Failure::file(
            &args.file,
            format_args!("its patches need {} bytes", bytes.len()),
        ));
    }
    // through the file: its parameters are rounded to f32
    let rounded = Mosaic::from_bytes(&bytes).map_err(|e| Failure::file(&args.out, e))?;
    Ok((bytes, ifs::heights(&rounded, depth).values))
}

/// "RFIS", version, three spare bytes, node rows and columns, tile, scale, nodes, CRC-32.
const FIS_EXTRA: usize = 8 + 16 + 4;

fn fis_bytes(model: &fis::Model) -> Vec<u8> {
    let mut bytes = b"RFIS\x01\0\0\0".to_vec();
    for n in [model.lattice.rows, model.lattice.columns, model.tile] {
        bytes.extend((n as u32).to_le_bytes());
    }
    bytes.extend(model.scales.values()[0].to_le_bytes());
    bytes.extend(model.nodes.iter().flat_map(|z| z.to_le_bytes()));
    let sum = CRC.checksum(&bytes);
    bytes.extend(sum.to_le_bytes());
    bytes
}

const CRC: crc::Crc<u32> = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC);

fn read_fis(path: &Path, bytes: &[u8]) -> Result<Raster> {
    let failed = |m: &str| Failure::file(path, m);
    let word = |at: usize| {
        bytes
            .get(at..at + 4)
            .and_then(|b| b.try_into().ok())
            .map_or(0, u32::from_le_bytes)
    };
    let (rows, columns, tile) = (word(8) as usize, word(12) as usize, word(16) as usize);
    let needed = rows
        .saturating_mul(columns)
        .saturating_mul(4)
        .saturating_add(FIS_EXTRA);
    if bytes.len() != needed {
        return Err(failed("fractal interpolation surface: wrong length"));
    }
    let (body, sum) = bytes.split_at(needed - 4);
    if CRC.checksum(body).to_le_bytes() != sum {
        return Err(failed(
            "fractal interpolation surface: wrong checksum, the file is damaged",
        ));
    }
    let side = rows.max(columns).saturating_mul(tile);
    if bytes[4] != 1 || side.saturating_mul(side) > 1 << 30 {
        return Err(failed(
            "fractal interpolation surface: unknown version or absurd size",
        ));
    }
    let (nodes, _) = body[24..].as_chunks::<4>();
    let model = fis::Model {
        nodes: nodes.iter().map(|b| f32::from_le_bytes(*b)).collect(),
        lattice: Shape::new(rows, columns),
        tile,
        scales: fis::Scales::Constant(f32::from_bits(word(20))),
    };
    let (values, _) = model.evaluate().map_err(|e| Failure::file(path, e))?;
    let shape = model.lattice.finer(tile);
    Ok(Raster::square(
        shape.rows,
        shape.columns,
        1.0,
        [0.0, 0.0],
        values,
    ))
}

/// Decompresses a file.
pub fn run_decompress(args: &DecompressArgs, console: &Console) -> Result<()> {
    let bytes = std::fs::read(&args.file).map_err(|e| Failure::file(&args.file, e))?;
    let started = Instant::now();
    let (mut raster, told) = match bytes.get(..4) {
        Some(b"RIFS") => (mosaic(&args.file, &bytes)?, json!({})),
        Some(b"RFIS") => (read_fis(&args.file, &bytes)?, json!({})),
        _ => decode(args, &bytes, console)?,
    };
    let seconds = started.elapsed().as_secs_f64();
    if let Some(spacing) = args.spacing {
        (raster.spacing_x, raster.spacing_y) = (spacing.x, spacing.y);
    }
    write_grid(&args.out, &raster)?;
    let mut object = json!({
        "bytes": bytes.len(), "psnr": Value::Null, "max_error": Value::Null, "seconds": seconds,
        "rows": raster.rows, "columns": raster.columns, "step": 1,
    });
    if let (Some(object), Some(told)) = (object.as_object_mut(), told.as_object()) {
        object.extend(told.clone());
    }
    console.result(
        &object,
        format_args!(
            "{}: {} × {} nodes",
            args.out.display(),
            raster.rows,
            raster.columns
        ),
    )
}

fn mosaic(path: &Path, bytes: &[u8]) -> Result<Raster> {
    let mosaic = Mosaic::from_bytes(bytes).map_err(|e| Failure::file(path, e))?;
    Ok(ifs::heights(&mosaic, mosaic.depth()))
}

fn decode(args: &DecompressArgs, bytes: &[u8], console: &Console) -> Result<(Raster, Value)> {
    let failed = |e: CodecError| Failure::file(&args.file, e);
    let header = codec::Header::read(bytes).map_err(failed)?;
    let mut work = vec![0; header.shape.len()];
    let mut out = vec![0.0; header.shape.len()];
    let told = codec::decode(bytes, (&mut work, &mut out)).map_err(failed)?;
    out.truncate(told.shape.len());
    if told.step > 1 {
        console.note(format_args!(
            "{}: {} of {} bytes: a coarser map, every {}th node",
            args.file.display(),
            bytes.len(),
            header.length,
            told.step
        ));
    }
    let known = out.iter().filter(|z| z.is_finite());
    let (low, high) = known.fold((f32::MAX, f32::MIN), |m, &z| (m.0.min(z), m.1.max(z)));
    let bound = if told.step == 1 {
        json!(header.max_error)
    } else {
        Value::Null
    };
    let object = json!({ "max_error": bound, "step": told.step, "low": low.min(high), "high": high.max(low) });
    let raster = Raster::square(
        told.shape.rows,
        told.shape.columns,
        told.step as f64,
        [0.0, 0.0],
        out,
    );
    Ok((raster, object))
}
