//! ESRI ASCII grid: a header of `keyword value` lines, then rows from the greatest y
//! down.
//!
//! Written with `xllcorner`/`yllcorner` (the corner of the lowest cell, half a cell
//! from its centre); read with those or `xllcenter`/`yllcenter`. Rectangular cells
//! use GDAL's `dx`/`dy` in place of `cellsize`.

use super::{Raster, atomic, read_text};
use crate::error::{Failure, Result};
use std::collections::BTreeMap;
use std::io::{self, Write};
use std::path::Path;

/// What unknown nodes are written as.
const NODATA: f32 = -9999.0;

const KEYWORDS: [&str; 10] = [
    "ncols",
    "nrows",
    "xllcorner",
    "yllcorner",
    "xllcenter",
    "yllcenter",
    "cellsize",
    "dx",
    "dy",
    "nodata_value",
];

struct Header<'a> {
    path: &'a Path,
    values: BTreeMap<String, f64>,
}

/// Reads a raster; the NODATA value becomes NaN.
pub fn read(path: &Path) -> Result<Raster> {
    let text = read_text(path)?;
    let (header, body) = Header::parse(path, &text)?;
    let mut raster = header.raster()?;
    let count = raster.rows * raster.columns;
    let nodata = header.values.get("nodata_value").copied();
    let values = values(path, body, nodata)?;
    if values.len() != count {
        return Err(Failure::file(
            path,
            format_args!("{} values; nrows × ncols is {count}", values.len()),
        ));
    }
    raster.values = values
        .chunks(raster.columns)
        .rev()
        .flatten()
        .copied()
        .collect();
    Ok(raster)
}

impl<'a> Header<'a> {
    /// The header, and the lines after it with their numbers.
    fn parse(path: &'a Path, text: &'a str) -> Result<(Self, Vec<(u64, &'a str)>)> {
        let mut values = BTreeMap::new();
        let mut lines = (1..).zip(text.lines()).peekable();
        while let Some(&(number, line)) = lines.peek() {
            let mut words = line.split_whitespace();
            let key = words.next().unwrap_or_default().to_ascii_lowercase();
            if !key.starts_with(|c: char| c.is_ascii_alphabetic()) || key == "nan" {
                break;
            }
            if !KEYWORDS.contains(&key.as_str()) {
                return Err(Failure::line(
                    path,
                    number,
                    format_args!("unknown keyword '{key}'"),
                ));
            }
            let value = words.next().and_then(|v| v.parse().ok());
            let bad = || Failure::line(path, number, format_args!("{key}: not a number"));
            values.insert(key.clone(), value.ok_or_else(bad)?);
            lines.next();
        }
        Ok((Header { path, values }, lines.collect()))
    }

    fn get(&self, key: &str) -> Result<f64> {
        let value = self.values.get(key).copied().filter(|v| v.is_finite());
        value.ok_or_else(|| Failure::file(self.path, format_args!("the header has no {key}")))
    }

    fn count(&self, key: &str) -> Result<usize> {
        match self.get(key)? {
            n if n.fract() == 0.0 && (2.0..=65_536.0).contains(&n) => Ok(n as usize),
            n => Err(Failure::file(
                self.path,
                format_args!("{key} is {n}; 2 … 65536 is possible"),
            )),
        }
    }

    fn spacing(&self, key: &str) -> Result<f64> {
        let key = if self.values.contains_key(key) {
            key
        } else {
            "cellsize"
        };
        match self.get(key)? {
            spacing if spacing > 0.0 => Ok(spacing),
            spacing => Err(Failure::file(
                self.path,
                format_args!("{key} is {spacing}; it must be positive"),
            )),
        }
    }

    /// Centre of the lowest cell along one axis.
    fn origin(&self, axis: char, spacing: f64) -> Result<f64> {
        match self.get(&format!("{axis}llcenter")) {
            Ok(centre) => Ok(centre),
            Err(_) => Ok(self.get(&format!("{axis}llcorner"))? + spacing / 2.0),
        }
    }

    fn raster(&self) -> Result<Raster> {
        let (spacing_x, spacing_y) = (self.spacing("dx")?, self.spacing("dy")?);
        Ok(Raster {
            rows: self.count("nrows")?,
            columns: self.count("ncols")?,
            spacing_x,
            spacing_y,
            origin: [self.origin('x', spacing_x)?, self.origin('y', spacing_y)?],
            values: Vec::new(),
        })
    }
}

fn values(path: &Path, lines: Vec<(u64, &str)>, nodata: Option<f64>) -> Result<Vec<f32>> {
    let mut values = Vec::new();
    for (number, line) in lines {
        for word in line.split_whitespace() {
            let bad = || Failure::line(path, number, format_args!("'{word}' is not a number"));
            let value: f64 = word.parse().map_err(|_| bad())?;
            let known = value.is_finite() && Some(value) != nodata;
            values.push(if known { value as f32 } else { f32::NAN });
        }
    }
    Ok(values)
}

/// Writes a raster.
pub fn write(path: &Path, raster: &Raster) -> Result<()> {
    atomic::write(path, |writer| encode(writer, raster))
}

fn encode(writer: &mut dyn Write, raster: &Raster) -> io::Result<()> {
    let Raster {
        rows,
        columns,
        spacing_x,
        spacing_y,
        origin,
        ..
    } = raster;
    writeln!(writer, "ncols {columns}\nnrows {rows}")?;
    writeln!(writer, "xllcorner {}", origin[0] - spacing_x / 2.0)?;
    writeln!(writer, "yllcorner {}", origin[1] - spacing_y / 2.0)?;
    if spacing_x == spacing_y {
        writeln!(writer, "cellsize {spacing_x}")?;
    } else {
        writeln!(writer, "dx {spacing_x}\ndy {spacing_y}")?;
    }
    writeln!(writer, "NODATA_value {NODATA}")?;
    for row in raster.values.chunks(*columns).rev() {
        let words: Vec<String> = row
            .iter()
            .map(|v| {
                if v.is_finite() {
                    v.to_string()
                } else {
                    NODATA.to_string()
                }
            })
            .collect();
        writeln!(writer, "{}", words.join(" "))?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    fn read_str(content: &str) -> Result<Raster> {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.asc");
        fs::write(&path, content).unwrap();
        read(&path)
    }

    #[test]
    fn the_first_row_of_the_file_is_the_greatest_y() {
        let raster = read_str("ncols 3\nnrows 2\nxllcorner 10\nyllcenter 20\ncellsize 2\nNODATA_value -1\n4 5 -1\n1 2 3\n").unwrap();
        assert_eq!(raster.origin, [11.0, 20.0]);
        assert_eq!(&raster.values[..5], [1.0, 2.0, 3.0, 4.0, 5.0]);
        assert!(raster.values[5].is_nan());
    }

    #[test]
    fn the_round_trip_is_exact() {
        for (spacing_x, spacing_y) in [(0.1, 0.1), (92.7, 74.0)] {
            let raster = Raster {
                rows: 2,
                columns: 2,
                spacing_x,
                spacing_y,
                origin: [-3.5, 7.25],
                values: vec![0.1, -1e-7, 123_456.78, 4.0],
            };
            let directory = tempfile::tempdir().unwrap();
            let path = directory.path().join("a.asc");
            write(&path, &raster).unwrap();
            let back = read(&path).unwrap();
            assert_eq!(back.values, raster.values);
            assert!((back.origin[0] + 3.5).abs() < 1e-9 && (back.origin[1] - 7.25).abs() < 1e-9);
            assert_eq!((back.spacing_x, back.spacing_y), (spacing_x, spacing_y));
        }
    }

    #[test]
    fn malformed_files_are_refused() {
        let cases = [
            ("", "no cellsize"),
            (
                "ncols 2\nnrows 2\nxllcorner 0\nyllcorner 0\ncellsize 1\n1 2\n3\n",
                "3 values",
            ),
            (
                "ncols 2\nnrows 2\nxllcorner 0\nyllcorner 0\ncellsize 0\n1 2\n3 4\n",
                "must be positive",
            ),
            (
                "ncols 2\nnrows 2\nxllcorner 0\nyllcorner 0\ncellsize 1\n1 2\n3 x\n",
                "a.asc:7: 'x'",
            ),
            (
                "ncols 9e9\nnrows 2\nxllcorner 0\nyllcorner 0\ncellsize 1\n1\n",
                "is possible",
            ),
            ("ncols two\n", "a.asc:1: ncols"),
            ("colour 2\n", "a.asc:1: unknown keyword"),
        ];
        for (content, expected) in cases {
            let message = read_str(content).unwrap_err().message;
            assert!(message.contains(expected), "{message}");
        }
    }
}
