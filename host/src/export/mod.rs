//! A map in the formats others read.

pub mod geotiff;
pub mod grid_map;
pub mod mesh;
pub mod nav2;
pub mod picture;

use crate::error::Result;
use crate::io::{asc, npy};
use crate::layers::Layers;
use clap::ValueEnum;
use std::path::{Path, PathBuf};

/// A format of files.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Format {
    /// NumPy arrays, one per layer: row = y ascending, NaN unknown
    Npy,
    /// ESRI ASCII grids, one per layer
    Asc,
    /// GeoTIFF, one per layer, float32
    Geotiff,
    /// pictures with legend, one per layer
    Png,
    /// the elevation as a triangle mesh
    Ply,
    /// map.yaml + map.pgm for the map server of nav2 of nav2, graded costs
    Nav2,
    /// ROS 2 bag with grid_map_msgs/msg/GridMap and nav_msgs/msg/OccupancyGrid
    Mcap,
}

/// Writes the map in each of the formats and returns the files.
pub fn save(layers: &Layers, directory: &Path, formats: &[Format]) -> Result<Vec<PathBuf>> {
    let mut files = Vec::new();
    for format in formats {
        files.extend(format.save(layers, directory)?);
    }
    Ok(files)
}

impl Format {
    fn save(self, layers: &Layers, directory: &Path) -> Result<Vec<PathBuf>> {
        let one = |name: &str, written: fn(&Path, &Layers) -> Result<()>| {
            let path = directory.join(name);
            written(&path, layers).map(|()| vec![path])
        };
        match self {
            Format::Ply => one("surface.ply", mesh::write),
            Format::Mcap => one("map.mcap", grid_map::write),
            Format::Nav2 => nav2::write(directory, layers),
            Format::Npy | Format::Asc | Format::Geotiff | Format::Png => {
                self.each(layers, directory)
            }
        }
    }

    /// One file per layer.
    fn each(self, layers: &Layers, directory: &Path) -> Result<Vec<PathBuf>> {
        let mut files = Vec::new();
        for layer in &layers.layers {
            let path = directory.join(format!("{}.{}", layer.name, self.extension()));
            let raster = layers.raster(layer);
            match self {
                Format::Asc => asc::write(&path, &raster)?,
                Format::Geotiff => geotiff::write(&path, &raster)?,
                Format::Png => picture::write(&path, layer, &raster)?,
                _ => npy::write(&path, raster.rows, raster.columns, &raster.values)?,
            }
            files.push(path);
        }
        Ok(files)
    }

    fn extension(self) -> &'static str {
        match self {
            Format::Npy => "npy",
            Format::Asc => "asc",
            Format::Geotiff => "tif",
            Format::Png => "png",
            Format::Ply => "ply",
            Format::Nav2 => "yaml",
            Format::Mcap => "mcap",
        }
    }
}
