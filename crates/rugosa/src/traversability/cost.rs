//! From features to one cost, and to the scales of planners.

use super::Limits;
use super::features::{Around, Features, Patch};
use rugosa_fractal::roughness::Roughness;
use rugosa_grid::tile::TileSlots;
use rugosa_grid::{Cell, Sample, TILE, Tile, TileBits, Window, math};
use rugosa_terrain::ElevationGrid;

/// What made the cost of a cell.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(u8)]
pub enum Criterion {
    /// nothing: the cell is unknown
    #[default]
    Unknown = 0,
    /// nothing: the cell is free
    Free,
    /// the slope
    Slope,
    /// a step
    Step,
    /// the roughness at the wheel base
    Roughness,
    /// the fractal dimension
    Dimension,
    /// the uncertainty of the elevation
    Uncertainty,
    /// the chance of a step in what was not seen
    HiddenStep,
    /// a beam went through the ground: a hole
    Hole,
}

/// Cost of a cell and the criterion behind it, 2 bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct CellCost {
    /// in 1/250; 250 is impassable
    parts: u8,
    /// what made it
    pub criterion: Criterion,
}

const PARTS: f32 = 250.0;

impl CellCost {
    /// Nothing is known.
    pub const UNKNOWN: CellCost = CellCost {
        parts: 0,
        criterion: Criterion::Unknown,
    };

    const HOLE: CellCost = CellCost {
        parts: PARTS as u8,
        criterion: Criterion::Hole,
    };

    /// Of a cost of 0 … 1.
    fn new(cost: f32, criterion: Criterion) -> Self {
        let parts = (cost * PARTS + 0.5) as u8;
        CellCost { parts, criterion }
    }

    /// The cost, 0 … 1, to 1/250; `None` where the cell is unknown.
    pub fn cost(&self) -> Option<f32> {
        (self.criterion != Criterion::Unknown).then(|| f32::from(self.parts) / PARTS)
    }
}

/// nav2: 0 free … 252, 254 impassable, 255 unknown.
///
/// ```
/// use rugosa::traversability::{grid_map, nav2, occupancy};
/// assert_eq!([nav2(Some(0.0)), nav2(Some(1.0)), nav2(None)], [0, 254, 255]);
/// assert_eq!([occupancy(Some(0.5)), occupancy(None)], [50, -1]);
/// assert_eq!(grid_map(Some(0.25)), 0.75);
/// ```
pub fn nav2(cost: Option<f32>) -> u8 {
    match cost {
        None => 255,
        Some(cost) if cost >= 1.0 => 254,
        Some(cost) => math::round_index(cost * 252.0).clamp(0, 252) as u8,
    }
}

/// OccupancyGrid: 0 free … 100 impassable, −1 unknown.
///
/// ```
/// use rugosa::traversability::occupancy;
/// assert_eq!([Some(0.0), Some(0.25), Some(1.0), None].map(occupancy), [0, 25, 100, -1]);
/// ```
pub fn occupancy(cost: Option<f32>) -> i8 {
    cost.map_or(-1, |cost| {
        math::round_index(cost * 100.0).clamp(0, 100) as i8
    })
}

/// grid_map traversability: 1 good … 0 impassable, NaN unknown.
///
/// ```
/// use rugosa::traversability::grid_map;
/// assert_eq!([Some(0.0), Some(0.25), Some(1.0)].map(grid_map), [1.0, 0.75, 0.0]);
/// assert!(grid_map(None).is_nan());
/// ```
pub fn grid_map(cost: Option<f32>) -> f32 {
    cost.map_or(f32::NAN, |cost| 1.0 - cost)
}

/// The costs of a map, in the slots of its window.
pub(crate) struct Costs<'m> {
    plane: &'m mut [CellCost],
}

impl<'m> Costs<'m> {
    pub(crate) fn new(plane: &'m mut [CellCost]) -> Self {
        plane.fill(CellCost::UNKNOWN);
        Costs { plane }
    }

    pub(crate) fn get(&self, window: &Window, cell: Cell) -> CellCost {
        window
            .slot(cell)
            .map_or(CellCost::UNKNOWN, |slot| self.plane[slot])
    }

    /// To judge tiles anew, one after another.
    pub(crate) fn judging<'a>(
        &'a mut self,
        grid: &'a ElevationGrid<'m>,
        limits: &'a Limits,
        patch: &'a mut Patch,
    ) -> Judging<'a, 'm> {
        Judging {
            plane: self.plane,
            grid,
            around: Around::new(grid.lattice().resolution(), limits),
            limits,
            patch,
        }
    }
}

/// Puts new costs on the tiles of a map.
pub(crate) struct Judging<'a, 'm> {
    plane: &'a mut [CellCost],
    grid: &'a ElevationGrid<'m>,
    limits: &'a Limits,
    around: Around,
    /// room for the ground around a tile
    patch: &'a mut Patch,
}

impl Judging<'_, '_> {
    /// Judges the cells of a tile anew; true where a cost changed. `measured` tells which
    /// cells are, of the tiles of [`Tile::around`].
    pub(crate) fn judge(
        &mut self,
        tile: Tile,
        roughness: Option<&Roughness>,
        measured: &[TileBits; 9],
    ) -> bool {
        let mut costs = [CellCost::UNKNOWN; CELLS];
        if measured[4] != 0 {
            self.around.set_roughness(roughness);
            let judge = Judge::new(self.limits, roughness);
            self.patch.fill(self.grid, tile, &self.around, measured);
            self.patch.each_cell(&self.around, &mut |place, features| {
                costs[place] = judge.cost(&features);
            });
        }
        let slots = TileSlots::of(self.grid.window(), tile);
        if self.grid.census().seen_through > 0 {
            self.mark_holes(&slots, &mut costs);
        }
        self.put(&slots, &costs)
    }

    /// What was seen through costs all.
    fn mark_holes(&self, slots: &TileSlots, costs: &mut [CellCost; CELLS]) {
        let samples = self.grid.samples();
        for (place, cost) in costs.iter_mut().enumerate() {
            let sample = samples.get(slots.slot(place));
            if sample.is_some_and(Sample::is_seen_through) {
                *cost = CellCost::HOLE;
            }
        }
    }

    /// Puts the costs of a tile; true where one changed.
    fn put(&mut self, slots: &TileSlots, costs: &[CellCost; CELLS]) -> bool {
        let mut changed = false;
        for (row, costs) in costs.as_chunks::<EDGE>().0.iter().enumerate() {
            if let Some(held) = slots.span(row).and_then(|span| self.plane.get_mut(span)) {
                changed |= *held != *costs;
                held.copy_from_slice(costs);
                continue;
            }
            for (slot, cost) in slots.row(row).zip(costs) {
                if let Some(held) = self.plane.get_mut(slot) {
                    changed |= *held != *cost;
                    *held = *cost;
                }
            }
        }
        changed
    }
}

/// Cells of an edge of a tile and of a tile.
const EDGE: usize = TILE as usize;
const CELLS: usize = EDGE * EDGE;

/// The limits with what is the same for all cells of a tile.
struct Judge<'a> {
    limits: &'a Limits,
    /// costs of roughness and dimension
    tile: [f32; 2],
    /// −2 ln of the safe chance of a hidden step
    doubt: f32,
}

impl<'a> Judge<'a> {
    fn new(limits: &'a Limits, roughness: Option<&Roughness>) -> Self {
        let tile = roughness.map_or([0.0; 2], |r| {
            let at_base = r.sigma * math::exp(r.hurst * math::ln(limits.wheel_base));
            [
                limits.roughness.cost(at_base),
                limits.dimension.cost(r.dimension),
            ]
        });
        Judge {
            limits,
            tile,
            doubt: -2.0 * math::ln(limits.hidden_step.safe),
        }
    }

    /// Of criteria that cost the same the first one counts.
    fn cost(&self, features: &Features) -> CellCost {
        let limits = self.limits;
        let mut worst = (0.0, Criterion::Free);
        let mut meet = |cost, criterion| {
            if cost > worst.0 {
                worst = (cost, criterion);
            }
        };
        meet(limits.step.cost(features.step), Criterion::Step);
        // a slope is less than its gradient
        if features.gradient_square > square(limits.slope.safe) {
            meet(limits.slope.cost(features.slope()), Criterion::Slope);
        }
        meet(self.tile[0], Criterion::Roughness);
        meet(self.tile[1], Criterion::Dimension);
        if features.variance > square(limits.uncertainty.safe) {
            let cost = limits.uncertainty.cost(features.uncertainty());
            meet(cost, Criterion::Uncertainty);
        }
        if !features.hides_less(self.doubt) {
            let cost = limits.hidden_step.cost(features.hidden_step());
            meet(cost, Criterion::HiddenStep);
        }
        CellCost::new(worst.0, worst.1)
    }
}

fn square(x: f32) -> f32 {
    x * x
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use rugosa_grid::{State, Tiles};
    use rugosa_terrain::grid::SavedCell;
    use rugosa_terrain::{GridConfig, GroundCell, Point};

    #[test]
    fn the_scales_of_planners() {
        let cases = [
            (None, 255, -1, f32::NAN),
            (Some(0.0), 0, 0, 1.0),
            (Some(0.5), 126, 50, 0.5),
            (Some(0.999), 252, 100, 0.001),
            (Some(1.0), 254, 100, 0.0),
        ];
        for (cost, n, o, g) in cases {
            assert_eq!((nav2(cost), occupancy(cost)), (n, o));
            assert!((grid_map(cost) - g).abs() < 1e-6 || cost.is_none());
        }
    }

    #[test]
    fn the_worst_criterion_decides() {
        let limits = Limits::default();
        let smooth = Features::FLAT;
        let judge = Judge::new(&limits, None);
        assert_eq!(judge.cost(&smooth), CellCost::new(0.0, Criterion::Free));
        let steep = Features {
            gradient_square: 0.435f32.tan().powi(2),
            step: 0.12,
            ..smooth
        };
        assert_eq!(judge.cost(&steep).criterion, Criterion::Slope);
        assert!((judge.cost(&steep).cost().unwrap() - 0.5).abs() < 0.01);
        let rough = Roughness {
            hurst: 0.5,
            sigma: 0.4,
            dimension: 2.5,
            ..Roughness::default()
        };
        let cost = Judge::new(&limits, Some(&rough)).cost(&smooth);
        assert_eq!(cost, CellCost::new(1.0, Criterion::Roughness));
        assert_eq!(CellCost::UNKNOWN.cost(), None);
    }

    /// The cost of all criteria, none of them left out by a bound.
    fn in_full(judge: &Judge, features: &Features) -> CellCost {
        let limits = judge.limits;
        let costs = [
            (limits.step.cost(features.step), Criterion::Step),
            (limits.slope.cost(features.slope()), Criterion::Slope),
            (judge.tile[0], Criterion::Roughness),
            (judge.tile[1], Criterion::Dimension),
            (
                limits.uncertainty.cost(features.uncertainty()),
                Criterion::Uncertainty,
            ),
            (
                limits.hidden_step.cost(features.hidden_step()),
                Criterion::HiddenStep,
            ),
        ];
        let free = (0.0, Criterion::Free);
        let (cost, criterion) =
            costs.into_iter().fold(
                free,
                |worst, next| if next.0 > worst.0 { next } else { worst },
            );
        CellCost::new(cost, criterion)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(2_000))]
        #[test]
        fn bounds_leave_no_cost_out(
            gradient in 0.0f32..0.8, step in 0.0f32..0.2, deviation in 0.0f32..0.3,
            rise in 0.0f32..0.6, spread in 1e-4f32..0.02, only in 0..4
        ) {
            let limits = Limits::default();
            let mut features = Features { limit: limits.step.critical, ..Features::FLAT };
            match only {
                0 => features.gradient_square = gradient * gradient,
                1 => features.step = step,
                2 => features.variance = deviation * deviation,
                _ => {
                    let rest = limits.step.critical - rise;
                    features = features.hiding(rest * rest.abs(), spread);
                }
            }
            let judge = Judge::new(&limits, None);
            let (quick, full) = (judge.cost(&features), in_full(&judge, &features));
            prop_assert_eq!(quick.parts, full.parts);
            prop_assert!(quick.parts == 0 || quick.criterion == full.criterion);
        }
    }

    /// One patch serves all tiles: nothing of a tile may be left in it for the next one. What was
    /// measured has a cost, also where the ring's seam crosses a tile; a cell that was seen through
    /// is a hole.
    #[test]
    fn tiles_one_after_another_equal_each_alone() {
        const SIDE: usize = 65;
        // seams at columns 64 and 65 and at rows −66 and −65
        let window = Window::around(SIDE, Cell::new(70, -75));
        let (mut cells, mut samples) = (
            [GroundCell::EMPTY; SIDE * SIDE],
            [Sample::UNKNOWN; SIDE * SIDE],
        );
        let mut grid =
            ElevationGrid::new(GridConfig::new(0.1), window, &mut cells, &mut samples).unwrap();
        let hash = |i: u32| {
            i.wrapping_mul(0x9e37_79b9)
                .rotate_left(13)
                .wrapping_mul(0x85eb_ca6b)
        };
        for (i, cell) in (0..).zip(window.cells()).filter(|(i, _)| hash(*i) % 3 == 0) {
            let (x, y) = grid.lattice().centre(cell);
            let z = 0.3 * x - 0.1 * y - 10.0 + 0.15 * (hash(i + 7) >> 16) as f32 / 65_536.0;
            let point = Point {
                position: [x, y, z],
                variance: 1e-4,
                depression: 1.0,
            };
            grid.fuse(&point, 1);
        }
        let hole = Cell::new(64, -66);
        let seen_through = SavedCell {
            state: State::SeenThrough,
            ..SavedCell::default()
        };
        assert!(grid.restore(hole, &seen_through, |_, _, _, _| {}));

        let tiles = Tiles::of(&window);
        let measured = |tile: Tile| {
            let bits = (0..64).filter(|&place| grid.ground(tile.cell(place)).is_some());
            bits.fold(0, |bits, place| bits | 1 << place)
        };
        let rough = Roughness {
            hurst: 0.6,
            sigma: 0.1,
            dimension: 2.4,
            ..Roughness::default()
        };
        let judge_all = |alone: bool| {
            let mut plane = [CellCost::UNKNOWN; SIDE * SIDE];
            let (mut costs, limits) = (Costs::new(&mut plane), Limits::default());
            let mut patch = Patch::new();
            for (i, tile) in tiles.tiles().enumerate() {
                if alone {
                    patch = Patch::new();
                }
                let roughness = (i % 2 == 0).then_some(&rough);
                let around = tile.around().map(measured);
                costs
                    .judging(&grid, &limits, &mut patch)
                    .judge(tile, roughness, &around);
            }
            for cell in window.cells() {
                let cost = Costs { plane: &mut plane }.get(&window, cell);
                let is_known = grid.ground(cell).is_some() || cell == hole;
                assert_eq!(cost.cost().is_some(), is_known, "{cell:?}");
                assert_eq!(cost == CellCost::HOLE, cell == hole);
            }
            plane
        };
        let alone = judge_all(true);
        assert!(alone == judge_all(false));
        assert!(alone.iter().filter(|cost| cost.parts > 0).count() > 500);
    }
}
