//! Files that were good and have been damaged at random: every reader says so or reads
//! something, none of them panics or takes memory for what is not there.

use las::{Builder, point::Format as LasFormat};
use pcd_rs::{DataKind, DynRecord, Field, Schema, ValueKind, WriterInit};
use rand_core::{Rng, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;
use rugosa_host::config::Settings;
use rugosa_host::export::{self, Format};
use rugosa_host::io::{self, Dataset, Raster};
use rugosa_host::offline::Cloud;
use rugosa_host::planes::HeapPlanes;
use rugosa_host::saved::SavedMap;
use std::fs;
use std::path::{Path, PathBuf};

/// Damaged copies of each file.
const COPIES: usize = 60;

fn exports(directory: &Path) {
    let heights = (0..20 * 24).map(|i| 0.1 * (i % 7) as f32).collect();
    let raster = Raster::square(20, 24, 0.25, [3.0, -2.0], heights);
    let cloud = Cloud::of(vec![Dataset::Raster(raster)], None).unwrap();
    let settings = cloud.fit(Settings::default()).unwrap();
    let mut planes = HeapPlanes::new(settings.side);
    let mut map = cloud.map(&settings, 0.005, &mut planes, |_| {}).unwrap();
    map.layers
        .layers
        .retain(|l| ["elevation", "traversability"].contains(&l.name.as_str()));
    let formats = [
        Format::Npy,
        Format::Npz,
        Format::Asc,
        Format::Geotiff,
        Format::Ply,
        Format::Mcap,
        Format::Rugosa,
    ];
    export::save(&map.layers, &map.saved, directory, &formats).unwrap();
}

fn pcd(path: &Path, data_kind: DataKind) {
    let fields = ["x", "y", "z"].map(|name| (name, ValueKind::F32, 1));
    let init = WriterInit {
        width: 50,
        height: 1,
        viewpoint: Default::default(),
        data_kind,
        schema: Some(Schema::from_iter(fields)),
        version: None,
    };
    let mut writer = init.create::<DynRecord, _>(path).unwrap();
    for i in 0..50 {
        let point = [0.1, 0.2, 0.3].map(|k| Field::F32(vec![k * i as f32]));
        writer.push(&DynRecord(point.into())).unwrap();
    }
    writer.finish().unwrap();
}

fn las(path: &Path) {
    let mut builder = Builder::from((1, 4));
    builder.point_format = LasFormat::new(6).unwrap();
    let mut writer = las::Writer::from_path(path, builder.into_header().unwrap()).unwrap();
    for i in 0..50 {
        let point = las::Point {
            x: f64::from(i),
            z: 0.1 * f64::from(i),
            gps_time: Some(0.0),
            ..las::Point::default()
        };
        writer.write_point(point).unwrap();
    }
    writer.close().unwrap();
}

/// One of every kind.
fn files(directory: &Path) -> Vec<PathBuf> {
    exports(directory);
    pcd(&directory.join("text.pcd"), DataKind::Ascii);
    pcd(&directory.join("binary.pcd"), DataKind::Binary);
    pcd(&directory.join("packed.pcd"), DataKind::BinaryCompressed);
    las(&directory.join("a.las"));
    las(&directory.join("a.laz"));
    fs::write(directory.join("a.csv"), "x,y,z\n1,2,3\n4,5,6\n").unwrap();
    fs::write(directory.join("a.xyz"), "1 2 3\n4 5 6\n").unwrap();
    let mut image = b"rows: 4\ncolumns: 4\n3\n4\n5\n6\n7\n8\n9\n10\n\r\n".to_vec();
    image.extend([0, 0, 3, 9].repeat(16));
    fs::write(directory.join("a.perc"), image).unwrap();
    let entries = fs::read_dir(directory).unwrap();
    let mut files: Vec<PathBuf> = entries.map(|e| e.unwrap().path()).collect();
    files.sort();
    files
}

/// Cut, overwritten in a few places, or with a piece twice.
fn damaged(good: &[u8], random: &mut Xoshiro256PlusPlus) -> Vec<u8> {
    let mut bytes = good.to_vec();
    let mut below = |n: usize| (random.next_u64() % n.max(1) as u64) as usize;
    match below(4) {
        0 => bytes.truncate(below(good.len())),
        1 => {
            let (from, to) = (below(good.len()), below(good.len()));
            let piece = good[from.min(to)..from.max(to)].to_vec();
            bytes.splice(from..from, piece);
        }
        _ => {
            for _ in 0..1 + below(8) {
                let at = below(good.len().min(600));
                bytes[at] = [0, 1, 0x7f, 0xff, b'9', b'-'][below(6)];
            }
        }
    }
    bytes
}

fn read(path: &Path) -> Result<(), String> {
    let spacing = Some("0.25".parse().unwrap());
    let read = if path.extension().is_some_and(|e| e == "rugosa") {
        SavedMap::read(path).map(drop)
    } else {
        io::read(path, spacing).map(drop)
    };
    read.map_err(|failure| failure.message)
}

#[test]
fn damaged_files_are_errors_and_nothing_worse() {
    let directory = tempfile::tempdir().unwrap();
    let mut random = Xoshiro256PlusPlus::seed_from_u64(5);
    for path in files(directory.path()) {
        let name = path.file_name().unwrap().to_str().unwrap().to_owned();
        let good = fs::read(&path).unwrap();
        assert_eq!(read(&path), Ok(()), "{name}");
        let mut refused = 0;
        for _ in 0..COPIES {
            fs::write(&path, damaged(&good, &mut random)).unwrap();
            if let Err(message) = read(&path) {
                assert!(message.contains(&name), "{name}: {message}");
                refused += 1;
            }
        }
        assert!(
            refused > COPIES / 10,
            "{name}: {refused} of {COPIES} refused"
        );
    }
}
