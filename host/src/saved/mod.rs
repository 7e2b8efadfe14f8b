//! Saved maps: every cell exactly, so that a map can be loaded again, cut and merged.
//!
//! | file | what |
//! |---|---|
//! | `file` | the file: a NumPy archive (`.rugosa`) |
//! | `merge` | maps of several robots or runs become one |
//!
//! What is saved are the cells ([`SavedCell`]). Loaded into a mapper they give the same
//! layers, bit for bit, except for those of the reconstruction, which starts afresh.
//!
//! ```
//! use rugosa::Mapper;
//! use rugosa_host::{config::Settings, planes::HeapPlanes, saved::SavedMap};
//! # fn main() -> rugosa_host::error::Result<()> {
//! # let folder = tempfile::tempdir().unwrap();
//! # let path = folder.path().join("map.rugosa");
//! let settings = Settings::default();
//! let mut planes = HeapPlanes::new(settings.side);
//! let mapper = Mapper::new(settings.mapper, planes.lend()).unwrap();
//! SavedMap::of(&mapper).write(&path)?;
//! assert_eq!(SavedMap::read(&path)?, SavedMap::of(&mapper));
//! # Ok(()) }
//! ```

mod file;
mod merge;

use crate::bridge::layers_of;
use crate::config::{Settings, decimal};
use crate::error::{Failure, Result};
use crate::layers::Layers;
use crate::planes::HeapPlanes;
use rugosa::restore::Place;
use rugosa::{Config, Mapper, SweepReport, is_side};
use rugosa_grid::{Cell, State, TILE};
use rugosa_terrain::grid::SavedCell;

/// Greatest side of a map in cells.
pub const MOST: usize = 1025;
/// Cells beyond which single precision tells positions apart no more; maps farther away
/// are loaded nearer to the origin.
const FAR: i64 = 1 << 16;

/// What several maps say of a cell, in integers, so that sums do not depend on an order.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Evidence {
    /// Σ 1 / variance, in 2⁻¹⁶ m⁻²
    pub weight: u64,
    /// Σ elevation / variance, in 2⁻³⁶ m⁻¹
    pub moment: i128,
}

/// A rectangle of cells as they are.
///
/// Cell (row i, column j) is number `cell + [j, i]` and covers, in the file's coordinates,
/// one resolution from `(cell + [j, i]) · resolution + shift`; heights are above
/// `rise · height_step`.
#[derive(Clone, Debug, PartialEq)]
pub struct SavedMap {
    /// cell edge \[m\]
    pub resolution: f32,
    /// step of the integer heights \[m\]
    pub height_step: f32,
    /// number of the lowest cell, x and y
    pub cell: [i64; 2],
    /// from the mapper's to the file's coordinates \[m\]
    pub shift: [f64; 2],
    /// the same upwards, in height steps
    pub rise: i64,
    /// number of the last sweep
    pub sweep: u32,
    /// cells along y
    pub rows: usize,
    /// cells along x
    pub columns: usize,
    /// row by row from the lowest cell
    pub cells: Vec<SavedCell>,
    /// of a merged map: what its cells rest on
    pub evidence: Option<Vec<Evidence>>,
}

impl SavedMap {
    /// All cells of a mapper.
    pub fn of(mapper: &Mapper) -> Self {
        let (window, config) = (mapper.window(), mapper.config());
        let origin = window.origin();
        let side = window.side();
        let cell = |i: usize| origin.offset((i % side) as i32, (i / side) as i32);
        SavedMap {
            resolution: config.resolution,
            height_step: config.height_step(),
            cell: [origin.x.into(), origin.y.into()],
            shift: [0.0; 2],
            rise: 0,
            sweep: mapper.sweep(),
            rows: side,
            columns: side,
            cells: (0..side * side).map(|i| mapper.save(cell(i))).collect(),
            evidence: None,
        }
    }

    /// Number of the lowest cell in the lattice of the file's coordinates, and where that
    /// lattice lies within a cell \[m\].
    fn absolute(&self) -> ([i64; 2], [f64; 2]) {
        let resolution = decimal(self.resolution);
        let cells = self.shift.map(|s| (s / resolution + 1e-6).floor());
        let phase = [0, 1].map(|i| self.shift[i] - cells[i] * resolution);
        ([0, 1].map(|i| self.cell[i] + cells[i] as i64), phase)
    }

    /// x and y of the corner of the lowest cell \[m\].
    pub fn corner(&self) -> [f64; 2] {
        [0, 1].map(|i| self.cell[i] as f64 * decimal(self.resolution) + self.shift[i])
    }

    /// Cells that are measured.
    pub fn measured(&self) -> usize {
        let measured = self.cells.iter().filter(|c| c.state == State::Measured);
        measured.count()
    }

    /// The cells of a rectangle \[m\], `[x0, y0, x1, y1]`, that the map holds: every cell
    /// whose centre lies in it.
    pub fn crop(&self, [x0, y0, x1, y1]: [f64; 4]) -> Result<Self> {
        let (corner, resolution) = (self.corner(), decimal(self.resolution));
        let first = |low: f64, axis: usize| {
            let cells = (low - corner[axis]) / resolution - 0.5;
            (cells - 1e-6).ceil().max(0.0) as usize
        };
        let columns = first(x0, 0)..first(x1, 0).min(self.columns);
        let rows = first(y0, 1)..first(y1, 1).min(self.rows);
        if columns.is_empty() || rows.is_empty() {
            return Err(Failure::input(format_args!(
                "no cell of the map lies in {x0},{y0},{x1},{y1}"
            )));
        }
        let kept = || {
            let columns = columns.clone();
            rows.clone()
                .flat_map(move |row| columns.clone().map(move |column| (row, column)))
                .map(|(row, column)| row * self.columns + column)
        };
        let evidence = self.evidence.as_ref();
        Ok(SavedMap {
            cell: [
                self.cell[0] + columns.start as i64,
                self.cell[1] + rows.start as i64,
            ],
            rows: rows.len(),
            columns: columns.len(),
            cells: kept().map(|i| self.cells[i]).collect(),
            evidence: evidence.map(|all| kept().map(|i| all[i]).collect()),
            ..self.clone()
        })
    }

    /// Settings of a mapper that holds the map.
    pub fn fit(&self, mut settings: Settings) -> Result<Settings> {
        let most = self.rows.max(self.columns);
        let side = (most..=MOST).find(|&side| is_side(side));
        settings.side = side.ok_or_else(|| {
            let (rows, columns) = (self.rows, self.columns);
            Failure::input(format_args!(
                "{columns} × {rows} cells; {MOST} along an edge is possible: cut the map"
            ))
        })?;
        for (name, value) in [
            ("resolution", self.resolution),
            ("height_step", self.height_step),
        ] {
            let index = Config::index_of(name).expect("a known name");
            settings.mapper.set(index, value).map_err(Failure::input)?;
        }
        Ok(settings)
    }

    /// Puts the map into a mapper. Where the cells are too far from the origin for single
    /// precision they are moved by whole tiles; the layers know nothing of it.
    pub fn load(&self, mapper: &mut Mapper) -> Result<(SweepReport, Layers)> {
        let base = self.cell.map(|c| match c.abs() < FAR {
            true => 0,
            false => c - c.rem_euclid(TILE.into()),
        });
        let origin = [0, 1].map(|i| (self.cell[i] - base[i]) as i32);
        let origin = Cell::new(origin[0], origin[1]);
        let place = Place {
            origin,
            datum: self.datum()?,
            sweep: self.sweep,
        };
        let at = |i: usize| origin.offset((i % self.columns) as i32, (i / self.columns) as i32);
        let cells = self.cells.iter().enumerate();
        let (report, lost) = mapper.restore(&place, cells.map(|(i, saved)| (at(i), *saved)));
        if lost > 0 {
            return Err(Failure::input(format_args!(
                "{lost} cells do not fit into the map"
            )));
        }
        let mut layers = layers_of(mapper).part(0..self.rows, 0..self.columns);
        let (corner, before) = (self.corner(), layers.corner);
        layers.shift = [0, 1].map(|i| corner[i] - before[i]);
        layers.corner = corner;
        layers.raise((self.rise as f64 * f64::from(self.height_step)) as f32);
        Ok((report, layers))
    }

    /// Height steps in the middle of the heights that are there.
    fn datum(&self) -> Result<i32> {
        let measured = self.cells.iter().filter(|c| c.state == State::Measured);
        let range = measured.fold(None, |range: Option<(i32, i32)>, c| {
            let (low, high) = (c.min.min(c.height), c.max.max(c.height));
            Some(range.map_or((low, high), |(l, h)| (l.min(low), h.max(high))))
        });
        let Some((low, high)) = range else {
            return Ok(0);
        };
        if i64::from(high) - i64::from(low) > i64::from(u16::MAX) {
            let steps = i64::from(high) - i64::from(low);
            return Err(Failure::input(format_args!(
                "heights over {steps} steps of {} m; {} are possible",
                self.height_step,
                u16::MAX
            )));
        }
        let fits = |steps: i32| i16::try_from(steps).is_ok();
        let middle = i64::midpoint(low.into(), high.into()) as i32;
        Ok(if fits(low) && fits(high) { 0 } else { middle })
    }
}

/// A mapper with this map in it, its report and its layers.
pub fn load<'m>(
    map: &SavedMap,
    settings: &Settings,
    planes: &'m mut HeapPlanes,
) -> Result<(Mapper<'m>, SweepReport, Layers)> {
    let mut mapper = Mapper::new(settings.mapper, planes.lend()).map_err(Failure::input)?;
    let (report, layers) = map.load(&mut mapper)?;
    Ok((mapper, report, layers))
}

#[cfg(test)]
mod tests;
