//! NumPy arrays: rasters (2-D, row = y ascending, column = x ascending, NaN unknown) and
//! points (N × 3).

use super::{Dataset, Points, Raster, Spacing, atomic, open};
use crate::error::{Failure, Result};
use npyz::{AutoSerialize, NpyFile, Order, TypeChar, WriterBuilder};
use std::io::{self, BufRead, Read, Write};
use std::path::Path;

/// An array of any real type, in the order of C.
#[derive(Clone, Debug, PartialEq)]
pub struct Array {
    /// lengths of the axes
    pub shape: Vec<usize>,
    /// values, last axis fastest
    pub values: Vec<f64>,
}

/// Reads a raster, or points where the array is N × 3 and `spacing` is not given.
pub fn read(path: &Path, spacing: Option<Spacing>) -> Result<Dataset> {
    dataset(path, &read_array(path)?, spacing)
}

/// The raster or the points that an array of `path` is.
pub fn dataset(path: &Path, array: &Array, spacing: Option<Spacing>) -> Result<Dataset> {
    match (array.shape.as_slice(), spacing) {
        (&[_, 3], None) => points(path, array).map(Dataset::Points),
        (&[rows, columns], Some(spacing)) => {
            raster(path, [rows, columns], spacing, array).map(Dataset::Raster)
        }
        (&[_, _], None) => Err(Failure::file(
            path,
            "a 2-D array is a raster: give --spacing DX[,DY] in metres",
        )),
        (shape, _) => Err(Failure::file(
            path,
            format_args!("shape {shape:?}; a raster (2-D) or points (N × 3) are needed"),
        )),
    }
}

/// Reads an array of floats or integers.
pub fn read_array(path: &Path) -> Result<Array> {
    let (file, length) = open(path)?;
    parse(path, file, length)
}

/// Reads an array of `length` bytes; `path` is for messages.
pub fn parse(path: &Path, mut file: impl BufRead, length: u64) -> Result<Array> {
    check_header(path, &mut file)?;
    let npy = NpyFile::new(file).map_err(|e| Failure::file(path, e))?;
    let shape: Vec<usize> = npy.shape().iter().map(|&n| n as usize).collect();
    if npy.len() > length {
        return Err(Failure::file(
            path,
            format_args!("shape {shape:?} needs more than the file's {length} bytes"),
        ));
    }
    let order = npy.order();
    let values = to_f64(npy).map_err(|e| Failure::file(path, e))?;
    let values = if order == Order::Fortran {
        transpose(&shape, &values)
    } else {
        values
    };
    Ok(Array { shape, values })
}

/// Refuses headers whose shape cannot be counted, before they are parsed.
pub fn check_header(path: &Path, file: &mut impl BufRead) -> Result<()> {
    let start = file.fill_buf().map_err(|e| Failure::file(path, e))?;
    let header = String::from_utf8_lossy(&start[..start.len().min(4096)]);
    let shape = header
        .split("shape")
        .nth(1)
        .and_then(|s| s.split(')').next());
    let digits = shape
        .unwrap_or_default()
        .chars()
        .filter(char::is_ascii_digit)
        .count();
    if digits > 18 {
        return Err(Failure::file(path, "the header's shape is absurd"));
    }
    // versions 2 and 3 state the header's length in 32 bits
    if start.len() > 12 && start[6] > 1 && start[10..12] != [0, 0] {
        return Err(Failure::file(path, "the header is absurdly long"));
    }
    Ok(())
}

fn to_f64<R: Read>(npy: NpyFile<R>) -> io::Result<Vec<f64>> {
    let npyz::DType::Plain(kind) = npy.dtype() else {
        return Err(io::Error::other(
            "a structured array; a plain one is needed",
        ));
    };
    match (kind.type_char(), kind.size_field()) {
        (TypeChar::Float, 4) => convert(npy, f64::from as fn(f32) -> f64),
        (TypeChar::Float, 8) => npy.into_vec::<f64>(),
        (TypeChar::Int, 2) => convert(npy, f64::from as fn(i16) -> f64),
        (TypeChar::Int, 4) => convert(npy, f64::from as fn(i32) -> f64),
        (TypeChar::Int, 8) => convert(npy, |v: i64| v as f64),
        (TypeChar::Uint, 1) => convert(npy, f64::from as fn(u8) -> f64),
        (TypeChar::Uint, 2) => convert(npy, f64::from as fn(u16) -> f64),
        (TypeChar::Uint, 4) => convert(npy, f64::from as fn(u32) -> f64),
        _ => Err(io::Error::other(format!(
            "data type {kind}; floats or integers are needed"
        ))),
    }
}

fn convert<T: npyz::Deserialize, R: Read>(
    npy: NpyFile<R>,
    to: fn(T) -> f64,
) -> io::Result<Vec<f64>> {
    Ok(npy.into_vec::<T>()?.into_iter().map(to).collect())
}

/// From the order of Fortran to the order of C, 2-D arrays only (others are refused later).
fn transpose(shape: &[usize], values: &[f64]) -> Vec<f64> {
    let &[rows, columns] = shape else {
        return values.to_vec();
    };
    let at = |i: usize| values[i % columns * rows + i / columns];
    (0..rows * columns).map(at).collect()
}

fn points(path: &Path, array: &Array) -> Result<Points> {
    let xyz = array.values.chunks_exact(3).map(|p| [p[0], p[1], p[2]]);
    Points::of(path, xyz.collect())
}

fn raster(
    path: &Path,
    [rows, columns]: [usize; 2],
    spacing: Spacing,
    array: &Array,
) -> Result<Raster> {
    if rows < 2 || columns < 2 {
        return Err(Failure::file(
            path,
            format_args!("a raster of {rows} × {columns} nodes is too small"),
        ));
    }
    let finite = |&v: &f64| if v.is_finite() { v as f32 } else { f32::NAN };
    Ok(Raster {
        rows,
        columns,
        spacing_x: spacing.x,
        spacing_y: spacing.y,
        origin: [0.0, 0.0],
        values: array.values.iter().map(finite).collect(),
    })
}

/// Writes a 2-D float32 array, rows as they are.
pub fn write(path: &Path, rows: usize, columns: usize, values: &[f32]) -> Result<()> {
    atomic::write(path, |writer| {
        encode(writer, &[rows as u64, columns as u64], values)
    })
}

/// Encodes an array of any shape.
pub fn encode<T: AutoSerialize + Copy>(
    writer: &mut dyn Write,
    shape: &[u64],
    values: &[T],
) -> io::Result<()> {
    let mut npy = npyz::WriteOptions::new()
        .default_dtype()
        .shape(shape)
        .writer(writer)
        .begin_nd()?;
    npy.extend(values.iter().copied())?;
    npy.finish()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    #[test]
    fn a_raster_survives_the_round_trip() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.npy");
        write(&path, 2, 3, &[0.0, 1.0, 2.0, f32::NAN, 4.0, 5.5]).unwrap();
        let spacing = "0.5,2".parse().unwrap();
        let Dataset::Raster(raster) = read(&path, Some(spacing)).unwrap() else {
            panic!("not a raster")
        };
        assert_eq!((raster.rows, raster.columns), (2, 3));
        assert_eq!((raster.spacing_x, raster.spacing_y), (0.5, 2.0));
        assert_eq!(raster.at(1, 2), 5.5);
        assert!(raster.at(1, 0).is_nan());
        assert!(
            matches!(read(&path, None).unwrap(), Dataset::Points(p) if p.xyz.len() == 1 && p.skipped == 1)
        );
    }

    fn message(bytes: &[u8]) -> String {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.npy");
        fs::write(&path, bytes).unwrap();
        read(&path, None).unwrap_err().message
    }

    fn header(text: &str) -> Vec<u8> {
        let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
        bytes.extend((text.len() as u16).to_le_bytes());
        bytes.extend(text.as_bytes());
        bytes
    }

    #[test]
    fn malformed_files_are_refused() {
        let absurd = header(
            "{'descr': '<f4', 'fortran_order': False, 'shape': (99999999999, 99999999999), }\n",
        );
        assert!(message(&absurd).contains("absurd"));
        let huge =
            header("{'descr': '<f4', 'fortran_order': False, 'shape': (1000000, 1000000), }\n");
        assert!(message(&huge).contains("needs more than"));
        let short = header("{'descr': '<f8', 'fortran_order': False, 'shape': (4, 3), }\n");
        assert!(!message(&short).is_empty());
        let text = header("{'descr': '<U8', 'fortran_order': False, 'shape': (1, 3), }\n");
        assert!(!message(&text).is_empty());
        for bytes in [
            &b""[..],
            b"not numpy at all",
            b"\x93NUMPY",
            b"\x93NUMPY\x02\x00\xff\xff\xff\xff{}",
        ] {
            assert!(message(bytes).contains("a.npy"), "{bytes:?}");
        }
    }

    #[test]
    fn fortran_order_is_turned() {
        let mut bytes = header("{'descr': '<f4', 'fortran_order': True, 'shape': (2, 3), }\n");
        for v in [1f32, 4.0, 2.0, 5.0, 3.0, 6.0] {
            bytes.extend(v.to_le_bytes());
        }
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.npy");
        fs::write(&path, bytes).unwrap();
        assert_eq!(
            read_array(&path).unwrap().values,
            [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]
        );
    }
}
