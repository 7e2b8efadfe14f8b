//! `foxglove_msgs/msg/Grid`: the map as coloured terrain. The pose is the lower left
//! corner, data are row-major with rows along x; `elevation` lifts the cells, red, green,
//! blue and alpha colour them (by traversability where there is one, else by elevation);
//! unknown cells are transparent and NaN.

use super::{FRAME, Message, Pose, Time};
use crate::draw::Palette;
use crate::layers::{Layer, Layers};
use serde::Serialize;

/// Types of fields.
const UINT8: u8 = 1;
const FLOAT32: u8 = 7;
/// Fields: name, offset, type; and bytes of a cell.
const FIELDS: [(&str, u32, u8); 6] = [
    ("elevation", 0, FLOAT32),
    ("traversability", 4, FLOAT32),
    ("red", 8, UINT8),
    ("green", 9, UINT8),
    ("blue", 10, UINT8),
    ("alpha", 11, UINT8),
];
const CELL: u32 = 12;

#[derive(Serialize)]
struct PackedElementField {
    name: &'static str,
    offset: u32,
    kind: u8,
}

#[derive(Serialize)]
pub(super) struct Grid {
    timestamp: Time,
    frame_id: &'static str,
    pose: Pose,
    column_count: u32,
    cell_size: [f64; 2],
    row_stride: u32,
    cell_stride: u32,
    fields: Vec<PackedElementField>,
    data: Vec<u8>,
}

impl Message for Grid {
    const NAME: &'static str = "foxglove_msgs/msg/Grid";
    const SCHEMA: &'static str = include_str!("foxglove_grid.msg");
}

/// The map as a grid.
pub(super) fn grid(layers: &Layers, elevation: &Layer) -> Grid {
    let traversability = layers.get("traversability");
    let range = layers.raster(elevation).range().unwrap_or((0.0, 1.0));
    let mut data = Vec::with_capacity(elevation.values.len() * CELL as usize);
    for (i, &z) in elevation.values.iter().enumerate() {
        let good = traversability.map_or(f32::NAN, |layer| layer.values[i]);
        let [r, g, b] = match traversability {
            Some(_) => Palette::Cividis.colour(f64::from(good)),
            None => Palette::Viridis.colour(f64::from((z - range.0) / (range.1 - range.0))),
        };
        let alpha = if z.is_finite() { 255 } else { 0 };
        data.extend(z.to_le_bytes());
        data.extend(good.to_le_bytes());
        data.extend([r, g, b, alpha]);
    }
    let field = |(name, offset, kind)| PackedElementField { name, offset, kind };
    Grid {
        timestamp: Time::default(),
        frame_id: FRAME,
        pose: Pose::at(layers.corner[0], layers.corner[1]),
        column_count: layers.columns as u32,
        cell_size: [layers.resolution; 2],
        row_stride: layers.columns as u32 * CELL,
        cell_stride: CELL,
        fields: FIELDS.into_iter().map(field).collect(),
        data,
    }
}
