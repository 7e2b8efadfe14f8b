//! A map as its layers: named rasters on the same cells.

use crate::error::{Failure, Result};
use crate::io::Raster;
use std::ops::Range;

/// Layers that are elevations above the origin.
pub const HEIGHTS: [&str; 8] = [
    "elevation",
    "upper_bound",
    "lower_bound",
    "lowest",
    "highest",
    "sample",
    "mean",
    "realisation",
];

/// One named quantity.
#[derive(Clone, Debug, PartialEq)]
pub struct Layer {
    /// name in files and messages
    pub name: String,
    /// unit, empty for pure numbers
    pub unit: String,
    /// one value per cell, row = y ascending; NaN unknown
    pub values: Vec<f32>,
}

/// All layers of a map of square cells.
///
/// Cell (row i, column j) covers `corner + [j, i] · resolution` and one resolution more.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Layers {
    /// cells along y
    pub rows: usize,
    /// cells along x
    pub columns: usize,
    /// cell edge \[m\]
    pub resolution: f64,
    /// x and y of the corner of cell (0, 0) \[m\]
    pub corner: [f64; 2],
    /// these coordinates minus those of the mapper \[m\]; 0 for a robot's map
    pub shift: [f64; 2],
    /// the layers
    pub layers: Vec<Layer>,
}

impl Layers {
    /// A map of one layer, `elevation`. The nodes of the raster become the centres of
    /// the cells; the spacings must be equal.
    pub fn of_raster(raster: &Raster) -> Result<Self> {
        let (dx, dy) = (raster.spacing_x, raster.spacing_y);
        if (dx - dy).abs() > 1e-6 * dx {
            return Err(Failure::input(format_args!(
                "cells of {dx} × {dy} m: square cells are needed here"
            )));
        }
        let mut layers = Layers {
            rows: raster.rows,
            columns: raster.columns,
            resolution: dx,
            corner: [raster.origin[0] - dx / 2.0, raster.origin[1] - dx / 2.0],
            shift: [0.0; 2],
            layers: Vec::new(),
        };
        layers.add("elevation", "m", raster.values.clone());
        Ok(layers)
    }

    /// Adds a layer of `rows × columns` values.
    pub fn add(&mut self, name: &str, unit: &str, values: Vec<f32>) {
        assert_eq!(values.len(), self.rows * self.columns, "layer {name}");
        self.layers.push(Layer {
            name: name.into(),
            unit: unit.into(),
            values,
        });
    }

    /// The layer of this name.
    pub fn get(&self, name: &str) -> Option<&Layer> {
        self.layers.iter().find(|l| l.name == name)
    }

    /// A layer as a raster whose nodes are the centres of the cells.
    pub fn raster(&self, layer: &Layer) -> Raster {
        let half = self.resolution / 2.0;
        let origin = [self.corner[0] + half, self.corner[1] + half];
        Raster::square(
            self.rows,
            self.columns,
            self.resolution,
            origin,
            layer.values.clone(),
        )
    }

    /// A rectangle of cells.
    pub fn part(&self, rows: Range<usize>, columns: Range<usize>) -> Self {
        let offset = [columns.start, rows.start].map(|i| i as f64 * self.resolution);
        let cut = |layer: &Layer| {
            let row = |i: usize| &layer.values[i * self.columns..][columns.clone()];
            Layer {
                values: rows.clone().flat_map(row).copied().collect(),
                ..layer.clone()
            }
        };
        Layers {
            rows: rows.len(),
            columns: columns.len(),
            resolution: self.resolution,
            corner: [self.corner[0] + offset[0], self.corner[1] + offset[1]],
            shift: self.shift,
            layers: self.layers.iter().map(cut).collect(),
        }
    }

    /// Lifts the layers that are elevations.
    pub fn raise(&mut self, by: f32) {
        let lifted = |l: &&mut Layer| HEIGHTS.contains(&l.name.as_str());
        for layer in self.layers.iter_mut().filter(lifted) {
            layer.values.iter_mut().for_each(|v| *v += by);
        }
    }

    /// Extent along x and y \[m\].
    pub fn extent(&self) -> [f64; 2] {
        [
            self.columns as f64 * self.resolution,
            self.rows as f64 * self.resolution,
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_part_keeps_its_place() {
        let values = (0..12).map(|v| v as f32).collect();
        let map = Layers::of_raster(&Raster::square(3, 4, 0.5, [10.25, 20.25], values)).unwrap();
        let part = map.part(1..3, 2..4);
        assert_eq!(part.layers[0].values, [6.0, 7.0, 10.0, 11.0]);
        assert_eq!(part.corner, [11.0, 20.5]);
        assert_eq!(part.extent(), [1.0, 1.0]);
    }
}
