//! PCD 0.7, the point clouds of PCL: text, binary and compressed.
//!
//! The fields x, y, z may be any number and lie anywhere in the record. The file's
//! `VIEWPOINT` is not applied: PCL writes clouds in the frame of the sensor and readers
//! differ in what they make of it; a viewpoint that is not the identity is refused.

use super::{Points, open};
use crate::error::{Failure, Result};
use pcd_rs::{DataKind, DynReader, DynRecord, Field, PcdMeta};
use std::io::{BufRead, Seek};
use std::path::Path;

/// Reads the points.
pub fn read(path: &Path) -> Result<Points> {
    let (mut file, length) = open(path)?;
    let meta = PcdMeta::from_reader(&mut file).map_err(|e| Failure::file(path, e))?;
    let axes = check(path, &meta, &mut file, length)?;
    file.rewind().map_err(|e| Failure::file(path, e))?;
    let records = DynReader::from_reader(file).map_err(|e| Failure::file(path, e))?;
    let xyz: Result<Vec<_>> = records
        .enumerate()
        .map(|(i, record)| {
            let record = record.map_err(|e| point_failure(path, i, e))?;
            point(&record, axes).ok_or_else(|| point_failure(path, i, "x, y or z is no number"))
        })
        .collect();
    let xyz = xyz?;
    if xyz.len() as u64 != meta.num_points {
        let message = format_args!("{} of {} points, then the end", xyz.len(), meta.num_points);
        return Err(Failure::file(path, message));
    }
    Points::of(path, xyz)
}

fn point_failure(path: &Path, index: usize, message: impl std::fmt::Display) -> Failure {
    Failure::file(path, format_args!("point {index}: {message}"))
}

/// Positions of x, y, z in a record, once the header has been found sound (`file` stands
/// behind it).
fn check(
    path: &Path,
    meta: &PcdMeta,
    file: &mut (impl BufRead + Seek),
    length: u64,
) -> Result<[usize; 3]> {
    let start = file.stream_position().map_err(|e| Failure::file(path, e))?;
    if !fits(path, meta, file, length.saturating_sub(start))? {
        let message = format_args!("{} points do not fit in {length} bytes", meta.num_points);
        return Err(Failure::file(path, message));
    }
    let v = &meta.viewpoint;
    if [v.tx, v.ty, v.tz, v.qx, v.qy, v.qz]
        .iter()
        .any(|&c| c != 0.0)
    {
        return Err(Failure::file(
            path,
            "VIEWPOINT is not 0 0 0 1 0 0 0: transform the cloud first",
        ));
    }
    let mut axes = [0; 3];
    for (axis, name) in axes.iter_mut().zip(["x", "y", "z"]) {
        let mut fields = meta.field_defs.iter();
        let found = fields.position(|f| f.name == name && f.count == 1);
        *axis = found.ok_or_else(|| Failure::file(path, format_args!("no field {name}")))?;
    }
    Ok(axes)
}

/// Can the points that the header claims lie in the `rest` of the file?
fn fits(path: &Path, meta: &PcdMeta, file: &mut impl BufRead, rest: u64) -> Result<bool> {
    let sizes = meta.field_defs.iter();
    let record = sizes
        .map(|f| f.count.saturating_mul(f.kind.byte_size() as u64))
        .fold(0, u64::saturating_add);
    let claimed = meta.num_points.saturating_mul(record);
    Ok(match meta.data {
        // at least a digit of each point
        DataKind::Ascii => meta.num_points <= rest,
        DataKind::Binary => claimed <= rest,
        DataKind::BinaryCompressed => {
            let mut sizes = [0; 8];
            file.read_exact(&mut sizes)
                .map_err(|e| Failure::file(path, e))?;
            let [packed, unpacked] = [0, 4].map(|i| {
                u64::from(u32::from_le_bytes(
                    sizes[i..i + 4].try_into().expect("4 bytes"),
                ))
            });
            // LZF packs at most 264 bytes into 3
            packed <= rest && unpacked == claimed && unpacked <= packed.saturating_mul(88) + 88
        }
    })
}

fn point(record: &DynRecord, axes: [usize; 3]) -> Option<[f64; 3]> {
    let [x, y, z] = axes.map(|i| record.0.get(i).and_then(number));
    Some([x?, y?, z?])
}

fn number(field: &Field) -> Option<f64> {
    match field {
        Field::F32(v) => v.first().map(|&v| v.into()),
        Field::F64(v) => v.first().copied(),
        Field::I8(v) => v.first().map(|&v| v.into()),
        Field::I16(v) => v.first().map(|&v| v.into()),
        Field::I32(v) => v.first().map(|&v| v.into()),
        Field::I64(v) => v.first().map(|&v| v as f64),
        Field::U8(v) => v.first().map(|&v| v.into()),
        Field::U16(v) => v.first().map(|&v| v.into()),
        Field::U32(v) => v.first().map(|&v| v.into()),
        Field::U64(v) => v.first().map(|&v| v as f64),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pcd_rs::{Schema, ValueKind, WriterInit};

    fn file(kind: DataKind) -> (tempfile::TempDir, std::path::PathBuf) {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.pcd");
        let fields = [
            ("intensity", ValueKind::U8, 1),
            ("z", ValueKind::F32, 1),
            ("x", ValueKind::F64, 1),
            ("y", ValueKind::I32, 1),
        ];
        let init = WriterInit {
            width: 3,
            height: 1,
            viewpoint: Default::default(),
            data_kind: kind,
            schema: Some(Schema::from_iter(fields)),
            version: None,
        };
        let mut writer = init.create::<DynRecord, _>(&path).unwrap();
        for i in 0..3 {
            let z = if i == 2 { f32::NAN } else { 0.5 * i as f32 };
            writer
                .push(&DynRecord(vec![
                    Field::U8(vec![7]),
                    Field::F32(vec![z]),
                    Field::F64(vec![1.25 + f64::from(i)]),
                    Field::I32(vec![-i]),
                ]))
                .unwrap();
        }
        writer.finish().unwrap();
        (directory, path)
    }

    #[test]
    fn all_three_kinds_are_read() {
        for kind in [
            DataKind::Ascii,
            DataKind::Binary,
            DataKind::BinaryCompressed,
        ] {
            let (_directory, path) = file(kind);
            let points = read(&path).unwrap();
            assert_eq!(
                points.xyz,
                [[1.25, 0.0, 0.0], [2.25, -1.0, 0.5]],
                "{kind:?}"
            );
            assert_eq!(points.skipped, 1);
        }
    }

    #[test]
    fn damaged_files_are_refused() {
        for kind in [
            DataKind::Ascii,
            DataKind::Binary,
            DataKind::BinaryCompressed,
        ] {
            let (_directory, path) = file(kind);
            let bytes = std::fs::read(&path).unwrap();
            for length in [0, 10, bytes.len() / 2, bytes.len() - 8] {
                std::fs::write(&path, &bytes[..length]).unwrap();
                assert!(
                    read(&path).unwrap_err().message.contains("a.pcd"),
                    "{kind:?} {length}"
                );
            }
            let text = String::from_utf8_lossy(&bytes).into_owned();
            let header = text.split("DATA").next().unwrap().len();
            let huge = text[..header]
                .replace("WIDTH 3", "WIDTH 3000000000")
                .replace("POINTS 3", "POINTS 3000000000");
            let mut huge = huge.into_bytes();
            huge.extend(&bytes[header..]);
            std::fs::write(&path, &huge).unwrap();
            let error = read(&path).unwrap_err();
            assert!(error.message.contains("do not fit"), "{error}");
        }
    }
}
