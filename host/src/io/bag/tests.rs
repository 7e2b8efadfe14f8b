use super::messages::{Header, PointField, Time, Transform, TransformStamped};
use super::*;
use byteorder::LittleEndian;
use mcap::records::MessageHeader;
use serde::Serialize;

/// A bag with clouds of two points, 1 m ahead and (NaN, 0, 0), and a robot that drives
/// 1 m/s to the north with its scanner, turned to the left, 0.5 m above it.
struct Bag {
    clouds_at: Vec<i32>,
    transforms: bool,
    frame: &'static str,
}

fn stamp(sec: i32) -> Time {
    Time { sec, nanosec: 0 }
}

fn header(sec: i32, frame: &str) -> Header {
    Header {
        stamp: stamp(sec),
        frame_id: frame.into(),
    }
}

fn cdr(message: &impl Serialize) -> Vec<u8> {
    let body = cdr_encoding::to_vec::<_, LittleEndian>(message).unwrap();
    [&[0, 1, 0, 0], body.as_slice()].concat()
}

/// `sensor_msgs/msg/PointCloud2` with owned data, as serde writes sequences.
#[derive(Serialize)]
struct Cloud {
    header: Header,
    size: [u32; 2],
    fields: Vec<PointField>,
    is_bigendian: bool,
    steps: [u32; 2],
    data: Vec<u8>,
    is_dense: bool,
}

fn cloud(sec: i32, frame: &str, width: u32) -> Vec<u8> {
    let mut data = Vec::new();
    for point in [[1f32, 0.0, 0.0], [f32::NAN, 0.0, 0.0]] {
        data.extend([9; 4]); // an intensity
        point.iter().for_each(|v| data.extend(v.to_le_bytes()));
    }
    let field = |(i, name): (usize, &str)| PointField {
        name: name.into(),
        offset: 4 * i as u32,
        datatype: 7,
        count: 1,
    };
    let names = ["intensity", "x", "y", "z"];
    cdr(&Cloud {
        header: header(sec, frame),
        size: [1, width],
        fields: names.into_iter().enumerate().map(field).collect(),
        is_bigendian: false,
        steps: [16, 16 * width],
        data,
        is_dense: false,
    })
}

fn transform(sec: i32, parent: &str, child: &str, t: [f64; 3], q: [f64; 4]) -> Vec<u8> {
    cdr(&TfMessage {
        transforms: vec![TransformStamped {
            header: header(sec, parent),
            child_frame_id: child.into(),
            transform: Transform {
                translation: t,
                rotation: q,
            },
        }],
    })
}

impl Bag {
    fn bytes(&self) -> Vec<u8> {
        let mut bytes = std::io::Cursor::new(Vec::new());
        let mut writer = mcap::WriteOptions::new()
            .profile("ros2")
            .create(&mut bytes)
            .unwrap();
        let mut put = |topic: &str, kind: &str, data: &[u8]| {
            let schema = writer.add_schema(kind, "ros2msg", b"").unwrap();
            let id = writer
                .add_channel(schema, topic, "cdr", &BTreeMap::new())
                .unwrap();
            let header = MessageHeader {
                channel_id: id,
                sequence: 0,
                log_time: 0,
                publish_time: 0,
            };
            writer.write_to_known_channel(&header, data).unwrap();
        };
        for &sec in &self.clouds_at {
            let data = cloud(sec, self.frame, 2);
            put("/points", "sensor_msgs/msg/PointCloud2", &data);
        }
        if self.transforms {
            let half = std::f64::consts::FRAC_1_SQRT_2;
            let level = [0.0, 0.0, 0.0, 1.0];
            let tf = "tf2_msgs/msg/TFMessage";
            let up = transform(0, "base", "lidar", [0.0, 0.0, 0.5], [0.0, 0.0, half, half]);
            put("/tf_static", tf, &up);
            for sec in [10, 0] {
                let t = [0.0, f64::from(sec), 0.0];
                put("/tf", tf, &transform(sec, "odom", "base", t, level));
            }
        }
        writer.finish().unwrap();
        drop(writer);
        bytes.into_inner()
    }

    fn read(&self) -> Result<Points> {
        read_bytes(&self.bytes())
    }
}

fn read_bytes(bytes: &[u8]) -> Result<Points> {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a.mcap");
    std::fs::write(&path, bytes).unwrap();
    read(&path)
}

#[test]
fn clouds_are_moved_to_where_they_were_seen() {
    let bag = Bag {
        clouds_at: vec![0, 4, 99],
        transforms: true,
        frame: "lidar",
    };
    let points = bag.read().unwrap();
    // two finite points have a pose; three are NaN and one cloud came too late
    assert_eq!((points.xyz.len(), points.skipped), (2, 4));
    for (found, expected) in points.xyz.iter().zip([[0.0, 1.0, 0.5], [0.0, 5.0, 0.5]]) {
        for (found, expected) in found.iter().zip(expected) {
            assert!((found - expected).abs() < 1e-9, "{found} for {expected}");
        }
    }
}

#[test]
fn clouds_without_a_way_are_refused() {
    let bag = |clouds_at, frame| Bag {
        clouds_at,
        transforms: false,
        frame,
    };
    let error = bag(vec![0, 1], "lidar").read().unwrap_err();
    assert!(error.message.contains("'lidar'"), "{error}");
    assert_eq!(bag(vec![0, 1], "odom").read().unwrap().xyz.len(), 2);
    assert_eq!(bag(vec![0], "lidar").read().unwrap().xyz.len(), 1);
    let error = bag(vec![5, 4], "odom").read().unwrap_err();
    assert!(
        error.message.contains("/points: time goes backwards"),
        "{error}"
    );
    let error = bag(vec![], "odom").read().unwrap_err();
    assert!(
        error.message.contains("no sensor_msgs/msg/PointCloud2"),
        "{error}"
    );
}

#[test]
fn damaged_bags_and_clouds_are_refused() {
    let bag = Bag {
        clouds_at: vec![0, 4],
        transforms: true,
        frame: "lidar",
    };
    let bytes = bag.bytes();
    for length in [0, 5, bytes.len() / 3, bytes.len() / 2] {
        let error = read_bytes(&bytes[..length]).unwrap_err();
        assert!(error.message.contains("a.mcap"), "{length}: {error}");
    }
    let absurd = cloud(0, "odom", 4_000_000);
    let absurd: PointCloud2 = decode(&absurd).unwrap();
    assert!(absurd.points().unwrap_err().contains("in 32 bytes"));
    assert!(decode::<PointCloud2>(&[0, 1, 0, 0, 1]).is_err());
    assert!(decode::<PointCloud2>(&[]).is_err());
}
