//! The ROS 2 messages that are read, as far as they are needed; CDR with its four bytes
//! of encapsulation. What follows the last field in a message is passed over.

use byteorder::{BigEndian, LittleEndian};
use serde::{Deserialize, Serialize};

/// `builtin_interfaces/msg/Time`
#[derive(Clone, Copy, Debug, Deserialize, Serialize)]
pub(super) struct Time {
    pub sec: i32,
    pub nanosec: u32,
}

impl Time {
    /// Nanoseconds since the epoch.
    pub(super) fn ns(self) -> i64 {
        i64::from(self.sec) * 1_000_000_000 + i64::from(self.nanosec)
    }
}

/// `std_msgs/msg/Header`
#[derive(Debug, Deserialize, Serialize)]
pub(super) struct Header {
    pub stamp: Time,
    pub frame_id: String,
}

/// `sensor_msgs/msg/PointField`
#[derive(Debug, Deserialize, Serialize)]
pub(super) struct PointField {
    pub name: String,
    pub offset: u32,
    pub datatype: u8,
    pub count: u32,
}

/// `sensor_msgs/msg/PointCloud2`, without `is_dense`
#[derive(Debug, Deserialize, Serialize)]
pub(super) struct PointCloud2<'a> {
    pub header: Header,
    pub height: u32,
    pub width: u32,
    pub fields: Vec<PointField>,
    pub is_bigendian: bool,
    pub point_step: u32,
    pub row_step: u32,
    pub data: &'a [u8],
}

/// `geometry_msgs/msg/Transform`
#[derive(Debug, Deserialize, Serialize)]
pub(super) struct Transform {
    pub translation: [f64; 3],
    /// x, y, z, w
    pub rotation: [f64; 4],
}

/// `geometry_msgs/msg/TransformStamped`
#[derive(Debug, Deserialize, Serialize)]
pub(super) struct TransformStamped {
    pub header: Header,
    pub child_frame_id: String,
    pub transform: Transform,
}

/// `tf2_msgs/msg/TFMessage`
#[derive(Debug, Deserialize, Serialize)]
pub(super) struct TfMessage {
    pub transforms: Vec<TransformStamped>,
}

/// `nav_msgs/msg/Odometry`, up to its pose
#[derive(Debug, Deserialize, Serialize)]
pub(super) struct Odometry {
    pub header: Header,
    pub child_frame_id: String,
    pub position: [f64; 3],
    pub orientation: [f64; 4],
}

/// Decodes a message of either byte order.
pub(super) fn decode<'a, T: Deserialize<'a>>(data: &'a [u8]) -> Result<T, String> {
    let order = data.get(1).filter(|_| data.len() >= 4 && data[0] == 0);
    let body = data.get(4..).unwrap_or_default();
    let decoded = match order {
        Some(0) => cdr_encoding::from_bytes::<T, BigEndian>(body),
        Some(1) => cdr_encoding::from_bytes::<T, LittleEndian>(body),
        _ => return Err("not plain CDR".into()),
    };
    decoded
        .map(|(message, _)| message)
        .map_err(|e| format!("damaged: {e}"))
}

/// Types of `sensor_msgs/msg/PointField`.
const FLOAT32: u8 = 7;
const FLOAT64: u8 = 8;

impl PointCloud2<'_> {
    /// All points, also those that are not finite.
    pub(super) fn points(&self) -> Result<Vec<[f32; 3]>, String> {
        let (rows, columns) = (self.height as usize, self.width as usize);
        let [step, row_step] = [self.point_step as usize, self.row_step as usize];
        let fits = columns.checked_mul(step).is_some_and(|n| n <= row_step)
            && rows
                .checked_mul(row_step)
                .is_some_and(|n| n <= self.data.len());
        if rows * columns > 0 && !fits {
            let length = self.data.len();
            return Err(format!(
                "{rows} × {columns} points of {step} bytes in {length} bytes"
            ));
        }
        let axes = [self.field("x")?, self.field("y")?, self.field("z")?];
        let point = |i: usize| {
            let at = i / columns * row_step + i % columns * step;
            axes.map(|axis| self.number(at, axis))
        };
        Ok((0..rows * columns).map(point).collect())
    }

    /// Offset and type of a coordinate.
    fn field(&self, name: &str) -> Result<(usize, u8), String> {
        let field = self.fields.iter().find(|f| f.name == name);
        let field = field.ok_or_else(|| format!("a cloud without field {name}"))?;
        let size = match field.datatype {
            FLOAT32 => 4,
            FLOAT64 => 8,
            other => return Err(format!("field {name} of type {other}; floats are needed")),
        };
        let end = field.offset.checked_add(size);
        if end.is_none_or(|end| end > self.point_step) {
            return Err(format!("field {name} lies beyond its point"));
        }
        Ok((field.offset as usize, field.datatype))
    }

    fn number(&self, at: usize, (offset, kind): (usize, u8)) -> f32 {
        use byteorder::ByteOrder;
        let bytes = &self.data[at + offset..];
        match (kind, self.is_bigendian) {
            (FLOAT32, false) => LittleEndian::read_f32(bytes),
            (FLOAT32, true) => BigEndian::read_f32(bytes),
            (_, false) => LittleEndian::read_f64(bytes) as f32,
            (_, true) => BigEndian::read_f64(bytes) as f32,
        }
    }
}
