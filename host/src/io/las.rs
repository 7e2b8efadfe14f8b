//! LAS and LAZ, the point clouds of surveying: x, y, z of every point that is not
//! flagged as withheld.
//!
//! Coordinates are taken as metres; the file's reference system is not looked at. Points
//! are read in pieces, so that a header that claims too much costs nothing.

use super::{Points, open};
use crate::error::{Failure, Result};
use las::{PointData, Reader};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

/// Points that are read at a time.
const PIECE: u64 = 65_536;

/// Reads the points.
pub fn read(path: &Path) -> Result<Points> {
    let (file, _) = open(path)?;
    // the decompressor of LAZ may panic on damaged files
    let read = catch_unwind(AssertUnwindSafe(|| pieces(file)));
    let (xyz, claimed) = match read {
        Ok(read) => read.map_err(|e| Failure::file(path, e))?,
        Err(_) => return Err(Failure::file(path, "damaged")),
    };
    if (xyz.len() as u64) < claimed {
        let message = format_args!("{} of {claimed} points, then the end", xyz.len());
        return Err(Failure::file(path, message));
    }
    let mut points = Points::of(path, xyz.into_iter().flatten().collect())?;
    points.skipped = claimed as usize - points.xyz.len();
    Ok(points)
}

/// The points (`None` where withheld) and how many the header claims.
fn pieces(file: std::io::BufReader<std::fs::File>) -> las::Result<(Vec<Option<[f64; 3]>>, u64)> {
    let mut reader = Reader::new(file)?;
    let claimed = reader.header().number_of_points();
    let mut all = Vec::new();
    loop {
        let piece: PointData = reader.read_points(PIECE)?;
        if piece.is_empty() {
            return Ok((all, claimed));
        }
        for point in piece.points() {
            let point = point?;
            all.push((!point.is_withheld).then_some([point.x, point.y, point.z]));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use las::{Builder, Point, Writer, point::Format};
    use std::path::PathBuf;

    fn file(name: &str, points: usize) -> (tempfile::TempDir, PathBuf) {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join(name);
        let mut builder = Builder::from((1, 4));
        builder.point_format = Format::new(6).unwrap();
        let mut writer = Writer::from_path(&path, builder.into_header().unwrap()).unwrap();
        for i in 0..points {
            writer
                .write_point(Point {
                    x: 500_000.0 + i as f64,
                    y: -2.5,
                    z: 0.001 * i as f64,
                    is_withheld: i == 1,
                    gps_time: Some(0.0),
                    ..Point::default()
                })
                .unwrap();
        }
        writer.close().unwrap();
        (directory, path)
    }

    #[test]
    fn plain_and_compressed_points_are_the_same() {
        for name in ["a.las", "a.laz"] {
            let (_directory, path) = file(name, 1000);
            let points = read(&path).unwrap();
            assert_eq!((points.xyz.len(), points.skipped), (999, 1), "{name}");
            let [x, y, z] = points.xyz[998];
            assert!((x - 500_999.0).abs() < 1e-3 && (y + 2.5).abs() < 1e-3);
            assert!((z - 0.999).abs() < 1e-3, "{z}");
        }
    }

    #[test]
    fn damaged_files_are_refused() {
        for name in ["a.las", "a.laz"] {
            let (_directory, path) = file(name, 1000);
            let bytes = std::fs::read(&path).unwrap();
            for length in [0, 4, 100, bytes.len() / 2] {
                std::fs::write(&path, &bytes[..length]).unwrap();
                let error = read(&path).unwrap_err();
                assert!(error.message.contains(name), "{length}: {error}");
            }
        }
    }
}
