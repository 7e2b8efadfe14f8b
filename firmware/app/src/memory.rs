//! The memory of the map: static, each plane on its own.
//!
//! Each plane lies where its first value puts it: zeros cost no flash, and nothing is
//! ever built on the stack and moved here.

use crate::design_parameters::{COLUMNS, LINES, SIDE};
use rugosa::traversability::CellCost;
use rugosa::{Memory, TileGround, memory::solver_of, tiles_of};
use rugosa_fractal::roughness::{Block, TileSums};
use rugosa_grid::Sample;
use rugosa_terrain::{GroundCell, LineTrig, Trig};
use static_cell::ConstStaticCell;

const CELLS: usize = SIDE * SIDE;
const TILES: usize = tiles_of(SIDE);
const SOLVER: usize = solver_of(SIDE);

/// Angles are written before they are read; all zeros cost no flash.
const NO_TRIG: Trig = Trig { sin: 0.0, cos: 0.0 };
const NO_LINE: LineTrig = LineTrig {
    inclination: NO_TRIG,
    azimuth_offset: NO_TRIG,
    mirror: 0.0,
};

macro_rules! planes {
    ($($name:ident: [$type:ty; $length:expr] = $empty:expr;)*) => {
        $(static $name: ConstStaticCell<[$type; $length]> = ConstStaticCell::new([$empty; $length]);)*
        /// Bytes of all planes.
        pub const BYTES: usize = size_of::<Block>() $(+ size_of::<[$type; $length]>())*;
    };
}

planes! {
    GROUND_CELLS: [GroundCell; CELLS] = GroundCell::EMPTY;
    SAMPLES: [Sample; CELLS] = Sample::UNKNOWN;
    SUMS: [TileSums; TILES] = TileSums::EMPTY;
    GROUND: [TileGround; TILES] = TileGround::EMPTY;
    COSTS: [CellCost; CELLS] = CellCost::UNKNOWN;
    SOLUTION: [f32; SOLVER] = 0.0;
    TRIG: [Trig; COLUMNS] = NO_TRIG;
    LINE_TRIG: [LineTrig; LINES] = NO_LINE;
    RECEIVED: [u16; LINES] = 0;
}

static BLOCK: ConstStaticCell<Block> = ConstStaticCell::new(Block::new());

/// Lends it, once; a second time panics.
pub fn take() -> Memory<'static> {
    Memory {
        cells: GROUND_CELLS.take(),
        samples: SAMPLES.take(),
        tiles: SUMS.take(),
        ground: GROUND.take(),
        costs: COSTS.take(),
        solver: SOLUTION.take(),
        block: BLOCK.take(),
        columns: TRIG.take(),
        lines: LINE_TRIG.take(),
        received: RECEIVED.take(),
    }
}
