//! nav2's map server: a picture of costs and its description.
//!
//! | mode | files | pixels |
//! |---|---|---|
//! | raw | `map.pgm`, `map.yaml` | occupancies: 0 free … 100 impassable, 255 unknown (the server takes 101 and more as unknown) |
//! | trinary | `map_trinary.pgm`, `map_trinary.yaml` | 254 passable at whatever cost, 0 impassable, 205 unknown |
//!
//! Row 0 of the picture is the greatest y; `origin` is the lower left corner.

use crate::error::{Failure, Result};
use crate::io::atomic;
use crate::layers::Layers;
use std::path::{Path, PathBuf};

/// How costs become pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mode {
    /// graded costs
    Raw,
    /// free, impassable, unknown
    Trinary,
}

impl Mode {
    const fn names(self) -> (&'static str, &'static str) {
        match self {
            Mode::Raw => ("raw", "map"),
            Mode::Trinary => ("trinary", "map_trinary"),
        }
    }

    /// The pixel of a cost 0 … 1; NaN is unknown.
    fn pixel(self, cost: f32) -> u8 {
        match self {
            Mode::Raw if cost.is_finite() => (cost.clamp(0.0, 1.0) * 100.0).round() as u8,
            Mode::Raw => 255,
            Mode::Trinary if cost >= 1.0 => 0,
            Mode::Trinary if cost.is_finite() => 254,
            Mode::Trinary => 205,
        }
    }
}

/// Writes the layer `traversability` (1 good … 0 impassable, NaN unknown) as cost.
pub fn write(directory: &Path, layers: &Layers, mode: Mode) -> Result<Vec<PathBuf>> {
    let layer = layers.get("traversability");
    let layer =
        layer.ok_or_else(|| Failure::input("nav2: the map has no layer 'traversability'"))?;
    let (_, stem) = mode.names();
    let image = directory.join(format!("{stem}.pgm"));
    let yaml = directory.join(format!("{stem}.yaml"));
    let mut pgm = format!("P5\n{} {}\n255\n", layers.columns, layers.rows).into_bytes();
    let rows = layer.values.chunks(layers.columns).rev();
    pgm.extend(rows.flatten().map(|&v| mode.pixel(1.0 - v)));
    atomic::write(&image, |writer| writer.write_all(&pgm))?;
    atomic::write(&yaml, |writer| {
        writer.write_all(description(layers, mode).as_bytes())
    })?;
    Ok(vec![image, yaml])
}

fn description(layers: &Layers, mode: Mode) -> String {
    let [x, y] = layers.corner;
    let resolution = layers.resolution;
    let (mode, stem) = mode.names();
    format!(
        "image: {stem}.pgm\nmode: {mode}\nresolution: {resolution}\norigin: [{x}, {y}, 0.0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
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
            shift: [0.0; 2],
            layers: Vec::new(),
        };
        layers.add(
            "traversability",
            "",
            vec![1.0, 0.75, f32::NAN, 0.0, 0.5, -1.0],
        );
        let directory = tempfile::tempdir().unwrap();
        write(directory.path(), &layers, Mode::Raw).unwrap();
        write(directory.path(), &layers, Mode::Trinary).unwrap();
        let pgm = std::fs::read(directory.path().join("map_trinary.pgm")).unwrap();
        assert_eq!(pgm, b"P5\n3 2\n255\n\x00\xfe\x00\xfe\xfe\xcd");
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
        write(Path::new("/nonexistent"), &bare, Mode::Raw)
    }
}
