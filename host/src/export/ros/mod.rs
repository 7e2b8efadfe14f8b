//! A ROS 2 bag (MCAP, CDR, schemas included) of one map:
//!
//! | topic | message |
//! |---|---|
//! | `/grid_map` | `grid_map_msgs/msg/GridMap`, all layers |
//! | `/occupancy` | `nav_msgs/msg/OccupancyGrid`, where the map has costs |
//! | `/points` | `sensor_msgs/msg/PointCloud2`, one point per measured cell |
//! | `/grid` | `foxglove_msgs/msg/Grid`, coloured terrain for Foxglove's 3D panel |

mod cloud;
mod foxglove;
mod grid_map;
mod occupancy;

use crate::error::{Failure, Result};
use crate::io::atomic;
use crate::layers::Layers;
use byteorder::LittleEndian;
use cdr_encoding::to_vec;
use mcap::records::MessageHeader;
use serde::Serialize;
use std::collections::BTreeMap;
use std::io::{Cursor, Seek, Write};
use std::path::Path;

/// Coordinate frame of the map.
const FRAME: &str = "map";

/// A message with its ROS 2 type.
trait Message: Serialize {
    /// package/msg/Type
    const NAME: &'static str;
    /// definition, with those of all types in it
    const SCHEMA: &'static str;
}

#[derive(Default, Serialize)]
struct Time {
    sec: i32,
    nanosec: u32,
}

#[derive(Serialize)]
struct Header {
    stamp: Time,
    frame_id: &'static str,
}

impl Default for Header {
    fn default() -> Self {
        Header {
            stamp: Time::default(),
            frame_id: FRAME,
        }
    }
}

#[derive(Serialize)]
struct Pose {
    position: [f64; 3],
    orientation: [f64; 4],
}

impl Pose {
    fn at(x: f64, y: f64) -> Self {
        Pose {
            position: [x, y, 0.0],
            orientation: [0.0, 0.0, 0.0, 1.0],
        }
    }
}

/// Writes the bag.
pub fn write(path: &Path, layers: &Layers) -> Result<()> {
    let bytes = encode(layers).map_err(|error| Failure::write(path, error))?;
    atomic::write(path, |writer| writer.write_all(&bytes))
}

fn encode(layers: &Layers) -> Result<Vec<u8>, String> {
    let mut bytes = Cursor::new(Vec::new());
    let options = mcap::WriteOptions::new().profile("ros2").library("rugosa");
    let mut writer = options.create(&mut bytes).map_err(text)?;
    put(&mut writer, "/grid_map", &grid_map::grid_map(layers))?;
    if let Some(traversability) = layers.get("traversability") {
        let occupancy = occupancy::occupancy(layers, traversability);
        put(&mut writer, "/occupancy", &occupancy)?;
    }
    if let Some(elevation) = layers.get("elevation") {
        put(&mut writer, "/points", &cloud::cloud(layers, elevation))?;
        put(&mut writer, "/grid", &foxglove::grid(layers, elevation))?;
    }
    writer.finish().map_err(text)?;
    drop(writer);
    Ok(bytes.into_inner())
}

fn put<W: Write + Seek, M: Message>(
    writer: &mut mcap::Writer<W>,
    topic: &str,
    message: &M,
) -> Result<(), String> {
    let schema = writer
        .add_schema(M::NAME, "ros2msg", M::SCHEMA.as_bytes())
        .map_err(text)?;
    let channel = writer.add_channel(schema, topic, "cdr", &BTreeMap::new());
    let header = MessageHeader {
        channel_id: channel.map_err(text)?,
        sequence: 0,
        log_time: 0,
        publish_time: 0,
    };
    // CDR, little-endian, with its encapsulation header
    let body = to_vec::<_, LittleEndian>(message).map_err(text)?;
    let data = [&[0, 1, 0, 0], body.as_slice()].concat();
    writer.write_to_known_channel(&header, &data).map_err(text)
}

fn text(error: impl std::fmt::Display) -> String {
    error.to_string()
}
