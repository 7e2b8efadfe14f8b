//! The memory of a mapper on the heap, for a side that is known at run time.

use rugosa::traversability::CellCost;
use rugosa::{Memory, TileGround, solver_of, tiles_of};
use rugosa_fractal::roughness::{Block, TileSums};
use rugosa_grid::Sample;
use rugosa_terrain::{GroundCell, LineTrig, Trig};

/// Most columns and lines of a scanner that a host maps.
const COLUMNS: usize = 4096;
const LINES: usize = 1024;

/// Planes for a map of `side` cells a side.
pub struct HeapPlanes {
    cells: Vec<GroundCell>,
    samples: Vec<Sample>,
    tiles: Vec<TileSums>,
    ground: Vec<TileGround>,
    costs: Vec<CellCost>,
    solver: Vec<f32>,
    block: Box<Block>,
    columns: Vec<Trig>,
    lines: Vec<LineTrig>,
    received: Vec<u16>,
}

impl HeapPlanes {
    /// Planes for `side` = 2^k + 1 cells, 33 … 1025; the mapper refuses other sides.
    pub fn new(side: usize) -> Self {
        HeapPlanes {
            cells: vec![GroundCell::EMPTY; side * side],
            samples: vec![Sample::UNKNOWN; side * side],
            tiles: vec![TileSums::EMPTY; tiles_of(side)],
            ground: vec![TileGround::EMPTY; tiles_of(side)],
            costs: vec![CellCost::UNKNOWN; side * side],
            solver: vec![0.0; solver_of(side)],
            block: Box::new(Block::new()),
            columns: vec![Trig::ZERO; COLUMNS],
            lines: vec![LineTrig::ZERO; LINES],
            received: vec![0; LINES],
        }
    }

    /// Bytes in use.
    pub fn bytes(&self) -> usize {
        size_of_val(&self.cells[..])
            + size_of_val(&self.samples[..])
            + size_of_val(&self.tiles[..])
            + size_of_val(&self.ground[..])
            + size_of_val(&self.costs[..])
            + size_of_val(&self.solver[..])
            + size_of_val(&*self.block)
            + size_of_val(&self.columns[..])
            + size_of_val(&self.lines[..])
            + size_of_val(&self.received[..])
    }

    /// Lends the planes to a mapper.
    pub fn lend(&mut self) -> Memory<'_> {
        Memory {
            cells: &mut self.cells,
            samples: &mut self.samples,
            tiles: &mut self.tiles,
            ground: &mut self.ground,
            costs: &mut self.costs,
            solver: &mut self.solver,
            block: &mut self.block,
            columns: &mut self.columns,
            lines: &mut self.lines,
            received: &mut self.received,
        }
    }
}
