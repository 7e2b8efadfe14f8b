//! The pipeline: lines in, grid and counters updated; at the end of a sweep roughness.
//!
//! ```text
//! line → pose at its time → ray of each range → point with variance → cell and sample
//! sweep end → new samples into the counters → roughness of the tiles that changed
//! ```
//!
//! Work per return does not depend on the size or the history of the map. All state is
//! in lent memory ([`Memory`]); nothing is allocated. The same messages give the same
//! bits on every platform.

use crate::config::{Config, ConfigError, Moment, SampleRule};
use crate::counters::{Counters, Returns};
use crate::ingest::{self, Scanner};
use crate::memory::Memory;
use crate::outbox;
use crate::progress::{Place, Progress};
use crate::reconstruct::Reconstruction;
use crate::report::{Stage, SweepReport};
use crate::restore::Place as MapPlace;
use crate::tiles::{Ground, TileGround};
use crate::traversability::{CellCost, Costs, LimitError, Limits, Patch};
use nalgebra::Isometry3;
use rugosa_fractal::roughness::{
    Committed, Method, Pool, Settings, StructureFunction, Trend, estimate,
};
use rugosa_grid::{Cell, Lattice, Tile, Tiles, Window};
use rugosa_terrain::grid::{Point, SavedCell, Tally, View};
use rugosa_terrain::{
    ElevationGrid, Fused, GridConfig, Noise, PoseBuffer, PoseError, Ray, SampleChoice,
};
use rugosa_wire::{
    BeamTable, Configure, Message, PoseStamp, ScanLine, ScannerDescription, SweepEnd, Verdict,
    counter,
};

/// The mapper: scanner, poses, grid, counters, roughness.
///
/// ```
/// use rugosa::{Config, Layer, Mapper, Planes33};
/// # use rugosa_grid::Cell;
/// use rugosa_wire::{Message, Packing, PoseStamp, ScanLine, SweepEnd};
/// # use rugosa_wire::{BeamModel, ScannerDescription};
/// # // four beams to the front, 45° down, 1 m above the body's origin
/// # let scanner = ScannerDescription {
/// #     model: BeamModel::Spherical,
/// #     columns: 4,
/// #     lines: 1,
/// #     azimuth_first_urad: -150_000,
/// #     azimuth_step_nrad: 100_000_000,
/// #     inclination_first_urad: -785_398,
/// #     inclination_step_nrad: 0,
/// #     tables: 0,
/// #     metres_per_count: 0.001,
/// #     range_min_m: 0.3,
/// #     range_max_m: 60.0,
/// #     range_noise_m: 0.005,
/// #     range_noise_per_m: 0.0,
/// #     angle_noise_urad: 200,
/// #     column_period_ns: 0,
/// #     line_period_us: 0,
/// #     mount_position_m: [0.0, 0.0, 1.0],
/// #     mount_orientation: [0.0, 0.0, 0.0, 1.0],
/// # };
/// # let orientation = [0.0, 0.0, 0.0, 1.0];
/// # let pose = PoseStamp { stamp_us: 7, position_m: [0.0; 3], orientation };
/// # let line = ScanLine {
/// #     sweep: 1,
/// #     line: 0,
/// #     first_column: 0,
/// #     stamp_us: 7,
/// #     returns: 4,
/// #     packing: Packing::Bits16,
/// #     ranges: Packing::Bits16.pack([1414; 4]).unwrap(),
/// #     reflectances: Default::default(),
/// # };
/// # let mut planes = Box::new(Planes33::new());
/// let mut mapper = Mapper::new(Config::default(), planes.lend()).unwrap();
/// // four beams to the front that look down by 45° from 1 m; each comes back from 1.414 m
/// mapper.message(&Message::Scanner(scanner));
/// mapper.message(&Message::Pose(pose));
/// mapper.message(&Message::Line(line));
/// let end = SweepEnd { sweep: 1, stamp_us: 8, lines: 1 };
/// let report = mapper.message(&Message::SweepEnd(end)).unwrap();
/// assert_eq!((report.lines, report.measured), (1, 4));
/// // flat ground, 1 m ahead
/// assert!(mapper.value(Layer::Elevation, Cell::new(9, 0)).abs() < 0.001);
/// // half of the square of the scanner's 5 mm
/// assert!((mapper.value(Layer::Variance, Cell::new(9, 0)) - 1.25e-5).abs() < 1e-6);
/// assert!(mapper.value(Layer::Elevation, Cell::new(-9, 0)).is_nan());
/// ```
pub struct Mapper<'m> {
    config: Config,
    scanner: Scanner<'m>,
    poses: PoseBuffer,
    progress: Progress<'m>,
    pub(crate) surface: Surface<'m>,
    reconstruction: Reconstruction<'m>,
    counters: Counters,
    /// returns until the next beam is followed to clear ghosts
    until_ghost: u32,
}

/// Elevations, their statistics, and what is derived by tile; changes go through here,
/// so that a sample never changes without its pairs.
pub(crate) struct Surface<'m> {
    pub(crate) grid: ElevationGrid<'m>,
    pub(crate) structure: StructureFunction<'m>,
    pub(crate) ground: Ground<'m>,
    costs: Costs<'m>,
}

impl<'m> Mapper<'m> {
    /// A mapper with an empty map around the origin; the side follows from the memory.
    ///
    /// ```
    /// use rugosa::{Config, ConfigError, Mapper, Planes65};
    /// # let mut planes = Box::new(Planes65::new());
    /// let config = Config { resolution: 0.05, ..Config::default() };
    /// let mapper = Mapper::new(config, planes.lend()).unwrap();
    /// assert_eq!((mapper.window().side(), mapper.lattice().resolution()), (65, 0.05));
    /// assert_eq!(mapper.window().origin(), rugosa_grid::Cell::new(-32, -32));
    /// let mut memory = planes.lend();
    /// memory.costs = &mut [];
    /// assert_eq!(Mapper::new(config, memory).err(), Some(ConfigError::Memory("costs")));
    /// ```
    pub fn new(config: Config, memory: Memory<'m>) -> Result<Self, ConfigError> {
        config.check()?;
        let side = memory.side()?;
        let window = Window::around(side, Cell::new(0, 0));
        let grid = ElevationGrid::new(grid_config(&config), window, memory.cells, memory.samples)
            .map_err(|_| ConfigError::Memory("cells"))?;
        Ok(Mapper {
            config,
            scanner: Scanner::unknown(memory.columns, memory.lines),
            poses: pose_buffer(&config),
            progress: Progress::new(memory.received),
            surface: Surface {
                grid,
                structure: StructureFunction::new(side, memory.tiles, memory.block),
                ground: Ground::new(memory.ground, !memory.solver.is_empty()),
                costs: Costs::new(memory.costs),
            },
            reconstruction: Reconstruction::new(side, memory.solver),
            counters: Counters::new(),
            until_ghost: 0,
        })
    }

    /// Takes any message; the report of a sweep when it ends one.
    pub fn message(&mut self, message: &Message) -> Option<SweepReport> {
        match message {
            Message::Scanner(description) => self.describe(description),
            Message::BeamTable(table) => self.table(table),
            Message::Pose(stamp) => self.pose(stamp),
            Message::Line(line) => return self.line(line),
            Message::SweepEnd(end) => return self.sweep_end(end),
            Message::Configure(configure) => {
                self.configure(configure);
            }
            _ => {}
        }
        None
    }

    /// The scanner describes itself; a description that cannot be used is counted and
    /// leaves the former one.
    ///
    /// ```
    /// use rugosa::{Config, Mapper, Planes33};
    /// use rugosa_wire::{BeamModel, ScannerDescription, counter};
    /// # let mut planes = Box::new(Planes33::new());
    /// let mut mapper = Mapper::new(Config::default(), planes.lend()).unwrap();
    /// // 360 columns from the front to the left, 16 lines from 0.3 rad below the horizon upward
    /// let scanner = ScannerDescription {
    ///     model: BeamModel::Spherical,
    ///     columns: 360,
    ///     lines: 16,
    ///     azimuth_first_urad: 0,
    ///     azimuth_step_nrad: 17_453_293,
    ///     inclination_first_urad: -300_000,
    ///     inclination_step_nrad: 40_000_000,
    ///     tables: 0,
    ///     metres_per_count: 0.002,
    ///     range_min_m: 0.3,
    ///     range_max_m: 100.0,
    ///     range_noise_m: 0.02,
    ///     range_noise_per_m: 0.0,
    ///     angle_noise_urad: 500,
    ///     column_period_ns: 50_000,
    ///     line_period_us: 20_000,
    ///     mount_position_m: [0.2, 0.0, 0.6], // from the body's origin
    ///     mount_orientation: [0.0, 0.0, 0.0, 1.0], // x, y, z, w: looks to the front
    /// };
    /// mapper.describe(&scanner);
    /// assert_eq!(mapper.noise().elevation_variance(-1.0, 5.0), 0.02f32.powi(2)); // m²
    /// mapper.describe(&ScannerDescription { columns: 5000, range_noise_m: 9.0, ..scanner });
    /// assert_eq!(mapper.counters().get(counter::DESCRIPTIONS_REFUSED), 1); // too many columns
    /// assert_eq!(mapper.noise().elevation_variance(-1.0, 5.0), 0.02f32.powi(2));
    /// ```
    pub fn describe(&mut self, description: &ScannerDescription) {
        if self.scanner.describe(description).is_err() {
            self.counters.count(counter::DESCRIPTIONS_REFUSED);
        }
    }

    /// A piece of a table of angles.
    pub fn table(&mut self, table: &BeamTable) {
        if self.scanner.table(table).is_err() {
            self.counters.count(counter::DESCRIPTIONS_REFUSED);
        }
    }

    /// Where the body was.
    pub fn pose(&mut self, stamp: &PoseStamp) {
        self.counters.count(counter::POSES_RECEIVED);
        let pushed = match ingest::pose_of(stamp) {
            Some(pose) => self.poses.push(stamp.stamp_us, &pose),
            None => Err(PoseError::Invalid),
        };
        match pushed {
            Ok(()) => {}
            Err(PoseError::Invalid) => self.counters.count(counter::POSES_INVALID),
            Err(PoseError::Backwards) => self.counters.count(counter::POSES_TIME_BACKWARDS),
        }
    }

    /// One scan line → grid and counters. The first line of a later sweep ends a sweep
    /// whose end never came; its report is returned.
    pub fn line(&mut self, line: &ScanLine) -> Option<SweepReport> {
        self.counters.count(counter::LINES_RECEIVED);
        match self.admit(line) {
            Ok((place, pose)) => {
                let ended = (place == Place::Next)
                    .then(|| self.begin_sweep(line))
                    .flatten();
                self.progress.take(line);
                self.counters.count(counter::LINES_USED);
                self.map(line, &pose);
                ended
            }
            Err(cause) => {
                self.counters.count(cause);
                None
            }
        }
    }

    /// The line's pose, or the counter of the cause why it cannot be mapped.
    fn admit(&self, line: &ScanLine) -> Result<(Place, Isometry3<f32>), usize> {
        let scanner = self.scanner.ready().ok_or(counter::LINES_NO_DESCRIPTION)?;
        let end = u32::from(line.first_column) + u32::from(line.returns);
        if line.line >= scanner.lines || end > u32::from(scanner.columns) {
            return Err(counter::LINES_UNKNOWN_PLACE);
        }
        if line.readings().is_none() {
            return Err(counter::LINES_MALFORMED);
        }
        let place = self.progress.place(line)?;
        let span_ns = u64::from(scanner.column_period_ns) * u64::from(line.returns);
        let body = self.poses.at(line.stamp_us + span_ns / 2000);
        let body = body.map_err(|_| counter::LINES_NO_POSE)?;
        Ok((place, body * self.scanner.mount))
    }

    #[inline(never)] // the inner loop gets the registers to itself
    fn map(&mut self, line: &ScanLine, map_from_sensor: &Isometry3<f32>) {
        let Some(description) = self.scanner.ready() else {
            return;
        };
        let rays = self
            .scanner
            .beams
            .rays(usize::from(line.line), map_from_sensor);
        let (Some(rays), Some(readings)) = (rays, line.readings()) else {
            return;
        };
        let (sweep, first) = (line.sweep as u16, usize::from(line.first_column));
        let mut returns = Returns::default();
        for (i, reading) in readings.enumerate() {
            let range = ingest::range(reading, description.metres_per_count);
            match self.scanner.limits.check(range) {
                Ok(range) => {
                    let Some(ray) = rays.ray(first + i, range) else {
                        continue;
                    };
                    let fused = self.surface.fuse(&ray.measured(&self.scanner.noise), sweep);
                    returns.fused.add(&fused);
                    if due(&mut self.until_ghost, self.config.ghost_stride) {
                        self.surface.see_through(&ray, sweep);
                    }
                }
                Err(fault) => returns.fault(fault),
            }
        }
        returns.enter(&mut self.counters);
    }

    /// Maps points \[m\] of the sensor frame, all seen from one pose (map ← sensor), as a
    /// part of sweep `view.sweep`, which becomes the mapper's: for clouds from elsewhere. End
    /// the sweep with [`Mapper::commit`].
    ///
    /// ```
    /// use nalgebra::Isometry3;
    /// use rugosa::{Config, Layer, Mapper, Planes33};
    /// use rugosa_grid::Cell;
    /// use rugosa_terrain::{Noise, grid::View};
    /// # let mut planes = Box::new(Planes33::new());
    /// let mut mapper = Mapper::new(Config::default(), planes.lend()).unwrap();
    /// // from 5 m above the point (1, 0): ground 0.3 m high half a metre to the left of it
    /// let (above, noise) = (Isometry3::translation(1.0, 0.0, 5.0), Noise::new(0.01, 0.0, 0.0));
    /// let view = View { map_from_sensor: &above, noise: &noise, sweep: 7 };
    /// mapper.points(&[[0.05, 0.55, -4.7]], &view);
    /// let report = mapper.commit(&mut |_| {});
    /// assert_eq!((report.sweep, report.measured), (7, 1));
    /// assert!((mapper.value(Layer::Elevation, Cell::new(10, 5)) - 0.3).abs() < 1e-5);
    /// ```
    pub fn points(&mut self, points: &[[f32; 3]], view: &View) {
        if self.progress.sweep() as u16 != view.sweep {
            self.progress.resume(view.sweep.into());
        }
        let fused = self.surface.fuse_points(points, view);
        let returns = Returns {
            fused,
            ..Returns::default()
        };
        returns.enter(&mut self.counters);
    }

    fn begin_sweep(&mut self, line: &ScanLine) -> Option<SweepReport> {
        let ended = self.progress.is_open().then(|| {
            self.progress.abandon();
            self.counters.count(counter::SWEEPS_INCOMPLETE);
            self.commit(&mut |_| {})
        });
        if let Some((_, body)) = self.poses.last() {
            self.follow(&body);
        }
        self.progress
            .begin(line, self.scanner.beams.columns() as u16);
        ended
    }

    /// Moves the map when the robot has come far from its centre.
    ///
    /// ```
    /// use nalgebra::Isometry3;
    /// use rugosa::{Config, Mapper, Planes33};
    /// use rugosa_grid::Cell;
    /// # let mut planes = Box::new(Planes33::new());
    /// let config = Config { move_distance: 0.8, ..Config::default() };
    /// let mut mapper = Mapper::new(config, planes.lend()).unwrap();
    /// mapper.follow(&Isometry3::translation(0.5, 0.0, 0.0));
    /// assert_eq!(mapper.window().centre(), Cell::new(0, 0)); // near enough
    /// mapper.follow(&Isometry3::translation(2.05, -1.0, 0.0));
    /// assert_eq!(mapper.window().centre(), Cell::new(20, -10)); // cells of 0.1 m
    /// ```
    pub fn follow(&mut self, body: &Isometry3<f32>) {
        let position = body.translation.vector;
        let (cell, ..) = self.lattice().locate(position.x, position.y);
        let centre = self.window().centre();
        let far = cell.x.abs_diff(centre.x).max(cell.y.abs_diff(centre.y));
        if far as f32 * self.config.resolution > self.config.move_distance {
            self.surface.move_to(cell);
            self.counters.count(counter::MAP_MOVES);
        }
        if self.surface.follow_height(position.z) {
            self.counters.count(counter::MAP_REBASES);
        }
    }

    /// The end of a sweep closes the transaction; `None` where it is not of the sweep in
    /// progress.
    pub fn sweep_end(&mut self, end: &SweepEnd) -> Option<SweepReport> {
        self.sweep_end_observed(end, &mut |_| {})
    }

    /// The same; `observe` is called after each stage, to measure costs.
    pub fn sweep_end_observed(
        &mut self,
        end: &SweepEnd,
        observe: &mut dyn FnMut(Stage),
    ) -> Option<SweepReport> {
        let missing = self.progress.end(end.sweep, end.lines)?;
        self.counters.add(counter::LINES_LOST, missing);
        if missing > 0 {
            self.counters.count(counter::SWEEPS_INCOMPLETE);
        }
        Some(self.commit(observe))
    }

    /// New samples enter the counters; what depends on them is refreshed.
    ///
    /// ```
    /// use rugosa::{Config, Mapper, Planes33, Stage};
    /// # let mut planes = Box::new(Planes33::new());
    /// let mut mapper = Mapper::new(Config::default(), planes.lend()).unwrap();
    /// let mut stages = Vec::new();
    /// let report = mapper.commit(&mut |stage| stages.push(stage));
    /// assert_eq!(stages[..2], [Stage::Counters, Stage::Roughness]);
    /// assert_eq!(stages[2..], [Stage::Reconstruction, Stage::Traversability]);
    /// // nothing was measured, so there is no roughness
    /// assert_eq!(report.roughness, Err(rugosa_fractal::roughness::Reason::TooFewPairs));
    /// ```
    pub fn commit(&mut self, observe: &mut dyn FnMut(Stage)) -> SweepReport {
        let settings = self.settings();
        let committed = self.surface.commit();
        observe(Stage::Counters);
        let refreshed = self.surface.refresh(&settings);
        observe(Stage::Roughness);
        let roughness = estimate(&self.pool(), &settings);
        let reconstruction = self.reconstruction.update(
            &self.surface.grid,
            roughness.as_ref().ok(),
            self.config.iterations as usize,
        );
        observe(Stage::Reconstruction);
        let census = self.surface.grid.census();
        self.surface.mark_touched(self.progress.sweep() as u16);
        self.surface.judge(&self.config.limits);
        observe(Stage::Traversability);
        self.counters.count(counter::SWEEPS);
        self.counters.set(counter::CELLS_MEASURED, census.measured);
        self.counters
            .set(counter::CELLS_SEEN_THROUGH, census.seen_through);
        SweepReport {
            sweep: self.progress.sweep(),
            lines: self.progress.lines(),
            samples: committed.added,
            tiles: refreshed,
            measured: census.measured,
            reconstruction,
            roughness,
        }
    }

    /// Sets a parameter that may change while a map is kept.
    ///
    /// ```
    /// use rugosa::{Config, Mapper, Planes33};
    /// use rugosa_wire::{Configure, Verdict};
    /// # let mut planes = Box::new(Planes33::new());
    /// let mut mapper = Mapper::new(Config::default(), planes.lend()).unwrap();
    /// let mut set = |name: &str, value: f32| {
    ///     let parameter = Config::index_of(name).unwrap();
    ///     mapper.configure(&Configure { parameter, value })
    /// };
    /// assert_eq!(set("gate", 4.0), Verdict::Accepted);
    /// assert_eq!(set("gate", 0.0), Verdict::OutOfRange);
    /// assert_eq!(set("resolution", 0.2), Verdict::Unsupported); // fixed while a map is kept
    /// assert_eq!(mapper.config().gate, 4.0);
    /// ```
    pub fn configure(&mut self, configure: &Configure) -> Verdict {
        let verdict = self.try_configure(configure);
        self.counters.count(match verdict {
            Verdict::Accepted => counter::CONFIGURE_ACCEPTED,
            _ => counter::CONFIGURE_REFUSED,
        });
        verdict
    }

    fn try_configure(&mut self, configure: &Configure) -> Verdict {
        let mut config = self.config;
        match config.set_live(configure.parameter, configure.value) {
            Ok(()) => {
                self.config = config;
                self.poses.hold_us = hold_us(&config);
                let _ = self.surface.grid.configure(grid_config(&config));
                self.surface.ground.all_stale();
                Verdict::Accepted
            }
            Err(ConfigError::UnknownParameter(_)) => Verdict::UnknownParameter,
            Err(ConfigError::Fixed(_)) => Verdict::Unsupported,
            Err(_) => Verdict::OutOfRange,
        }
    }

    /// The scanner's clock or session has started afresh: poses and the sweep in progress
    /// are forgotten, the map stays.
    ///
    /// ```
    /// use rugosa::{Config, Mapper, Planes33};
    /// use rugosa_wire::PoseStamp;
    /// # let mut planes = Box::new(Planes33::new());
    /// let mut mapper = Mapper::new(Config::default(), planes.lend()).unwrap();
    /// let orientation = [0.0, 0.0, 0.0, 1.0]; // x, y, z, w
    /// mapper.pose(&PoseStamp { stamp_us: 900, position_m: [1.0, 2.0, 0.0], orientation });
    /// assert_eq!(mapper.last_pose().unwrap().0, 900);
    /// mapper.new_session(); // the clock starts again at 0
    /// assert!(mapper.last_pose().is_none());
    /// mapper.pose(&PoseStamp { stamp_us: 10, position_m: [0.0; 3], orientation });
    /// assert_eq!(mapper.last_pose().unwrap().0, 10);
    /// ```
    pub fn new_session(&mut self) {
        self.poses.clear();
        self.progress.forget();
    }

    pub(crate) fn resume(&mut self, sweep: u32) {
        self.poses.clear();
        self.progress.resume(sweep);
    }

    /// How roughness is estimated.
    ///
    /// ```
    /// use rugosa::{Config, Mapper, Planes33, config::Moment};
    /// use rugosa_fractal::roughness::{Method, Trend};
    /// # let mut planes = Box::new(Planes33::new());
    /// let config = Config { moment: Moment::First, detrend: false, ..Config::default() };
    /// let mapper = Mapper::new(config, planes.lend()).unwrap();
    /// let settings = mapper.settings();
    /// assert_eq!((settings.method, settings.trend), (Method::Yokoya, Trend::Keep));
    /// assert_eq!((settings.resolution, settings.height_step), (0.1, 0.0005)); // metres
    /// ```
    pub fn settings(&self) -> Settings {
        Settings {
            method: match self.config.moment {
                Moment::First => Method::Yokoya,
                Moment::Second => Method::Pentland,
            },
            trend: if self.config.detrend {
                Trend::RemoveSignificant
            } else {
                Trend::Keep
            },
            least_pairs: self.config.min_pairs as u32,
            ..Settings::new(self.config.resolution, self.config.height_step())
        }
    }

    /// The pooled counters of the whole map.
    pub fn pool(&self) -> Pool {
        Pool::of_all(self.surface.structure.tiles())
    }

    /// The pooled counters of the 3 × 3 tiles around one.
    ///
    /// ```
    /// # use nalgebra::Isometry3;
    /// # use rugosa::{Config, Mapper, Planes65};
    /// # use rugosa_grid::Tile;
    /// # use rugosa_terrain::{Noise, grid::View};
    /// # let mut planes = Box::new(Planes65::new());
    /// # let mut mapper = Mapper::new(Config::default(), planes.lend()).unwrap();
    /// # let (above, noise) = (Isometry3::translation(0.0, 0.0, 9.0), Noise::new(0.0, 0.0, 0.0));
    /// # let view = View { map_from_sensor: &above, noise: &noise, sweep: 0 };
    /// // a step of 0.2 m at x = 0 in every cell of the map
    /// let cells = mapper.window().cells().map(|cell| mapper.lattice().centre(cell));
    /// let step = |x: f32| if x > 0.0 { 0.2 } else { 0.0 };
    /// let points: Vec<_> = cells.map(|(x, y)| [x, y, step(x) - 9.0]).collect();
    /// mapper.points(&points, &view);
    /// mapper.commit(&mut |_| {});
    /// // mean squared difference of elevations, nominally 1 cell apart: 0 on the flat
    /// let square = |tile| mapper.pool_around(tile).moments(0.1, 0.0005)[0].mean_square;
    /// assert_eq!(square(Tile::new(-3, 0)), 0.0);
    /// assert!(square(Tile::new(0, 0)) > 0.001); // m²
    /// assert!(mapper.pool_around(Tile::new(0, 0)).pairs() < mapper.pool().pairs());
    /// ```
    pub fn pool_around(&self, tile: Tile) -> Pool {
        Pool::around(
            self.surface.structure.tiles(),
            &Tiles::of(self.window()),
            tile,
        )
    }

    /// The configuration.
    pub fn config(&self) -> &Config {
        &self.config
    }

    /// Metres ↔ cells.
    pub fn lattice(&self) -> &Lattice {
        self.surface.grid.lattice()
    }

    /// The cells that are held.
    pub fn window(&self) -> &Window {
        self.surface.grid.window()
    }

    /// Number of the sweep in progress or of the last one.
    pub fn sweep(&self) -> u32 {
        self.progress.sweep()
    }

    /// The elevation grid.
    pub fn grid(&self) -> &ElevationGrid<'m> {
        &self.surface.grid
    }

    /// What is known of a tile; `None` outside the window.
    ///
    /// ```
    /// use rugosa::{Config, Mapper, Planes33};
    /// use rugosa_fractal::roughness::Reason;
    /// use rugosa_grid::Tile;
    /// # let mut planes = Box::new(Planes33::new());
    /// let mapper = Mapper::new(Config::default(), planes.lend()).unwrap();
    /// let ground = mapper.tile(Tile::new(-2, 2)).unwrap(); // a corner of 33 × 33 cells
    /// assert_eq!(ground.estimate, Err(Reason::TooFewPairs));
    /// assert!(mapper.tile(Tile::new(3, 0)).is_none());
    /// ```
    pub fn tile(&self, tile: Tile) -> Option<&TileGround> {
        self.surface.ground.get(&Tiles::of(self.window()), tile)
    }

    /// The reconstruction's mean at a cell \[m\]; `None` where none is kept.
    ///
    /// ```
    /// use rugosa::{Config, Layer, Mapper, Planes33, Solver33};
    /// # use rugosa_grid::Cell;
    /// # use nalgebra::Isometry3;
    /// # use rugosa_terrain::{Noise, grid::View};
    /// # let (mut planes, mut solver) = (Box::new(Planes33::new()), Box::new(Solver33::new()));
    /// # let (above, noise) = (Isometry3::translation(0.0, 0.0, 9.0), Noise::new(0.01, 0.0, 0.0));
    /// # let view = View { map_from_sensor: &above, noise: &noise, sweep: 0 };
    /// let memory = planes.lend_with(&mut solver);
    /// let mut mapper = Mapper::new(Config::default(), memory).unwrap();
    /// // the western half is seen, 0.5 m high
    /// let west = mapper.window().cells().filter(|cell| cell.x < 0);
    /// let places = west.map(|cell| mapper.lattice().centre(cell));
    /// let points: Vec<_> = places.map(|(x, y)| [x, y, 0.5 - 9.0]).collect();
    /// mapper.points(&points, &view);
    /// mapper.commit(&mut |_| {});
    /// let (seen, hidden) = (Cell::new(-5, 0), Cell::new(8, 0));
    /// assert!((mapper.mean(seen).unwrap() - 0.5).abs() < 0.01);
    /// assert!((mapper.mean(hidden).unwrap() - 0.5).abs() < 0.05);
    /// assert!(mapper.deviation(hidden) > mapper.deviation(seen)); // metres
    /// assert_eq!([seen, hidden].map(|c| mapper.value(Layer::Inferred, c)), [0.0, 1.0]);
    /// ```
    pub fn mean(&self, cell: Cell) -> Option<f32> {
        self.reconstruction.mean(self.window(), cell)
    }

    /// The reconstruction's standard deviation at a cell \[m\].
    pub fn deviation(&self, cell: Cell) -> Option<f32> {
        self.reconstruction.deviation(&self.surface.grid, cell)
    }

    /// A surface that the reconstruction holds for possible, at a cell \[m\]: with the
    /// ground's own roughness where the mean is too smooth.
    ///
    /// ```
    /// use rugosa::{Config, Mapper, Planes33, Solver33};
    /// use rugosa_grid::Cell;
    /// # use nalgebra::Isometry3;
    /// # use rugosa_terrain::{Noise, grid::View};
    /// # let (mut planes, mut solver) = (Box::new(Planes33::new()), Box::new(Solver33::new()));
    /// # let (above, noise) = (Isometry3::translation(0.0, 0.0, 9.0), Noise::new(0.001, 0.0, 0.0));
    /// # let view = View { map_from_sensor: &above, noise: &noise, sweep: 0 };
    /// let memory = planes.lend_with(&mut solver);
    /// let mut mapper = Mapper::new(Config::default(), memory).unwrap();
    /// mapper.points(&[[0.05, 0.05, 0.5 - 9.0]], &view);
    /// mapper.commit(&mut |_| {});
    /// // close to the return where there is one, rougher than the mean elsewhere
    /// assert!((mapper.realisation(Cell::new(0, 0)).unwrap() - 0.5).abs() < 0.01);
    /// let (here, next) = (Cell::new(9, 9), Cell::new(10, 9));
    /// let step = |of: &dyn Fn(Cell) -> f32| (of(next) - of(here)).abs();
    /// assert!(step(&|c| mapper.realisation(c).unwrap()) > step(&|c| mapper.mean(c).unwrap()));
    /// ```
    pub fn realisation(&self, cell: Cell) -> Option<f32> {
        self.reconstruction.realisation(&self.surface.grid, cell)
    }

    /// Cost of a cell and the criterion behind it; unknown outside the window.
    ///
    /// ```
    /// use rugosa::{Config, Mapper, Planes33, traversability::Criterion};
    /// # use rugosa_grid::Cell;
    /// # use nalgebra::Isometry3;
    /// # use rugosa_terrain::{Noise, grid::View};
    /// # let mut planes = Box::new(Planes33::new());
    /// # let mut mapper = Mapper::new(Config::default(), planes.lend()).unwrap();
    /// # let (above, noise) = (Isometry3::translation(0.0, 0.0, 9.0), Noise::new(0.01, 0.0, 0.0));
    /// # let view = View { map_from_sensor: &above, noise: &noise, sweep: 0 };
    /// // flat ground with one block of 0.4 m
    /// let height = |c: Cell| if c == Cell::new(8, 0) { 0.4 } else { 0.0 };
    /// let place = |cell| {
    ///     let (x, y) = mapper.lattice().centre(cell);
    ///     [x, y, height(cell) - 9.0]
    /// };
    /// let points: Vec<_> = mapper.window().cells().map(place).collect();
    /// mapper.points(&points, &view);
    /// mapper.commit(&mut |_| {});
    /// let block = mapper.cost(Cell::new(8, 0));
    /// assert_eq!((block.cost(), block.criterion), (Some(1.0), Criterion::Step));
    /// assert_eq!(mapper.cost(Cell::new(-8, 0)).criterion, Criterion::Free);
    /// assert_eq!(mapper.cost(Cell::new(99, 0)).cost(), None); // never seen
    /// ```
    pub fn cost(&self, cell: Cell) -> CellCost {
        self.surface.costs.get(self.window(), cell)
    }

    /// What the robot can do.
    pub fn limits(&self) -> &Limits {
        &self.config.limits
    }

    /// Takes over other limits; the costs follow at the next commit.
    ///
    /// ```
    /// use rugosa::traversability::{LimitError, Limits, Pair};
    /// use rugosa::{Config, Mapper, Planes33};
    /// # let mut planes = Box::new(Planes33::new());
    /// let mut mapper = Mapper::new(Config::default(), planes.lend()).unwrap();
    /// let step = Pair { safe: 0.3, critical: 0.5 }; // metres
    /// mapper.set_limits(Limits { step, ..Limits::default() }).unwrap();
    /// assert_eq!(mapper.limits().step.cost(0.4), 0.5);
    /// let wrong = Limits { wheel_base: 0.0, ..Limits::default() };
    /// assert_eq!(mapper.set_limits(wrong), Err(LimitError("wheel_base")));
    /// assert_eq!(mapper.limits().step, step);
    /// ```
    pub fn set_limits(&mut self, limits: Limits) -> Result<(), LimitError> {
        limits.check()?;
        self.config.limits = limits;
        self.surface.ground.all_stale();
        Ok(())
    }

    /// The last pose that arrived.
    pub fn last_pose(&self) -> Option<(u64, Isometry3<f32>)> {
        self.poses.last()
    }

    /// All counters.
    pub fn counters(&self) -> &Counters {
        &self.counters
    }

    /// The counters, for levels and costs that are measured outside.
    pub fn counters_mut(&mut self) -> &mut Counters {
        &mut self.counters
    }

    /// The scanner's noise model.
    pub fn noise(&self) -> &Noise {
        &self.scanner.noise
    }
}

impl Surface<'_> {
    #[inline]
    fn fuse(&mut self, point: &Point, sweep: u16) -> Fused {
        let fused = self.grid.fuse(point, sweep);
        if let Fused::Sampled { cell, old } | Fused::Restarted { cell, old } = &fused {
            let (window, samples) = (self.grid.window(), self.grid.samples());
            self.structure.sampled(window, samples, *cell, old);
        }
        fused
    }

    fn fuse_points(&mut self, points: &[[f32; 3]], view: &View) -> Tally {
        let structure = &mut self.structure;
        self.grid
            .fuse_points(points, view, |window, samples, cell, old| {
                structure.sampled(window, samples, cell, old);
            })
    }

    fn see_through(&mut self, ray: &Ray, sweep: u16) {
        let (structure, ground) = (&mut self.structure, &mut self.ground);
        self.grid
            .see_through(ray, sweep, |window, samples, cell, old| {
                structure.replaced(window, samples, cell, old);
                ground.changed(&Tiles::of(window), Tile::of(cell));
            });
    }

    fn move_to(&mut self, centre: Cell) {
        let (structure, ground) = (&mut self.structure, &mut self.ground);
        self.grid.move_to(centre, |window, samples, cell, old| {
            structure.replaced(window, samples, cell, old);
            ground.changed(&Tiles::of(window), Tile::of(cell));
        });
        ground.all_stale();
    }

    /// Empties the map and moves it to a place.
    pub(crate) fn clear(&mut self, place: &MapPlace) {
        let half = (self.grid.window().side() / 2) as i32;
        let centre = place.origin.offset(half, half);
        // once far away and back: every cell has left
        self.move_to(centre.offset(i32::MIN, 0));
        self.move_to(centre);
        self.grid.rebase(place.datum, |_, _, _, _| {});
    }

    /// Puts a saved cell back; false where it does not fit.
    pub(crate) fn restore(&mut self, cell: Cell, saved: &SavedCell) -> bool {
        let (structure, ground) = (&mut self.structure, &mut self.ground);
        self.grid
            .restore(cell, saved, |window, samples, cell, old| {
                structure.replaced(window, samples, cell, old);
                ground.changed(&Tiles::of(window), Tile::of(cell));
            })
    }

    /// Follows the robot up and down; true where the datum changed.
    fn follow_height(&mut self, z: f32) -> bool {
        let (structure, ground) = (&mut self.structure, &mut self.ground);
        let before = self.grid.datum();
        self.grid.follow_height(z, |window, samples, cell, old| {
            structure.replaced(window, samples, cell, old);
            ground.changed(&Tiles::of(window), Tile::of(cell));
        });
        self.grid.datum() != before
    }

    fn commit(&mut self) -> Committed {
        let (window, samples) = self.grid.samples_mut();
        self.structure.commit(window, samples)
    }

    fn refresh(&mut self, settings: &Settings) -> u32 {
        let tiles = Tiles::of(self.grid.window());
        self.ground.mark(self.structure.tiles_mut(), &tiles);
        self.ground
            .refresh(self.structure.tiles(), &tiles, settings)
    }

    /// Costs of the tiles whose cells, neighbours or roughness changed.
    fn judge(&mut self, limits: &Limits) {
        let tiles = Tiles::of(self.grid.window());
        let mut patch = Patch::new();
        let mut judging = self.costs.judging(&self.grid, limits, &mut patch);
        for tile in tiles.tiles() {
            if !self.ground.take_cost_stale(&tiles, tile) {
                continue;
            }
            let roughness = self.ground.get(&tiles, tile).and_then(|g| g.estimate.ok());
            let measured = self.structure.measured_around(&tiles, tile);
            if judging.judge(tile, roughness.as_ref(), &measured)
                && let Some(ground) = self.ground.get_mut(&tiles, tile)
            {
                ground.unsent |= outbox::COSTS;
            }
        }
    }

    /// Marks the tiles that this sweep touched.
    fn mark_touched(&mut self, sweep: u16) {
        self.ground.untouched();
        let tiles = Tiles::of(self.grid.window());
        let sums = self.structure.tiles();
        for tile in tiles.tiles() {
            let measured = tiles.slot(tile).map_or(0, |slot| sums[slot].measured());
            if self.grid.is_touched(tile, measured, sweep) {
                self.ground.changed(&tiles, tile);
            }
        }
    }
}

fn pose_buffer(config: &Config) -> PoseBuffer {
    let mut poses = PoseBuffer::new();
    poses.hold_us = hold_us(config);
    poses
}

fn hold_us(config: &Config) -> u64 {
    (config.pose_hold * 1e6) as u64
}

fn grid_config(config: &Config) -> GridConfig {
    GridConfig {
        height_step: config.height_step(),
        gate: config.gate,
        sample: match config.sample {
            SampleRule::Nearest => SampleChoice::Nearest,
            SampleRule::Lowest => SampleChoice::Lowest,
        },
        clearing_margin: config.ghost_margin,
        ..GridConfig::new(config.resolution)
    }
}

/// Counts down; true once every `stride` calls, never for 0.
#[inline]
fn due(left: &mut u32, stride: f32) -> bool {
    if stride < 1.0 {
        return false;
    }
    if *left == 0 {
        *left = stride as u32;
    }
    *left -= 1;
    *left == 0
}
