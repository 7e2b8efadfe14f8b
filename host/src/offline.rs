//! A map from files, without a robot: points or rasters in, all layers out.
//!
//! The cloud is moved to the map's origin (so that single precision suffices whatever
//! its coordinates), mapped as if seen from high above, and moved back. The map is the
//! smallest that holds it.

use crate::bridge::layers_of;
use crate::config::Settings;
use crate::error::{Failure, Result};
use crate::io::{Dataset, Points};
use crate::layers::Layers;
use crate::planes::HeapPlanes;
use crate::saved::{MOST, SavedMap};
use nalgebra::Isometry3;
use rugosa::{Mapper, SweepReport, is_side};
use rugosa_terrain::Noise;
use rugosa_terrain::grid::View;

/// Integer heights that a map has room for.
const HEIGHTS: f64 = 60_000.0;
/// Height of the eye above the middle, in half diagonals: no beam is flatter than 63°.
const EYE: f64 = 2.0;
/// Points per cell that an automatic resolution aims at.
const PER_CELL: f64 = 4.0;
/// Points that are mapped between two looks at the progress.
const BLOCK: usize = 65_536;

/// Points, and the map that holds them.
pub struct Cloud {
    points: Points,
    /// cell edge \[m\]
    pub resolution: f64,
    /// x and y of the corner of the lowest cell \[m\]
    corner: [f64; 2],
    /// cells along x and y
    cells: [usize; 2],
    /// least and greatest z \[m\]
    heights: [f64; 2],
}

/// A finished map.
pub struct Mapped<'m> {
    /// the mapper, in the coordinates it worked in
    pub mapper: Mapper<'m>,
    /// its report
    pub report: SweepReport,
    /// the layers, in the coordinates of the files
    pub layers: Layers,
    /// all cells, to be saved
    pub saved: SavedMap,
}

impl Cloud {
    /// The points of all files. Without a resolution that of the raster is taken, or one
    /// with about four points per cell; nodes of a raster are centres of cells.
    pub fn of(data: Vec<Dataset>, resolution: Option<f64>) -> Result<Self> {
        let (spacing, node) = lattice(&data)?;
        let points = merged(data);
        if points.xyz.is_empty() {
            return Err(Failure::input("there are no points to map"));
        }
        let (low, high) = points.bounds();
        let resolution = match resolution.or(spacing) {
            Some(resolution) => resolution,
            None => suited(low, high, points.xyz.len()),
        };
        let node = if spacing == Some(resolution) {
            node
        } else {
            [0.5 * resolution; 2]
        };
        // corners of cells lie half a cell beside nodes
        let corner = [0, 1].map(|axis| {
            let phase = node[axis] - 0.5 * resolution;
            ((low[axis] - phase) / resolution + 1e-6).floor() * resolution + phase
        });
        let cells = [0, 1]
            .map(|axis| ((high[axis] - corner[axis]) / resolution + 1e-6).floor() as usize + 1);
        Ok(Cloud {
            points,
            resolution,
            corner,
            cells,
            heights: [low[2], high[2]],
        })
    }

    /// Points that go into the map, and points that were left out.
    pub fn points(&self) -> [usize; 2] {
        [self.points.xyz.len(), self.points.skipped]
    }

    /// Bytes of the points.
    pub fn bytes(&self) -> usize {
        size_of_val(&self.points.xyz[..])
    }

    /// Cells along x and y.
    pub fn cells(&self) -> [usize; 2] {
        self.cells
    }

    /// Settings of a map that holds the cloud.
    pub fn fit(&self, mut settings: Settings) -> Result<Settings> {
        let most = self.cells[0].max(self.cells[1]);
        let side = (most..=MOST).find(|&side| is_side(side));
        settings.side = side.ok_or_else(|| {
            let [x, y] = self.cells;
            Failure::input(format_args!("{x} × {y} cells of {} m; {MOST} along an edge is possible: give a greater --resolution", self.resolution))
        })?;
        let relief = self.heights[1] - self.heights[0];
        let config = &mut settings.mapper;
        let step = (self.resolution / 200.0).max(relief / HEIGHTS);
        for (name, value) in [("resolution", self.resolution), ("height_step", step)] {
            let index = rugosa::Config::index_of(name).expect("a known name");
            config.set(index, value as f32).map_err(Failure::input)?;
        }
        Ok(settings)
    }

    /// Maps the cloud into `planes`; `noise_std` is the standard deviation of the heights.
    pub fn map<'m>(
        &self,
        settings: &Settings,
        noise_std: f64,
        planes: &'m mut HeapPlanes,
        mut watch: impl FnMut(usize),
    ) -> Result<Mapped<'m>> {
        let mut mapper = Mapper::new(settings.mapper, planes.lend()).map_err(Failure::input)?;
        let origin = mapper.window().origin();
        let config = mapper.config();
        // by whole height steps, so that maps can be merged
        let middle = 0.5 * (self.heights[0] + self.heights[1]);
        let rise = (middle / f64::from(config.height_step())).round() as i64;
        let shift = [
            self.corner[0] - f64::from(origin.x) * self.resolution,
            self.corner[1] - f64::from(origin.y) * self.resolution,
            f64::from(config.height_step()) * rise as f64,
        ];
        let middle = [0, 1].map(|axis| {
            self.corner[axis] - shift[axis] + 0.5 * self.cells[axis] as f64 * self.resolution
        });
        let eye = [middle[0], middle[1], EYE * self.half_diagonal()];
        let view = View {
            map_from_sensor: &Isometry3::translation(eye[0] as f32, eye[1] as f32, eye[2] as f32),
            noise: &Noise::new(noise_std as f32, 0.0, 0.0),
            sweep: 0,
        };
        let seen = |p: &[f64; 3]| {
            [0, 1, 2].map(|axis| (p[axis] - shift[axis] - f64::from(eye[axis] as f32)) as f32)
        };
        for (i, block) in self.points.xyz.chunks(BLOCK).enumerate() {
            let block: Vec<[f32; 3]> = block.iter().map(seen).collect();
            mapper.points(&block, &view);
            watch(i * BLOCK + block.len());
        }
        let report = mapper.commit(&mut |_| {});
        let mut layers = layers_of(&mapper).part(0..self.cells[1], 0..self.cells[0]);
        (layers.corner, layers.resolution) = (self.corner, self.resolution);
        layers.shift = [shift[0], shift[1]];
        layers.raise(shift[2] as f32);
        let saved = SavedMap {
            shift: [shift[0], shift[1]],
            rise,
            ..SavedMap::of(&mapper)
        };
        let [x0, y0] = self.corner;
        let [width, height] = self.cells.map(|n| n as f64 * self.resolution);
        Ok(Mapped {
            saved: saved.crop([x0, y0, x0 + width, y0 + height])?,
            mapper,
            report,
            layers,
        })
    }

    fn half_diagonal(&self) -> f64 {
        let [x, y] = self.cells.map(|n| n as f64 * self.resolution);
        0.5 * x.hypot(y)
    }
}

/// Spacing and a node of the rasters; `None` where there are only points.
fn lattice(data: &[Dataset]) -> Result<(Option<f64>, [f64; 2])> {
    let (mut spacing, mut node) = (None, [0.0; 2]);
    for set in data {
        let Dataset::Raster(raster) = set else {
            continue;
        };
        if (raster.spacing_x - raster.spacing_y).abs() > 1e-6 * raster.spacing_x {
            return Err(Failure::input(format_args!(
                "a raster of {} × {} m; equal spacings in x and y are needed",
                raster.spacing_x, raster.spacing_y
            )));
        }
        if spacing.is_some_and(|s| s != raster.spacing_x) {
            return Err(Failure::input(
                "rasters of different spacings: map them one by one",
            ));
        }
        (spacing, node) = (Some(raster.spacing_x), raster.origin);
    }
    Ok((spacing, node))
}

fn merged(data: Vec<Dataset>) -> Points {
    let mut all = Points::default();
    for set in data {
        match set {
            Dataset::Points(points) => {
                all.skipped += points.skipped;
                all.xyz.extend(points.xyz);
            }
            Dataset::Raster(raster) => all.xyz.extend(raster.points()),
        }
    }
    all
}

/// The least of 1, 2, 5 · 10ᵏ metres with about four points per cell.
fn suited(low: [f64; 3], high: [f64; 3], points: usize) -> f64 {
    let [x, y] = [high[0] - low[0], high[1] - low[1]];
    let by_density = (x.max(1e-3) * y.max(1e-3) * PER_CELL / points as f64).sqrt();
    let by_size = x.max(y) / (MOST as f64 - 2.0);
    crate::draw::round_up(by_density.max(by_size).max(1e-3))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::io::Raster;

    fn map(data: Vec<Dataset>) -> Layers {
        let cloud = Cloud::of(data, None).unwrap();
        let settings = cloud.fit(Settings::default()).unwrap();
        let mut planes = HeapPlanes::new(settings.side);
        cloud
            .map(&settings, 0.001, &mut planes, |_| {})
            .unwrap()
            .layers
    }

    #[test]
    fn a_raster_far_away_comes_back_cell_by_cell() {
        let mut values: Vec<f32> = (0..40 * 50)
            .map(|i| 1500.0 + 0.01 * (i % 50) as f32 + 0.02 * (i / 50) as f32)
            .collect();
        values[7] = f32::NAN;
        let raster = Raster::square(40, 50, 0.25, [500_000.125, 4_000_000.0], values.clone());
        let layers = map(vec![Dataset::Raster(raster)]);
        assert_eq!(
            (layers.rows, layers.columns, layers.resolution),
            (40, 50, 0.25)
        );
        assert_eq!(layers.corner, [500_000.0, 4_000_000.0 - 0.125]);
        let back = &layers.get("elevation").unwrap().values;
        for (i, (a, b)) in values.iter().zip(back).enumerate() {
            assert!(
                (a - b).abs() < 1e-3 || a.is_nan() && b.is_nan(),
                "node {i}: {a} became {b}"
            );
        }
    }

    #[test]
    fn points_get_a_suitable_resolution() {
        let xyz = (0..10_000)
            .map(|i| [f64::from(i % 100) * 0.1, f64::from(i / 100) * 0.1, 0.0])
            .collect();
        let layers = map(vec![Dataset::Points(Points { xyz, skipped: 0 })]);
        assert_eq!(layers.resolution, 0.2);
        assert_eq!((layers.rows, layers.columns), (50, 50));
        assert!(
            layers
                .get("elevation")
                .unwrap()
                .values
                .iter()
                .all(|v| v.is_finite())
        );
    }
}
