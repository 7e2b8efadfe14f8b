//! LAS and LAZ, the point clouds of surveying: x, y, z of every point that is not
//! flagged as withheld.
//!
//! Coordinates are taken as metres; the file's reference system is not looked at. Points
//! are read in pieces, so that a header that claims too much costs nothing.

use super::{Points, open};
use crate::error::{Failure, Result};
use byteorder::{ByteOrder, LittleEndian, ReadBytesExt};
use las::{PointData, Reader};
use std::fs::File;
use std::io::{self, BufReader, Read, Seek, SeekFrom};
use std::path::Path;

/// Points that are read at a time.
const PIECE: u64 = 65_536;

/// Reads the points.
pub fn read(path: &Path) -> Result<Points> {
    let (mut file, length) = open(path)?;
    claims(&mut file, length).map_err(|e| Failure::file(path, e))?;
    file.rewind().map_err(|e| Failure::file(path, e))?;
    let (xyz, claimed) = pieces(file).map_err(|e| Failure::file(path, e))?;
    if (xyz.len() as u64) < claimed {
        let message = format_args!("{} of {claimed} points, then the end", xyz.len());
        return Err(Failure::file(path, message));
    }
    let mut points = Points::of(path, xyz.into_iter().flatten().collect())?;
    points.skipped = claimed as usize - points.xyz.len();
    Ok(points)
}

/// As much as there is, up to the length of `bytes`.
fn read_some(file: &mut impl Read, bytes: &mut [u8]) -> io::Result<usize> {
    let mut whole = Vec::new();
    file.take(bytes.len() as u64).read_to_end(&mut whole)?;
    bytes[..whole.len()].copy_from_slice(&whole);
    Ok(whole.len())
}

/// Refuses a header whose offsets and counts do not fit the file: the library takes memory
/// for what they say.
fn claims(file: &mut BufReader<File>, length: u64) -> io::Result<()> {
    let refuse = |what: &str| {
        Err(io::Error::other(format!(
            "{what} beyond the end of the file"
        )))
    };
    let mut head = [0; 375];
    let read = read_some(file, &mut head)?;
    let u32_at = |at: usize| u64::from(LittleEndian::read_u32(&head[at..]));
    let (points, is_packed) = (u32_at(96), head[104] & 0x80 != 0);
    if read < 227 || points > length {
        return refuse("points");
    }
    let (mut at, records) = (LittleEndian::read_u64(&head[235..]), u32_at(243));
    let has_more = head[25] >= 4 && read == head.len();
    for _ in 0..if has_more { records } else { 0 } {
        if at > length {
            return refuse("records");
        }
        file.seek(SeekFrom::Start(at + 20))?;
        let end = at
            .checked_add(60)
            .zip(Some(file.read_u64::<LittleEndian>()?));
        at = end
            .and_then(|(at, size)| at.checked_add(size))
            .unwrap_or(u64::MAX);
    }
    if at > length && has_more && records > 0 {
        return refuse("records");
    }
    if is_packed {
        file.seek(SeekFrom::Start(points))?;
        let table = match file.read_i64::<LittleEndian>()? {
            -1 => {
                file.seek(SeekFrom::End(-8))?;
                file.read_i64::<LittleEndian>()?
            }
            table => table,
        };
        file.seek(SeekFrom::Start(table.max(0) as u64 + 4))?;
        // a chunk has at least a byte
        if u64::from(file.read_u32::<LittleEndian>()?) > length {
            return refuse("chunks");
        }
    }
    Ok(())
}

/// The points (`None` where withheld) and how many the header claims.
fn pieces(file: BufReader<File>) -> las::Result<(Vec<Option<[f64; 3]>>, u64)> {
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
                let error = crate::io::read(&path, None).unwrap_err();
                assert!(error.message.contains(name), "{length}: {error}");
            }
        }
    }
}
