//! The file of a saved map: a ZIP archive that NumPy opens (`numpy.load`).
//!
//! | member | type | content |
//! |---|---|---|
//! | `rugosa.json` | text | `format`, `resolution`, `height_step`, `cell`, `shift`, `rise`, `sweep` |
//! | `state` | u1 | 0 unknown, 1 measured, 2 seen through |
//! | `elevation`, `variance` | f4 | fused elevation \[m\], its variance \[m²\] |
//! | `min`, `max`, `height` | i4 | lowest and highest return, point sample, in height steps |
//! | `tally` | u2 | returns (low 13 bits), gated in a row (high 3 bits) |
//! | `last_sweep` | u2 | low 16 bits of the sweep that touched the cell last |
//! | `sample` | i4, last axis 4 | the sample's variance, offsets east and north, depression |
//! | `weight`, `moment` | u8; i8, last axis 2 | of a merged map: the sums (high and low half) |
//!
//! Arrays have rows (y ascending) × columns (x ascending) entries. `format` is 1; a file
//! of a later format is refused. The same map is always the same bytes.

use super::{Evidence, MOST, SavedMap};
use crate::error::{Failure, Result};
use crate::io::archive::{Archive, Writer};
use crate::io::{atomic, npy};
use npyz::{AutoSerialize, Deserialize as Element, NpyFile};
use rugosa_grid::State;
use rugosa_terrain::grid::SavedCell;
use serde::{Deserialize, Serialize};
use std::io::{self, Cursor};
use std::path::Path;

/// Version of the format.
const FORMAT: u32 = 1;
const HEAD: &str = "rugosa.json";

#[derive(Deserialize, Serialize)]
struct Head {
    format: u32,
    resolution: f32,
    height_step: f32,
    cell: [i64; 2],
    shift: [f64; 2],
    rise: i64,
    sweep: u32,
}

impl SavedMap {
    /// Writes the file.
    pub fn write(&self, path: &Path) -> Result<()> {
        atomic::write(path, |writer| self.encode(Writer::new(writer)))
    }

    fn encode(&self, mut archive: Writer) -> io::Result<()> {
        let head = Head {
            format: FORMAT,
            resolution: self.resolution,
            height_step: self.height_step,
            cell: self.cell,
            shift: self.shift,
            rise: self.rise,
            sweep: self.sweep,
        };
        archive.add(HEAD, |w| Ok(serde_json::to_writer(w, &head)?))?;
        self.plane(&mut archive, "state", |c| [c.state as u8])?;
        self.plane(&mut archive, "elevation", |c| [c.elevation])?;
        self.plane(&mut archive, "variance", |c| [c.variance])?;
        self.plane(&mut archive, "min", |c| [c.min])?;
        self.plane(&mut archive, "max", |c| [c.max])?;
        self.plane(&mut archive, "height", |c| [c.height])?;
        self.plane(&mut archive, "tally", |c| [c.tally])?;
        self.plane(&mut archive, "last_sweep", |c| [c.last_sweep])?;
        self.plane(&mut archive, "sample", |c| {
            let [east, north] = c.offset.map(i32::from);
            [c.sample_variance.into(), east, north, c.depression.into()]
        })?;
        if let Some(evidence) = &self.evidence {
            let weights: Vec<u64> = evidence.iter().map(|e| e.weight).collect();
            let halves = |e: &Evidence| [(e.moment >> 64) as i64, e.moment as i64];
            let moments: Vec<i64> = evidence.iter().flat_map(halves).collect();
            let shape = [self.rows as u64, self.columns as u64];
            archive.add("weight.npy", |w| npy::encode(w, &shape, &weights))?;
            let shape = [shape[0], shape[1], 2];
            archive.add("moment.npy", |w| npy::encode(w, &shape, &moments))?;
        }
        archive.finish()
    }

    fn plane<T: AutoSerialize + Copy, const N: usize>(
        &self,
        archive: &mut Writer,
        name: &str,
        of: impl Fn(&SavedCell) -> [T; N],
    ) -> io::Result<()> {
        let values: Vec<T> = self.cells.iter().flat_map(of).collect();
        let shape = [self.rows as u64, self.columns as u64, N as u64];
        let shape = if N == 1 { &shape[..2] } else { &shape };
        archive.add(&format!("{name}.npy"), |w| npy::encode(w, shape, &values))
    }

    /// Reads the file.
    pub fn read(path: &Path) -> Result<Self> {
        let mut archive = Archive::open(path)?;
        let head = archive
            .bytes(HEAD)?
            .ok_or_else(|| Failure::file(path, format_args!("no saved map: it has no {HEAD}")))?;
        let head: Head = serde_json::from_slice(&head)
            .map_err(|e| Failure::file(path, format_args!("{HEAD}: {e}")))?;
        if head.format != FORMAT {
            let message = format_args!("format {}; this is format {FORMAT}", head.format);
            return Err(Failure::file(path, message));
        }
        let mut file = Arrays {
            path,
            archive,
            shape: None,
        };
        let mut cells: Vec<SavedCell> = file.read::<u8>("state", 1)?.map(of_state).collect();
        file.each(&mut cells, "elevation", |c, v| c.elevation = v)?;
        file.each(&mut cells, "variance", |c, v| c.variance = v)?;
        file.each(&mut cells, "min", |c, v| c.min = v)?;
        file.each(&mut cells, "max", |c, v| c.max = v)?;
        file.each(&mut cells, "height", |c, v| c.height = v)?;
        file.each(&mut cells, "tally", |c, v| c.tally = v)?;
        file.each(&mut cells, "last_sweep", |c, v| c.last_sweep = v)?;
        let sample: Vec<i32> = file.read("sample", 4)?.collect();
        for (cell, values) in cells.iter_mut().zip(sample.chunks(4)) {
            cell.sample_variance = values[0] as u16;
            cell.offset = [values[1] as i8, values[2] as i8];
            cell.depression = values[3] as u8;
        }
        let evidence = file.evidence()?;
        let [rows, columns] = file.shape.unwrap_or([0; 2]);
        let map = SavedMap {
            resolution: head.resolution,
            height_step: head.height_step,
            cell: head.cell,
            shift: head.shift,
            rise: head.rise,
            sweep: head.sweep,
            rows,
            columns,
            cells,
            evidence,
        };
        map.check().map_err(|e| Failure::file(path, e))?;
        Ok(map)
    }

    /// Numbers that a mapper cannot make.
    fn check(&self) -> Result<(), &'static str> {
        let positive = |v: f32| v.is_finite() && v > 0.0;
        let near = |v: f64| v.abs() < 1e9;
        let place =
            self.cell.iter().all(|&c| near(c as f64)) && self.shift.iter().all(|&s| near(s));
        if !positive(self.resolution) || !positive(self.height_step) {
            return Err("resolution and height_step must be positive");
        }
        if !place || !near(self.rise as f64) {
            return Err("the place is absurd");
        }
        let sound = |c: &SavedCell| {
            let near = |steps: i32| steps.unsigned_abs() < 1 << 30;
            c.elevation.is_finite()
                && c.elevation.abs() < 1e9
                && positive(c.variance)
                && c.offset.iter().all(|o| (-32..=32).contains(o))
                && near(c.min)
                && near(c.max)
                && near(c.height)
        };
        let mut measured = self.cells.iter().filter(|c| c.state == State::Measured);
        match measured.all(sound) {
            true => Ok(()),
            false => Err("a cell with numbers that cannot be"),
        }
    }
}

fn of_state(number: u8) -> SavedCell {
    let state = match number {
        1 => State::Measured,
        2 => State::SeenThrough,
        _ => State::Unknown,
    };
    SavedCell {
        state,
        ..SavedCell::default()
    }
}

/// The arrays of a file, all of one shape.
struct Arrays<'a> {
    path: &'a Path,
    archive: Archive,
    shape: Option<[usize; 2]>,
}

impl Arrays<'_> {
    /// Values of an array with `depth` of them per cell.
    fn read<T: Element>(&mut self, name: &str, depth: u64) -> Result<std::vec::IntoIter<T>> {
        let failed =
            |e: &dyn std::fmt::Display| Failure::file(self.path, format_args!("array {name}: {e}"));
        let bytes = self.archive.bytes(&format!("{name}.npy"))?;
        let bytes = bytes.ok_or_else(|| failed(&"missing"))?;
        npy::check_header(self.path, &mut Cursor::new(&bytes))?;
        let npy = NpyFile::new(Cursor::new(&bytes)).map_err(|e| failed(&e))?;
        let shape = match (npy.shape(), depth) {
            (&[rows, columns], 1) => [rows, columns],
            (&[rows, columns, n], depth) if n == depth => [rows, columns],
            (other, _) => return Err(failed(&format_args!("shape {other:?}"))),
        };
        if shape.iter().any(|&n| n == 0 || n > MOST as u64) {
            return Err(failed(&format_args!(
                "{shape:?} cells; 1 … {MOST} along an edge"
            )));
        }
        let shape = shape.map(|n| n as usize);
        if *self.shape.get_or_insert(shape) != shape {
            return Err(failed(&"its shape differs from that of the others"));
        }
        let values = npy.into_vec::<T>().map_err(|e| failed(&e))?;
        Ok(values.into_iter())
    }

    fn each<T: Element>(
        &mut self,
        cells: &mut [SavedCell],
        name: &str,
        set: fn(&mut SavedCell, T),
    ) -> Result<()> {
        let values = self.read(name, 1)?;
        cells.iter_mut().zip(values).for_each(|(c, v)| set(c, v));
        Ok(())
    }

    fn evidence(&mut self) -> Result<Option<Vec<Evidence>>> {
        if !self.archive.names().iter().any(|n| n == "weight") {
            return Ok(None);
        }
        let weights = self.read::<u64>("weight", 1)?;
        let moments: Vec<i64> = self.read("moment", 2)?.collect();
        let halves = moments
            .chunks(2)
            .map(|h| (i128::from(h[0]) << 64) | i128::from(h[1] as u64));
        let all = weights.zip(halves);
        Ok(Some(
            all.map(|(weight, moment)| Evidence { weight, moment })
                .collect(),
        ))
    }
}
