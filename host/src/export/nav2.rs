//! nav2's map server: `map.pgm` and `map.yaml` in `mode: raw`, which keeps graded costs.
//!
//! Pixels are occupancies: 0 free … 100 lethal, 255 unknown (the server takes 101 and
//! more as unknown). Row 0 of the picture is the greatest y; `origin` is the lower left
//! corner.

use crate::error::{Failure, Result};
use crate::io::atomic;
use crate::layers::Layers;
use std::path::{Path, PathBuf};

/// What unknown cells are written as.
pub const UNKNOWN: u8 = 255;

/// Writes the layer `traversability` (1 good … 0 impassable, NaN unknown) as cost.
pub fn write(directory: &Path, layers: &Layers) -> Result<Vec<PathBuf>> {
    let layer = layers.get("traversability");
    let layer =
        layer.ok_or_else(|| Failure::input("nav2: the map has no layer 'traversability'"))?;
    let image = directory.join("map.pgm");
    let yaml = directory.join("map.yaml");
    let mut pgm = format!("P5\n{} {}\n255\n", layers.columns, layers.rows).into_bytes();
    let rows = layer.values.chunks(layers.columns).rev();
    pgm.extend(rows.flatten().map(|&v| pixel(1.0 - v)));
    atomic::write(&image, |writer| writer.write_all(&pgm))?;
    atomic::write(&yaml, |writer| {
        writer.write_all(description(layers).as_bytes())
    })?;
    Ok(vec![image, yaml])
}

fn pixel(cost: f32) -> u8 {
    if cost.is_finite() {
        (cost.clamp(0.0, 1.0) * 100.0).round() as u8
    } else {
        UNKNOWN
    }
}

fn description(layers: &Layers) -> String {
    let [x, y] = layers.corner;
    let resolution = layers.resolution;
    format!(
        "image: map.pgm\nmode: raw\nresolution: {resolution}\norigin: [{x}, {y}, 0.0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_greatest_y_is_the_first_row() {
        let mut layers = Layers {
            rows: 2,
            columns: 3,
            resolution: 0.5,
            corner: [-1.0, 2.0],
            layers: Vec::new(),
        };
        layers.add(
            "traversability",
            "",
            vec![1.0, 0.75, f32::NAN, 0.0, 0.5, -1.0],
        );
        let directory = tempfile::tempdir().unwrap();
        write(directory.path(), &layers).unwrap();
        let pgm = std::fs::read(directory.path().join("map.pgm")).unwrap();
        assert_eq!(pgm, b"P5\n3 2\n255\n\x64\x32\x64\x00\x19\xff");
        let yaml = std::fs::read_to_string(directory.path().join("map.yaml")).unwrap();
        assert!(yaml.contains("origin: [-1, 2, 0.0]") && yaml.contains("mode: raw"));
        assert!(nav2_without_cost(&layers).is_err());
    }

    fn nav2_without_cost(layers: &Layers) -> Result<Vec<PathBuf>> {
        let bare = Layers {
            layers: Vec::new(),
            ..layers.clone()
        };
        write(Path::new("/nonexistent"), &bare)
    }
}
