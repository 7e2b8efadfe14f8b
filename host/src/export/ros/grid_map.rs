//! `grid_map_msgs/msg/GridMap`: the pose is the map's centre; index (0, 0) is the corner
//! of greatest x and greatest y and indices grow towards −x (rows) and −y (columns); the
//! data are column-major and the labels are `column_index`, `row_index`.

use super::{Header, Message, Pose};
use crate::layers::{Layer, Layers};
use serde::Serialize;

#[derive(Serialize)]
struct Info {
    resolution: f64,
    length_x: f64,
    length_y: f64,
    pose: Pose,
}

#[derive(Serialize)]
struct Dimension {
    label: &'static str,
    size: u32,
    stride: u32,
}

#[derive(Serialize)]
struct MultiArray {
    dim: Vec<Dimension>,
    data_offset: u32,
    data: Vec<f32>,
}

#[derive(Serialize)]
pub(super) struct GridMap {
    header: Header,
    info: Info,
    layers: Vec<String>,
    basic_layers: Vec<String>,
    data: Vec<MultiArray>,
    outer_start_index: u16,
    inner_start_index: u16,
}

impl Message for GridMap {
    const NAME: &'static str = "grid_map_msgs/msg/GridMap";
    const SCHEMA: &'static str = include_str!("grid_map.msg");
}

/// All layers as one message.
pub(super) fn grid_map(layers: &Layers) -> GridMap {
    let [length_x, length_y] = layers.extent();
    let [x, y] = layers.corner;
    GridMap {
        header: Header::default(),
        info: Info {
            resolution: layers.resolution,
            length_x,
            length_y,
            pose: Pose::at(x + length_x / 2.0, y + length_y / 2.0),
        },
        layers: layers.layers.iter().map(|l| l.name.clone()).collect(),
        basic_layers: layers
            .get("elevation")
            .map(|l| l.name.clone())
            .into_iter()
            .collect(),
        data: layers.layers.iter().map(|l| array(layers, l)).collect(),
        outer_start_index: 0,
        inner_start_index: 0,
    }
}

fn array(layers: &Layers, layer: &Layer) -> MultiArray {
    // grid_map's rows run along x, its columns along y
    let (rows, columns) = (layers.columns, layers.rows);
    let dim = |label, size: usize, stride: usize| Dimension {
        label,
        size: size as u32,
        stride: stride as u32,
    };
    MultiArray {
        dim: vec![
            dim("column_index", columns, rows * columns),
            dim("row_index", rows, rows),
        ],
        data_offset: 0,
        data: layer.values.iter().rev().copied().collect(),
    }
}
