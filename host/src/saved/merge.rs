//! Maps of several robots or runs become one, weighted by variance.
//!
//! ```text
//! 1/v = Σ 1/vᵢ      z = v Σ zᵢ/vᵢ
//! ```
//!
//! The sums are of integers ([`Evidence`]) and stay in the merged map; extremes are
//! extremes, counts add up (to their bound), the sample is the least in a total order that
//! begins with the distance from the cell's centre. So merging is associative and
//! commutative to the last bit, whatever is merged first
//! (test `any_order_and_any_grouping_give_the_same_bytes`).
//!
//! A cell that one map saw through and another measured is measured. Maps must have the
//! same resolution, height step and lattice. Elevations are rounded to 2⁻²⁰ m, weights to
//! 2⁻¹⁶ m⁻².

use super::{Evidence, MOST, SavedMap};
use crate::config::decimal;
use crate::error::{Failure, Result};
use rugosa_grid::{State, sample};
use rugosa_terrain::grid::SavedCell;

/// Parts of a metre in a moment.
const METRE: f64 = (1 << 20) as f64;
/// Parts of 1 m⁻² in a weight.
const WEIGHT: f64 = (1 << 16) as f64;
/// Greatest weight of one map: a variance of 10⁻⁹ m².
const MOST_WEIGHT: f64 = 1e9 * WEIGHT;
/// Most returns that a cell counts.
const MOST_COUNT: u16 = (1 << 13) - 1;

impl SavedMap {
    /// This map and another as one.
    pub fn merged(&self, other: &SavedMap) -> Result<SavedMap> {
        let same = |name: &str, a: f32, b: f32| match a == b {
            true => Ok(()),
            false => Err(Failure::input(format_args!(
                "maps with a {name} of {a} and {b} m cannot be merged"
            ))),
        };
        same("resolution", self.resolution, other.resolution)?;
        same("height_step", self.height_step, other.height_step)?;
        let [(a, phase_a), (b, phase_b)] = [self.absolute(), other.absolute()];
        let resolution = decimal(self.resolution);
        let off = |i: usize| (phase_a[i] - phase_b[i]).abs() > 1e-5 * resolution;
        if off(0) || off(1) {
            return Err(Failure::input(
                "the cells of the maps lie beside each other: map both on one lattice",
            ));
        }
        let low = [0, 1].map(|i| a[i].min(b[i]));
        let high = [
            (a[0] + self.columns as i64).max(b[0] + other.columns as i64),
            (a[1] + self.rows as i64).max(b[1] + other.rows as i64),
        ];
        let [columns, rows] = [0, 1].map(|i| (high[i] - low[i]) as u64);
        if columns.max(rows) > MOST as u64 {
            return Err(Failure::input(format_args!(
                "the maps together have {columns} × {rows} cells; {MOST} along an edge is possible"
            )));
        }
        let (columns, rows) = (columns as usize, rows as usize);
        let mut merged = SavedMap {
            cell: low,
            shift: [0, 1].map(|i| phase_a[i].min(phase_b[i])),
            rise: self.rise.min(other.rise),
            sweep: self.sweep.max(other.sweep),
            rows,
            columns,
            cells: vec![SavedCell::default(); rows * columns],
            evidence: Some(vec![Evidence::default(); rows * columns]),
            ..*self
        };
        for (map, at) in [(self, a), (other, b)] {
            merged.add(map, [0, 1].map(|i| (at[i] - low[i]) as usize))?;
        }
        Ok(merged)
    }

    /// Adds a map whose lowest cell is this map's `[column, row]`.
    fn add(&mut self, map: &SavedMap, [column, row]: [usize; 2]) -> Result<()> {
        let up = i32::try_from(map.rise - self.rise)
            .map_err(|_| Failure::input("the maps lie too far above each other"))?;
        let floor = self.rise as f64 * f64::from(self.height_step);
        let sums = self.evidence.as_mut().expect("a merged map has evidence");
        for (i, cell) in map.cells.iter().enumerate() {
            let (x, y) = (column + i % map.columns, row + i / map.columns);
            let to = y * self.columns + x;
            sums[to] = sums[to]
                .plus(map.evidence_of(i))
                .ok_or_else(|| Failure::input("too many maps in one cell"))?;
            self.cells[to] = met(&self.cells[to], &raised(cell, up), &sums[to], floor);
        }
        Ok(())
    }

    /// What a cell of this map rests on.
    fn evidence_of(&self, i: usize) -> Evidence {
        let cell = &self.cells[i];
        match &self.evidence {
            Some(all) => all[i],
            None if cell.state == State::Measured => {
                let rise = self.rise as f64 * f64::from(self.height_step);
                let height = ((rise + f64::from(cell.elevation)) * METRE).round();
                let weight = (WEIGHT / f64::from(cell.variance)).round();
                let weight = weight.clamp(1.0, MOST_WEIGHT);
                Evidence {
                    weight: weight as u64,
                    moment: height as i128 * weight as i128,
                }
            }
            None => Evidence::default(),
        }
    }
}

impl Evidence {
    fn plus(self, other: Evidence) -> Option<Self> {
        Some(Evidence {
            weight: self.weight.checked_add(other.weight)?,
            moment: self.moment.checked_add(other.moment)?,
        })
    }

    /// Elevation above `floor` and variance.
    fn estimate(&self, floor: f64) -> (f32, f32) {
        let weight = i128::from(self.weight.max(1));
        let (whole, rest) = (
            self.moment.div_euclid(weight),
            self.moment.rem_euclid(weight),
        );
        let height = (whole as f64 + rest as f64 / weight as f64) / METRE;
        ((height - floor) as f32, (WEIGHT / weight as f64) as f32)
    }
}

/// The cell with its heights counted from `up` steps lower.
fn raised(cell: &SavedCell, up: i32) -> SavedCell {
    if cell.state != State::Measured {
        return *cell;
    }
    SavedCell {
        min: cell.min.saturating_add(up),
        max: cell.max.saturating_add(up),
        height: cell.height.saturating_add(up),
        ..*cell
    }
}

/// Two cells as one, with the sum of what they rest on.
fn met(a: &SavedCell, b: &SavedCell, sum: &Evidence, floor: f64) -> SavedCell {
    match (a.state, b.state) {
        (State::Measured, State::Measured) => {}
        (State::Measured, _) => return fused(*a, sum, floor),
        (_, State::Measured) => return fused(*b, sum, floor),
        (State::Unknown, _) => return *b,
        (State::SeenThrough, _) => return *a,
    }
    let count = |cell: &SavedCell| cell.tally & MOST_COUNT;
    let sample = if order(a) <= order(b) { a } else { b };
    let both = SavedCell {
        min: a.min.min(b.min),
        max: a.max.max(b.max),
        tally: (count(a) + count(b)).min(MOST_COUNT),
        last_sweep: a.last_sweep.max(b.last_sweep),
        ..*sample
    };
    fused(both, sum, floor)
}

fn fused(cell: SavedCell, sum: &Evidence, floor: f64) -> SavedCell {
    let (elevation, variance) = sum.estimate(floor);
    SavedCell {
        elevation,
        variance,
        tally: cell.tally & MOST_COUNT,
        ..cell
    }
}

/// Samples in the order of preference: nearest to the centre, then anything total.
fn order(cell: &SavedCell) -> (i32, [i8; 2], i32, u16, u8) {
    let [east, north] = cell.offset.map(i32::from);
    debug_assert!(east.abs().max(north.abs()) <= sample::PARTS);
    (
        east * east + north * north,
        cell.offset,
        cell.height,
        cell.sample_variance,
        cell.depression,
    )
}
