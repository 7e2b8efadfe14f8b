//! A ROS 2 bag (MCAP) with one `grid_map_msgs/msg/GridMap` on `/grid_map` and, where the
//! map has costs, one `nav_msgs/msg/OccupancyGrid` on `/occupancy`.
//!
//! grid_map's conventions: the pose is the map's centre; index (0, 0) is the corner of
//! greatest x and greatest y and indices grow towards −x (rows) and −y (columns); the
//! data are column-major and the labels are `column_index`, `row_index`. An occupancy
//! grid is row-major from the lower left cell, 0 free … 100 impassable, −1 unknown.

use crate::error::{Failure, Result};
use crate::io::atomic;
use crate::layers::{Layer, Layers};
use byteorder::LittleEndian;
use cdr_encoding::to_vec;
use mcap::records::MessageHeader;
use serde::Serialize;
use std::collections::BTreeMap;
use std::io::{Cursor, Seek, Write};
use std::path::Path;

/// Coordinate frame of the map.
const FRAME: &str = "map";

#[derive(Serialize)]
struct Time {
    sec: i32,
    nanosec: u32,
}

#[derive(Serialize)]
struct Header {
    stamp: Time,
    frame_id: String,
}

#[derive(Serialize)]
struct Pose {
    position: [f64; 3],
    orientation: [f64; 4],
}

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
struct GridMap {
    header: Header,
    info: Info,
    layers: Vec<String>,
    basic_layers: Vec<String>,
    data: Vec<MultiArray>,
    outer_start_index: u16,
    inner_start_index: u16,
}

/// Writes the bag.
pub fn write(path: &Path, layers: &Layers) -> Result<()> {
    let failed = |error: String| Failure::write(path, error);
    let bytes = encode(layers).map_err(failed)?;
    atomic::write(path, |writer| writer.write_all(&bytes))
}

fn encode(layers: &Layers) -> Result<Vec<u8>, String> {
    let mut bytes = Cursor::new(Vec::new());
    let options = mcap::WriteOptions::new().profile("ros2").library("rugosa");
    let mut writer = options.create(&mut bytes).map_err(text)?;
    let grid_map = message(&grid_map(layers))?;
    put(
        &mut writer,
        "/grid_map",
        ("grid_map_msgs/msg/GridMap", GRID_MAP),
        &grid_map,
    )?;
    if let Some(traversability) = layers.get("traversability") {
        let occupancy = message(&occupancy(layers, traversability))?;
        put(
            &mut writer,
            "/occupancy",
            ("nav_msgs/msg/OccupancyGrid", OCCUPANCY),
            &occupancy,
        )?;
    }
    writer.finish().map_err(text)?;
    drop(writer);
    Ok(bytes.into_inner())
}

fn put<W: Write + Seek>(
    writer: &mut mcap::Writer<W>,
    topic: &str,
    (name, schema): (&str, &str),
    data: &[u8],
) -> Result<(), String> {
    let schema = writer
        .add_schema(name, "ros2msg", schema.as_bytes())
        .map_err(text)?;
    let channel = writer.add_channel(schema, topic, "cdr", &BTreeMap::new());
    let header = MessageHeader {
        channel_id: channel.map_err(text)?,
        sequence: 0,
        log_time: 0,
        publish_time: 0,
    };
    writer.write_to_known_channel(&header, data).map_err(text)
}

fn text(error: impl std::fmt::Display) -> String {
    error.to_string()
}

/// CDR, little-endian, with its encapsulation header.
fn message(message: &impl Serialize) -> Result<Vec<u8>, String> {
    let body = to_vec::<_, LittleEndian>(message).map_err(text)?;
    Ok([&[0, 1, 0, 0], body.as_slice()].concat())
}

fn grid_map(layers: &Layers) -> GridMap {
    let [length_x, length_y] = layers.extent();
    let [x, y] = layers.corner;
    GridMap {
        header: header(),
        info: Info {
            resolution: layers.resolution,
            length_x,
            length_y,
            pose: pose(x + length_x / 2.0, y + length_y / 2.0),
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

fn header() -> Header {
    Header {
        stamp: Time { sec: 0, nanosec: 0 },
        frame_id: FRAME.into(),
    }
}

fn pose(x: f64, y: f64) -> Pose {
    Pose {
        position: [x, y, 0.0],
        orientation: [0.0, 0.0, 0.0, 1.0],
    }
}

#[derive(Serialize)]
struct MapMetaData {
    map_load_time: Time,
    resolution: f32,
    width: u32,
    height: u32,
    origin: Pose,
}

#[derive(Serialize)]
struct OccupancyGrid {
    header: Header,
    info: MapMetaData,
    data: Vec<i8>,
}

fn occupancy(layers: &Layers, traversability: &Layer) -> OccupancyGrid {
    let cost = |&t: &f32| t.is_finite().then_some(1.0 - t);
    OccupancyGrid {
        header: header(),
        info: MapMetaData {
            map_load_time: Time { sec: 0, nanosec: 0 },
            resolution: layers.resolution as f32,
            width: layers.columns as u32,
            height: layers.rows as u32,
            origin: pose(layers.corner[0], layers.corner[1]),
        },
        data: traversability
            .values
            .iter()
            .map(|t| rugosa::traversability::occupancy(cost(t)))
            .collect(),
    }
}

const GRID_MAP: &str = include_str!("grid_map.msg");
const OCCUPANCY: &str = include_str!("occupancy_grid.msg");
