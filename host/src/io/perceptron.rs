//! Range images of a Perceptron laser range finder, in the form of the University of
//! South Florida range image database.
//!
//! Ten lines of text, of which two say `rows: R` and `columns: C`, an empty line, then
//! R × C big-endian words of 32 bits whose low 12 bits are the range count; count 0 is no
//! return. The image fills the published field of view (51.65° × 36.73°) whatever its
//! number of pixels; the published geometry is that of [`rugosa_terrain::Geometry`].
//!
//! Points are in the frame of the sensor, x forward, y left, z up, metres. The header
//! does not say how the sensor stood; it is taken as level.

use super::{Points, open};
use crate::error::{Failure, Result};
use rugosa_terrain::{Beams, Geometry, LineTrig, PerceptronConstants, Raster, Trig};
use std::io::Read;
use std::path::Path;

/// Field of view along a line and across the lines \[degrees\].
const FIELD: [f64; 2] = [51.65, 36.73];
/// Longest header in bytes, and greatest number of rows or columns.
const MOST: usize = 4096;

/// Reads the points of an image.
pub fn read(path: &Path) -> Result<Points> {
    let (mut file, length) = open(path)?;
    let most = (4 * MOST * MOST + MOST) as u64;
    if length > most {
        return Err(Failure::file(
            path,
            format_args!("{length} bytes are too many for an image"),
        ));
    }
    let mut bytes = Vec::new();
    file.read_to_end(&mut bytes)
        .map_err(|e| Failure::file(path, e))?;
    let header = String::from_utf8_lossy(&bytes[..bytes.len().min(MOST)]).into_owned();
    let [rows, columns] = [
        size(path, &header, "rows")?,
        size(path, &header, "columns")?,
    ];
    let pixels = 4 * rows * columns;
    let start = bytes.len().checked_sub(pixels);
    let start = start
        .filter(|&start| ends_header(&bytes[..start]))
        .ok_or_else(|| {
            let message = format_args!("{length} bytes do not fit {rows} × {columns} pixels");
            Failure::file(path, message)
        })?;
    let counts: Vec<u16> = bytes[start..]
        .chunks_exact(4)
        .map(|word| u16::from_be_bytes([word[2] & 0x0f, word[3]]))
        .collect();
    Points::of(path, points(&counts, rows, columns))
}

/// Is this the beginning of such an image?
pub fn is_one(start: &[u8]) -> bool {
    start.starts_with(b"rows:")
}

/// Ten lines and an empty one of two bytes.
fn ends_header(start: &[u8]) -> bool {
    let is_end = |&&byte: &&u8| byte == b'\n' || byte == b'\r';
    let lines = start.iter().filter(|&&byte| byte == b'\n').count();
    start.len() <= MOST && lines > 10 && start.iter().rev().take(2).filter(is_end).count() == 2
}

fn size(path: &Path, header: &str, name: &str) -> Result<usize> {
    let lines = header.lines().take(10);
    let mut values = lines.filter_map(|line| line.trim().strip_prefix(name)?.strip_prefix(':'));
    let value = values.next().unwrap_or_default().trim();
    let number = value.parse().ok().filter(|n| (1..=MOST).contains(n));
    let message = format_args!("header: '{name}: 1 … {MOST}' is needed, not '{value}'");
    number.ok_or_else(|| Failure::file(path, message))
}

/// One point per pixel; NaN where nothing came back.
fn points(counts: &[u16], rows: usize, columns: usize) -> Vec<[f64; 3]> {
    let axis = |degrees: f64, n: usize| {
        let step = degrees.to_radians() / n as f64;
        [(0.5 * (n as f64 - 1.0) * step) as f32, -step as f32]
    };
    let raster = Raster {
        azimuth: axis(FIELD[0], columns),
        inclination: axis(FIELD[1], rows),
    };
    let geometry = Geometry::Perceptron(PerceptronConstants::PUBLISHED);
    let (mut by_column, mut by_line) = (vec![Trig::ZERO; columns], vec![LineTrig::ZERO; rows]);
    let beams = Beams::new(geometry, raster, &mut by_column, &mut by_line);
    let point = |(i, &count): (usize, &u16)| {
        let range = f32::from(count) * PerceptronConstants::METRES_PER_COUNT;
        let point = beams.point(i / columns, i % columns, range);
        point
            .filter(|_| count > 0)
            .map_or([f64::NAN; 3], |p| p.map(f64::from))
    };
    counts.iter().enumerate().map(point).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn image(rows: usize, columns: usize, count: impl Fn(usize, usize) -> u32) -> Vec<u8> {
        let mut bytes = format!("rows: {rows}\ncolumns: {columns}\n").into_bytes();
        for line in 3..=10 {
            bytes.extend(format!("line {line}\n").bytes());
        }
        bytes.extend(b"\r\n");
        for i in 0..rows * columns {
            bytes.extend((0x0abc_0000 | count(i / columns, i % columns)).to_be_bytes());
        }
        bytes
    }

    fn read_bytes(bytes: &[u8]) -> Result<Points> {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.perc");
        std::fs::write(&path, bytes).unwrap();
        read(&path)
    }

    /// Two of the published vectors: row, column, count → X left, Y up, Z out \[cm\].
    #[test]
    fn published_vectors() {
        let bytes = image(512, 512, |row, column| match (row, column) {
            (100, 400) => 1500,
            (511, 0) => 4095,
            _ => 0,
        });
        let points = read_bytes(&bytes).unwrap();
        let expected = [
            [4.47694143, -1.20091075, 0.88184509],
            [8.51632097, 4.35910639, -2.82445238],
        ];
        assert_eq!((points.xyz.len(), points.skipped), (2, 512 * 512 - 2));
        for (found, expected) in points.xyz.iter().zip(expected) {
            for (found, expected) in found.iter().zip(expected) {
                assert!((found - expected).abs() < 5e-6, "{found} for {expected}");
            }
        }
    }

    #[test]
    fn other_files_are_refused() {
        let good = image(4, 4, |_, _| 1000);
        assert_eq!(read_bytes(&good).unwrap().xyz.len(), 16);
        let cut = &good[..good.len() - 40];
        assert!(read_bytes(cut).unwrap_err().message.contains("do not fit"));
        let huge = b"rows: 4000000000\ncolumns: 4\n".as_slice();
        assert!(read_bytes(huge).unwrap_err().message.contains("rows"));
        assert!(read_bytes(b"").unwrap_err().message.contains("rows"));
        assert!(!is_one(b"1 2 3") && is_one(&good));
    }
}
