//! `sensor_msgs/msg/PointCloud2`: the centre of every measured cell at its elevation, with
//! its variance and traversability. Coordinates are single precision, as viewers expect,
//! unless they are too great for it to tell millimetres apart.

use super::{Header, Message};
use crate::layers::{Layer, Layers};
use serde::Serialize;

/// Greatest coordinate in single precision \[m\].
const MOST_F32: f64 = 4096.0;
/// Types of fields.
const FLOAT32: u8 = 7;
const FLOAT64: u8 = 8;

#[derive(Serialize)]
struct PointField {
    name: &'static str,
    offset: u32,
    datatype: u8,
    count: u32,
}

#[derive(Serialize)]
pub(super) struct PointCloud2 {
    header: Header,
    height: u32,
    width: u32,
    fields: Vec<PointField>,
    is_bigendian: bool,
    point_step: u32,
    row_step: u32,
    data: Vec<u8>,
    is_dense: bool,
}

impl Message for PointCloud2 {
    const NAME: &'static str = "sensor_msgs/msg/PointCloud2";
    const SCHEMA: &'static str = include_str!("point_cloud2.msg");
}

/// The measured cells as points.
pub(super) fn cloud(layers: &Layers, elevation: &Layer) -> PointCloud2 {
    let far = |axis: usize| layers.corner[axis].abs() + layers.extent()[axis] > MOST_F32;
    let is_double = far(0) || far(1);
    let (size, datatype) = if is_double {
        (8, FLOAT64)
    } else {
        (4, FLOAT32)
    };
    let mut fields = Vec::new();
    let mut end = 0;
    for (name, size, datatype) in [
        ("x", size, datatype),
        ("y", size, datatype),
        ("z", size, datatype),
        ("variance", 4, FLOAT32),
        ("traversability", 4, FLOAT32),
    ] {
        fields.push(PointField {
            name,
            offset: end,
            datatype,
            count: 1,
        });
        end += size;
    }
    let more = ["variance", "traversability"].map(|name| layers.get(name));
    let mut data = Vec::new();
    let raster = layers.raster(elevation);
    for (i, z) in elevation.values.iter().enumerate() {
        if !z.is_finite() {
            continue;
        }
        let [x, y] = raster.node(i);
        for v in [x, y, f64::from(*z)] {
            if is_double {
                data.extend(v.to_le_bytes());
            } else {
                data.extend((v as f32).to_le_bytes());
            }
        }
        for layer in more {
            let value = layer.map_or(f32::NAN, |layer| layer.values[i]);
            data.extend(value.to_le_bytes());
        }
    }
    let width = data.len() as u32 / end;
    PointCloud2 {
        header: Header::default(),
        height: 1,
        width,
        fields,
        is_bigendian: false,
        point_step: end,
        row_step: end * width,
        data,
        is_dense: true,
    }
}
