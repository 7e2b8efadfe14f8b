//! A map in the formats others read.

pub mod geotiff;
pub mod mesh;
pub mod nav2;
pub mod npz;
pub mod picture;
pub mod ros;

use crate::error::Result;
use crate::io::{asc, npy};
use crate::layers::Layers;
use crate::saved::SavedMap;
use clap::ValueEnum;
use std::path::{Path, PathBuf};

/// A format of files.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Format {
    /// NumPy arrays, one per layer: row = y ascending, NaN unknown
    Npy,
    /// all layers in one NumPy archive, with resolution and corner
    Npz,
    /// ESRI ASCII grids, one per layer
    Asc,
    /// GeoTIFF, one per layer, float32
    Geotiff,
    /// pictures with legend, one per layer
    Png,
    /// the elevation as a triangle mesh
    Ply,
    /// map.yaml + map.pgm for the map server of nav2, graded costs (mode raw)
    Nav2,
    /// map_trinary.yaml + map_trinary.pgm for the same: free, impassable or unknown
    Nav2Trinary,
    /// every cell exactly, to be loaded, cut and merged again (map.rugosa)
    Rugosa,
    /// ROS 2 bag: GridMap, OccupancyGrid, PointCloud2, Foxglove's Grid
    Mcap,
}

/// Writes the map in each of the formats and returns the files.
///
/// ```
/// use rugosa_host::config::Settings;
/// use rugosa_host::export::{self, Format};
/// use rugosa_host::io::{Dataset, Raster};
/// use rugosa_host::{offline::Cloud, planes::HeapPlanes};
/// # fn main() -> rugosa_host::error::Result<()> {
/// # let folder = tempfile::tempdir().unwrap();
/// let heights = (0..40 * 40).map(|i| 0.1 * (i % 7) as f32).collect();
/// let raster = Raster::square(40, 40, 0.25, [0.0, 0.0], heights);
/// let cloud = Cloud::of(vec![Dataset::Raster(raster)], None)?;
/// let settings = cloud.fit(Settings::default())?;
/// let mut planes = HeapPlanes::new(settings.side);
/// let map = cloud.map(&settings, 0.005, &mut planes, |_| {})?;
/// let files = export::save(&map.layers, &map.saved, folder.path(), &[Format::Mcap])?;
/// assert!(files[0].ends_with("map.mcap"));
/// # Ok(()) }
/// ```
pub fn save(
    layers: &Layers,
    saved: &SavedMap,
    directory: &Path,
    formats: &[Format],
) -> Result<Vec<PathBuf>> {
    let mut files = Vec::new();
    for format in formats {
        if *format == Format::Rugosa {
            let path = directory.join("map.rugosa");
            saved.write(&path)?;
            files.push(path);
        } else {
            files.extend(format.save(layers, directory)?);
        }
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
            Format::Mcap => one("map.mcap", ros::write),
            Format::Npz => one("map.npz", npz::write),
            Format::Nav2 => nav2::write(directory, layers, nav2::Mode::Raw),
            Format::Nav2Trinary => nav2::write(directory, layers, nav2::Mode::Trinary),
            Format::Rugosa => Ok(Vec::new()), // of the cells, not of the layers
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

    /// Of the formats with one file per layer.
    fn extension(self) -> &'static str {
        match self {
            Format::Asc => "asc",
            Format::Geotiff => "tif",
            Format::Png => "png",
            _ => "npy",
        }
    }
}
