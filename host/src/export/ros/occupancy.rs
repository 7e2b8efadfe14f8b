//! `nav_msgs/msg/OccupancyGrid`: row-major from the lower left cell, 0 free … 100
//! impassable, −1 unknown.

use super::{Header, Message, Pose, Time};
use crate::layers::{Layer, Layers};
use serde::Serialize;

#[derive(Serialize)]
struct MapMetaData {
    map_load_time: Time,
    resolution: f32,
    width: u32,
    height: u32,
    origin: Pose,
}

#[derive(Serialize)]
pub(super) struct OccupancyGrid {
    header: Header,
    info: MapMetaData,
    data: Vec<i8>,
}

impl Message for OccupancyGrid {
    const NAME: &'static str = "nav_msgs/msg/OccupancyGrid";
    const SCHEMA: &'static str = include_str!("occupancy_grid.msg");
}

/// The layer `traversability` as costs.
pub(super) fn occupancy(layers: &Layers, traversability: &Layer) -> OccupancyGrid {
    let cost = |&t: &f32| t.is_finite().then_some(1.0 - t);
    OccupancyGrid {
        header: Header::default(),
        info: MapMetaData {
            map_load_time: Time::default(),
            resolution: layers.resolution as f32,
            width: layers.columns as u32,
            height: layers.rows as u32,
            origin: Pose::at(layers.corner[0], layers.corner[1]),
        },
        data: traversability
            .values
            .iter()
            .map(|t| rugosa::traversability::occupancy(cost(t)))
            .collect(),
    }
}
