//! Points → cells: a square of cells around the robot.
//!
//! Two planes of `side²` entries, both lent: [`GroundCell`] (fused elevation, variance,
//! extremes, count, last sweep) and [`Sample`] (one return with its place in the cell,
//! and the cell's state). They lie in the ring of [`Window`]; only absolute [`Cell`]s go
//! in and out.
//!
//! | file | what |
//! |---|---|
//! | `cell` | the fusion of one return into one cell |
//! | `fuse` | which cell, which sample |
//! | `stripe` | many points at a time |
//! | `shift` | moves and changes of the datum |
//! | `clear` | ghosts: beams that passed below a cell |
//! | `save` | what a cell holds, out and back |
//! | `config` | parameters |
//!
//! **Samples that change.** The caller may keep statistics over pairs of samples, so it
//! hears of every sample that is replaced ([`Fused::Sampled`], [`Fused::Restarted`], the
//! callback of [`ElevationGrid::fuse_points`]) or removed (the callbacks of moves, changes
//! of the datum and clearing): `(window, samples, cell, old)`. At that moment the plane no
//! longer holds the old sample, and the window is still the old one.
//!
//! **Limits.** Elevations are relative to the map frame in f32; heights are stored as
//! i16 steps above an integer datum ([`ElevationGrid::rebase`]). Coordinates beyond
//! 2²² cells and a datum beyond 2²⁴ steps leave an f32 no room for fractions and are not
//! meant.

mod cell;
mod clear;
mod config;
mod fuse;
mod save;
mod shift;
mod stripe;

pub use cell::GroundCell;
pub use config::{GridConfig, GridError, SampleChoice};
pub use fuse::{Fused, Point, Tally, View};
pub use save::SavedCell;

use cell::Gate;
use rugosa_grid::{Cell, Lattice, Sample, State, Tile, TileBits, Window};

/// The elevation grid; `'m` is the life of the lent planes.
///
/// ```
/// use rugosa_grid::{Cell, Sample, State, Window};
/// use rugosa_terrain::{ElevationGrid, GridConfig, GroundCell, Point};
/// # let (mut cells, mut samples) = ([GroundCell::EMPTY; 1089], [Sample::UNKNOWN; 1089]);
/// # let window = Window::around(33, Cell::new(0, 0));
/// let config = GridConfig::new(0.1); // cells of 0.1 m, ±1.65 m around the origin
/// let mut grid = ElevationGrid::new(config, window, &mut cells, &mut samples).unwrap();
/// let position = [0.32, -0.06, 0.2501];
/// grid.fuse(&Point { position, variance: 1e-4, depression: 0.7 }, 1);
/// let cell = Cell::new(3, -1);
/// assert_eq!([cell, Cell::new(3, 0)].map(|c| grid.state(c)), [State::Measured, State::Unknown]);
/// assert_eq!(grid.ground(cell).unwrap().elevation, 0.2501);
/// // the sample keeps its place to 1/128 cell and half a height step
/// let sample = grid.sample_position(cell).unwrap();
/// assert!((0..3).all(|i| (sample[i] - position[i]).abs() < 0.001));
/// ```
#[derive(Debug)]
pub struct ElevationGrid<'m> {
    config: GridConfig,
    gate: Gate,
    lattice: Lattice,
    per_step: f32,
    /// height steps from the map's zero to the stored heights' zero
    datum: i32,
    /// no measured cell is higher \[m\]
    ceiling: f32,
    window: Window,
    cells: &'m mut [GroundCell],
    samples: &'m mut [Sample],
    census: Census,
}

/// What a measured cell knows, in SI units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ground {
    /// fused elevation \[m\]
    pub elevation: f32,
    /// its variance \[m²\]
    pub variance: f32,
    /// lowest fused return \[m\], to a height step
    pub min: f32,
    /// highest fused return \[m\], to a height step
    pub max: f32,
    /// returns fused; saturates at 8191
    pub count: u16,
    /// the sweep (its low 16 bits) that touched the cell last
    pub last_sweep: u16,
}

impl Ground {
    /// Elevation `sigmas` standard deviations up (or down, where negative) \[m\].
    ///
    /// ```
    /// use rugosa_terrain::Ground;
    /// let ground = Ground {
    ///     elevation: 1.0,
    ///     variance: 0.01, // 0.1 m
    ///     min: 0.9,
    ///     max: 1.1,
    ///     count: 5,
    ///     last_sweep: 1,
    /// };
    /// assert!((ground.bound(2.0) - 1.2).abs() < 1e-6 && (ground.bound(-1.0) - 0.9).abs() < 1e-6);
    /// ```
    pub fn bound(&self, sigmas: f32) -> f32 {
        self.elevation + sigmas * rugosa_grid::math::sqrt(self.variance)
    }
}

/// Cells by state.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Census {
    /// cells that hold a return
    pub measured: u32,
    /// cells that a beam passed below
    pub seen_through: u32,
}

impl Census {
    #[inline]
    fn enter(&mut self, sample: &Sample) {
        self.measured += u32::from(sample.is_measured());
        self.seen_through += u32::from(sample.is_seen_through());
    }

    #[inline]
    fn leave(&mut self, sample: &Sample) {
        self.measured -= u32::from(sample.is_measured());
        self.seen_through -= u32::from(sample.is_seen_through());
    }
}

impl<'m> ElevationGrid<'m> {
    /// An empty grid over two lent planes of `window.len()` entries each; what they held
    /// is cleared.
    pub fn new(
        config: GridConfig,
        window: Window,
        cells: &'m mut [GroundCell],
        samples: &'m mut [Sample],
    ) -> Result<Self, GridError> {
        config.validate()?;
        if cells.len() != window.len() || samples.len() != window.len() {
            return Err(GridError::PlaneLength(window.len()));
        }
        cells.fill(GroundCell::default());
        samples.fill(Sample::default());
        Ok(ElevationGrid {
            config,
            gate: config.gate(),
            lattice: Lattice::new(config.resolution),
            per_step: 1.0 / config.height_step,
            datum: 0,
            ceiling: f32::NEG_INFINITY,
            window,
            cells,
            samples,
            census: Census::default(),
        })
    }

    /// The parameters.
    pub fn config(&self) -> &GridConfig {
        &self.config
    }

    /// Takes over the gate, the clearing margin and the like; resolution, height step and
    /// choice of samples stay.
    ///
    /// ```
    /// use rugosa_grid::{Cell, Sample, Window};
    /// use rugosa_terrain::{ElevationGrid, Fused, GridConfig, GroundCell, Point};
    /// # let (mut cells, mut samples) = ([GroundCell::EMPTY; 1089], [Sample::UNKNOWN; 1089]);
    /// # let window = Window::around(33, Cell::new(0, 0));
    /// # let config = GridConfig::new(0.1);
    /// let mut grid = ElevationGrid::new(config, window, &mut cells, &mut samples).unwrap();
    /// let at = |z| Point { position: [0.05, 0.05, z], variance: 1e-4, depression: 1.0 };
    /// grid.fuse(&at(0.0), 1);
    /// assert_eq!(grid.fuse(&at(0.3), 1), Fused::Gated);
    /// grid.configure(GridConfig { gate: 10.0, resolution: 9.0, ..config }).unwrap();
    /// assert_eq!(grid.fuse(&at(0.3), 1), Fused::Merged);
    /// assert_eq!(grid.config().resolution, 0.1); // stays
    /// ```
    pub fn configure(&mut self, config: GridConfig) -> Result<(), GridError> {
        let config = GridConfig {
            resolution: self.config.resolution,
            height_step: self.config.height_step,
            sample: self.config.sample,
            ..config
        };
        config.validate()?;
        (self.config, self.gate) = (config, config.gate());
        Ok(())
    }

    /// The cells by state.
    pub fn census(&self) -> Census {
        self.census
    }

    /// Puts a sample in its place; returns the one that it replaces.
    #[inline]
    fn put(&mut self, slot: usize, sample: Sample) -> Sample {
        let old = core::mem::replace(&mut self.samples[slot], sample);
        self.census.leave(&old);
        self.census.enter(&sample);
        old
    }

    /// Was one of these `cells` of a tile last touched in this sweep (its low 16 bits)?
    pub fn is_touched(&self, tile: Tile, cells: TileBits, sweep: u16) -> bool {
        let is_of_sweep = |cell| {
            let slot = self.window.slot(cell);
            slot.is_some_and(|slot| self.cells[slot].last_sweep == sweep)
        };
        let mut asked = tile.cells_of(cells);
        asked.any(is_of_sweep)
    }

    /// Metres ↔ cells.
    pub fn lattice(&self) -> &Lattice {
        &self.lattice
    }

    /// The cells that are held.
    pub fn window(&self) -> &Window {
        &self.window
    }

    /// The plane of samples in the ring order of [`Window::slot`].
    pub fn samples(&self) -> &[Sample] {
        self.samples
    }

    /// The window and the plane of samples, for those who mark samples as counted.
    /// Heights and states are not theirs to change.
    pub fn samples_mut(&mut self) -> (&Window, &mut [Sample]) {
        (&self.window, self.samples)
    }

    /// Unknown, measured or seen through; unknown outside the window.
    pub fn state(&self, cell: Cell) -> State {
        self.sample(cell).state()
    }

    /// The point sample of a cell; the empty one outside the window.
    pub fn sample(&self, cell: Cell) -> Sample {
        self.window
            .slot(cell)
            .map_or(Sample::default(), |slot| self.samples[slot])
    }

    /// Where the point sample of a cell lies in the map \[m\]; `None` where nothing is
    /// measured. To 1/128 cell and half a height step.
    pub fn sample_position(&self, cell: Cell) -> Option<[f32; 3]> {
        let sample = self.sample(cell);
        if !sample.is_measured() {
            return None;
        }
        let (x, y) = self.lattice.centre(cell);
        let part = self.lattice.resolution() / rugosa_grid::sample::PARTS as f32;
        Some([
            x + part * f32::from(sample.east),
            y + part * f32::from(sample.north),
            self.metres(sample.height),
        ])
    }

    /// What a cell knows; `None` where nothing is measured.
    pub fn ground(&self, cell: Cell) -> Option<Ground> {
        let slot = self.window.slot(cell)?;
        let held = &self.cells[slot];
        self.samples[slot].is_measured().then(|| Ground {
            elevation: held.elevation,
            variance: held.variance,
            min: self.metres(held.min),
            max: self.metres(held.max),
            count: held.count(),
            last_sweep: held.last_sweep,
        })
    }

    /// Elevation \[m\] and its variance \[m²\] of the measured cell in a slot of the window.
    #[inline]
    pub fn elevation(&self, slot: usize) -> [f32; 2] {
        let held = &self.cells[slot];
        [held.elevation, held.variance]
    }

    /// Height steps → metres above the map's zero.
    pub fn metres(&self, steps: i16) -> f32 {
        (self.datum + i32::from(steps)) as f32 * self.config.height_step
    }

    /// The datum: height steps from the map's zero to that of the stored heights.
    pub fn datum(&self) -> i32 {
        self.datum
    }
}
