//! Points as text: `.csv` (with or without a header line) and `.xyz` (columns separated
//! by white space, `#` starts a comment).
//!
//! Of more than three columns the first three are taken, unless a header names them
//! x, y, z (or east, north, height / elevation / up).

use super::{Points, open, read_text};
use crate::error::{Failure, Result};
use csv::StringRecord;
use std::path::Path;

/// Names of the three columns.
const NAMES: [&[&str]; 3] = [
    &["x", "x_m", "east", "easting", "east_m"],
    &["y", "y_m", "north", "northing", "north_m"],
    &[
        "z",
        "z_m",
        "height",
        "elevation",
        "up",
        "height_m",
        "elevation_m",
    ],
];

/// Reads `.csv`, separated by commas or semicolons.
pub fn read_csv(path: &Path) -> Result<Points> {
    let (file, _) = open(path)?;
    let mut reader = csv::ReaderBuilder::new()
        .has_headers(false)
        .flexible(true)
        .comment(Some(b'#'))
        .trim(csv::Trim::All)
        .delimiter(delimiter(path)?)
        .from_reader(file);
    let mut columns = [0, 1, 2];
    let mut xyz = Vec::new();
    for (index, record) in reader.records().enumerate() {
        let record = record.map_err(|e| Failure::file(path, e))?;
        if index == 0 && is_header(&record) {
            columns = header(path, &record)?;
            continue;
        }
        let line = record.position().map_or(0, csv::Position::line);
        let field = |i: usize| record.get(columns[i]);
        xyz.push(point(path, line, field)?);
    }
    Points::of(path, xyz)
}

/// Reads `.xyz`.
pub fn read_xyz(path: &Path) -> Result<Points> {
    let mut xyz = Vec::new();
    for (index, line) in read_text(path)?.lines().enumerate() {
        let content = line.split('#').next().unwrap_or_default();
        let fields: Vec<&str> = content.split_whitespace().collect();
        if !fields.is_empty() {
            xyz.push(point(path, index as u64 + 1, |i| fields.get(i).copied())?);
        }
    }
    Points::of(path, xyz)
}

fn delimiter(path: &Path) -> Result<u8> {
    use std::io::BufRead;
    let (mut file, _) = open(path)?;
    let start = file.fill_buf().map_err(|e| Failure::file(path, e))?;
    let line = start.split(|&b| b == b'\n').next().unwrap_or_default();
    let semicolons = line.contains(&b';') && !line.contains(&b',');
    Ok(if semicolons { b';' } else { b',' })
}

/// A header has no number in its first field.
fn is_header(record: &StringRecord) -> bool {
    let first = record.get(0).unwrap_or_default();
    !first.is_empty() && first.parse::<f64>().is_err()
}

fn header(path: &Path, record: &StringRecord) -> Result<[usize; 3]> {
    let find = |names: &[&str]| {
        let named = |field: &str| names.contains(&field.to_ascii_lowercase().as_str());
        let missing = || Failure::line(path, 1, format_args!("no column named '{}'", names[0]));
        record.iter().position(named).ok_or_else(missing)
    };
    Ok([find(NAMES[0])?, find(NAMES[1])?, find(NAMES[2])?])
}

fn point<'a>(path: &Path, line: u64, field: impl Fn(usize) -> Option<&'a str>) -> Result<[f64; 3]> {
    let mut point = [0.0; 3];
    for (i, (value, name)) in point.iter_mut().zip(["x", "y", "z"]).enumerate() {
        let text = field(i)
            .ok_or_else(|| Failure::line(path, line, format_args!("field {name} is missing")))?;
        let parsed = text.parse();
        *value = parsed.map_err(|_| {
            Failure::line(
                path,
                line,
                format_args!("field {name}: '{text}' is not a number"),
            )
        })?;
    }
    Ok(point)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    fn with_file(name: &str, content: &str, read: fn(&Path) -> Result<Points>) -> Result<Points> {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join(name);
        fs::write(&path, content).unwrap();
        read(&path)
    }

    #[test]
    fn csv_with_and_without_a_header() {
        let plain = with_file("a.csv", "1,2,3\n4,5,6\n", read_csv).unwrap();
        assert_eq!(plain.xyz, [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]);
        let named = with_file("a.csv", "t; north; east; height\n9;2;1;3\n", read_csv).unwrap();
        assert_eq!(named.xyz, [[1.0, 2.0, 3.0]]);
    }

    #[test]
    fn xyz_with_comments_and_holes() {
        let points = with_file("a.xyz", "# x y z\n1 2\t3 99\n\n4 5 nan # bad\n", read_xyz).unwrap();
        assert_eq!((points.xyz.len(), points.skipped), (1, 1));
    }

    #[test]
    fn an_error_names_the_line_and_the_field() {
        let bad = with_file("a.csv", "x,y,z\n1,2,3\n1,oops,3\n", read_csv).unwrap_err();
        assert!(
            bad.message
                .ends_with("a.csv:3: field y: 'oops' is not a number"),
            "{bad}"
        );
        let short = with_file("a.xyz", "1 2 3\n1 2\n", read_xyz).unwrap_err();
        assert!(
            short.message.ends_with("a.xyz:2: field z is missing"),
            "{short}"
        );
        let none = with_file("a.csv", "", read_csv).unwrap_err();
        assert!(none.message.contains("holds no points"), "{none}");
        let unnamed = with_file("a.csv", "a,b,c\n1,2,3\n", read_csv).unwrap_err();
        assert!(
            unnamed.message.contains("a.csv:1: no column named 'x'"),
            "{unnamed}"
        );
    }
}
