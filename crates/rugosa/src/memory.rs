//! The memory of a mapper: lent planes, and who may own them.
//!
//! [`Memory`] is what a mapper works on. [`Planes`] owns it in static memory (firmware);
//! a host may own it on its heap. The side of the map follows from the length of the
//! planes, so there is one compiled mapper for all sizes.

use crate::ConfigError;
use crate::tiles::TileGround;
use crate::traversability::CellCost;
use rugosa_fractal::pyramid::Posterior;
use rugosa_fractal::roughness::{Block, StructureFunction, TileSums};
use rugosa_grid::{Sample, Tiles};
use rugosa_terrain::{GroundCell, LineTrig, Trig};

/// Most columns of a scanner in [`Planes`].
pub const COLUMNS: usize = 1024;
/// Most lines of a scanner in [`Planes`].
pub const LINES: usize = 512;

/// Lent planes of a mapper of `side × side` cells.
///
/// ```
/// use rugosa::{Config, Mapper, Memory, TileGround, solver_of, tiles_of, traversability::CellCost};
/// use rugosa_fractal::roughness::{Block, TileSums};
/// # use rugosa_grid::Sample;
/// use rugosa_terrain::{GroundCell, LineTrig, Trig};
/// let (side, columns, lines) = (33, 360, 16);
/// let memory = Memory {
///     cells: &mut vec![GroundCell::EMPTY; side * side],
///     samples: &mut vec![Sample::UNKNOWN; side * side],
///     tiles: &mut vec![TileSums::EMPTY; tiles_of(side)],
///     ground: &mut vec![TileGround::EMPTY; tiles_of(side)],
///     costs: &mut vec![CellCost::UNKNOWN; side * side],
///     solver: &mut vec![0.0; solver_of(side)],
///     block: &mut Block::new(),
///     columns: &mut vec![Trig::ZERO; columns],
///     lines: &mut vec![LineTrig::ZERO; lines],
///     received: &mut vec![0; lines],
/// };
/// assert_eq!(Mapper::new(Config::default(), memory).unwrap().window().side(), side);
/// ```
pub struct Memory<'m> {
    /// `side²` fused cells
    pub cells: &'m mut [GroundCell],
    /// `side²` point samples
    pub samples: &'m mut [Sample],
    /// counters of the structure function, [`tiles_of`] entries
    pub tiles: &'m mut [TileSums],
    /// roughness by tile, [`tiles_of`] entries
    pub ground: &'m mut [TileGround],
    /// `side²` costs
    pub costs: &'m mut [CellCost],
    /// the solver of the reconstruction, [`solver_of`] elements; empty for none
    pub solver: &'m mut [f32],
    /// scratch of the structure function
    pub block: &'m mut Block,
    /// sines and cosines by column; their number limits the scanner
    pub columns: &'m mut [Trig],
    /// angles by line; their number limits the scanner
    pub lines: &'m mut [LineTrig],
    /// which segments of a line have come in this sweep; as long as `lines`
    pub received: &'m mut [u16],
}

/// Tiles of a map of `side` cells a side.
///
/// ```
/// // a map of 33 × 33 cells touches 5 × 5 tiles of 8 × 8 cells, wherever it lies
/// assert_eq!(rugosa::tiles_of(33), 25);
/// assert_eq!(rugosa::tiles_of(65), 81);
/// ```
pub const fn tiles_of(side: usize) -> usize {
    let per_side = Tiles::per_side(side);
    per_side * per_side
}

/// Elements of the reconstruction's solver for a map of `side` = 2^k + 1 cells a side.
///
/// ```
/// // 76 KiB for 65 × 65 cells
/// assert_eq!((4 * rugosa::solver_of(65)).div_ceil(1024), 76);
/// // no such side, no memory
/// assert_eq!(rugosa::solver_of(64), 0);
/// ```
pub const fn solver_of(side: usize) -> usize {
    match Posterior::need(side) {
        Ok(need) => need,
        Err(_) => 0,
    }
}

/// Is this a side of a map: 2^k + 1, 33 … 1025?
///
/// ```
/// let sides: Vec<usize> = (0..2000).filter(|&side| rugosa::is_side(side)).collect();
/// assert_eq!(sides, [33, 65, 129, 257, 513, 1025]);
/// ```
pub const fn is_side(side: usize) -> bool {
    side >= 33 && side <= 1025 && (side - 1).is_power_of_two()
}

impl Memory<'_> {
    /// The side of the map, if all planes agree on it.
    pub(crate) fn side(&self) -> Result<usize, ConfigError> {
        let side = self.cells.len().isqrt();
        if !is_side(side) || side * side != self.cells.len() {
            return Err(ConfigError::Side(side));
        }
        let checks = [
            ("samples", self.samples.len() == side * side),
            ("costs", self.costs.len() == side * side),
            (
                "tiles",
                self.tiles.len() == StructureFunction::tiles_needed(side),
            ),
            ("ground", self.ground.len() == tiles_of(side)),
            (
                "solver",
                self.solver.is_empty() || self.solver.len() == solver_of(side),
            ),
            ("received", self.received.len() == self.lines.len()),
        ];
        match checks.iter().find(|(_, fits)| !fits) {
            Some((name, _)) => Err(ConfigError::Memory(name)),
            None => Ok(side),
        }
    }
}

/// Memory of a mapper in one piece: `CELLS` = side², `TILES` = [`tiles_of`] (side).
///
/// ```
/// use rugosa::{Config, Mapper, Planes, Planes33, Solver33, tiles_of};
/// // firmware keeps it in a `static`, a host on its heap
/// let mut planes = Box::new(Planes33::new());
/// assert!(Mapper::new(Config::default(), planes.lend()).is_ok());
/// // with a reconstruction, which needs a solver of the same side
/// let mut solver = Solver33::new();
/// let memory = planes.lend_with(&mut solver);
/// assert_eq!(memory.solver.len(), rugosa::solver_of(33));
/// // any other side by its numbers of cells and tiles
/// let mut large = Box::new(Planes::<{ 257 * 257 }, { tiles_of(257) }>::new());
/// let mapper = Mapper::new(Config::default(), large.lend()).unwrap();
/// assert_eq!(mapper.window().side(), 257);
/// ```
pub struct Planes<const CELLS: usize, const TILES: usize> {
    cells: [GroundCell; CELLS],
    samples: [Sample; CELLS],
    tiles: [TileSums; TILES],
    ground: [TileGround; TILES],
    costs: [CellCost; CELLS],
    block: Block,
    columns: [Trig; COLUMNS],
    lines: [LineTrig; LINES],
    received: [u16; LINES],
}

/// Memory of a reconstruction in one piece: `SOLVER` = [`solver_of`] (side).
pub struct Solver<const SOLVER: usize> {
    solver: [f32; SOLVER],
}

/// A map of 33 × 33 cells.
pub type Planes33 = Planes<{ 33 * 33 }, { tiles_of(33) }>;
/// A map of 65 × 65 cells.
pub type Planes65 = Planes<{ 65 * 65 }, { tiles_of(65) }>;
/// A map of 129 × 129 cells.
pub type Planes129 = Planes<{ 129 * 129 }, { tiles_of(129) }>;
/// The reconstruction of 33 × 33 cells.
pub type Solver33 = Solver<{ solver_of(33) }>;
/// The reconstruction of 65 × 65 cells.
pub type Solver65 = Solver<{ solver_of(65) }>;
/// The reconstruction of 129 × 129 cells.
pub type Solver129 = Solver<{ solver_of(129) }>;

impl<const SOLVER: usize> Default for Solver<SOLVER> {
    fn default() -> Self {
        Self::new()
    }
}

impl<const SOLVER: usize> Solver<SOLVER> {
    /// Empty memory.
    pub const fn new() -> Self {
        Solver {
            solver: [0.0; SOLVER],
        }
    }
}

impl<const CELLS: usize, const TILES: usize> Default for Planes<CELLS, TILES> {
    fn default() -> Self {
        Self::new()
    }
}

impl<const CELLS: usize, const TILES: usize> Planes<CELLS, TILES> {
    /// Empty planes.
    pub const fn new() -> Self {
        Planes {
            cells: [GroundCell::EMPTY; CELLS],
            samples: [Sample::UNKNOWN; CELLS],
            tiles: [TileSums::EMPTY; TILES],
            ground: [TileGround::EMPTY; TILES],
            costs: [CellCost::UNKNOWN; CELLS],
            block: Block::new(),
            columns: [Trig::ZERO; COLUMNS],
            lines: [LineTrig::ZERO; LINES],
            received: [0; LINES],
        }
    }

    /// Lends the planes to a mapper that keeps a reconstruction.
    pub fn lend_with<'m, const SOLVER: usize>(
        &'m mut self,
        solver: &'m mut Solver<SOLVER>,
    ) -> Memory<'m> {
        Memory {
            solver: &mut solver.solver,
            ..self.lend()
        }
    }

    /// Lends the planes to a mapper without a reconstruction.
    pub fn lend(&mut self) -> Memory<'_> {
        Memory {
            solver: &mut [],
            cells: &mut self.cells,
            samples: &mut self.samples,
            tiles: &mut self.tiles,
            ground: &mut self.ground,
            costs: &mut self.costs,
            block: &mut self.block,
            columns: &mut self.columns,
            lines: &mut self.lines,
            received: &mut self.received,
        }
    }
}
