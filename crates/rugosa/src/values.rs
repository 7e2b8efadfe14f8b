//! Any layer of the map, cell by cell, in SI units.

use crate::Mapper;
use crate::layer::Layer;
use crate::tiles::TileGround;
use crate::traversability::{Around, Features, Patch, grid_map};
use rugosa_fractal::roughness::Reason;
use rugosa_grid::{Cell, State, TILE, Tile, Tiles, math};

/// Standard deviations between a surface and its bounds.
const BOUND_SIGMAS: f32 = 2.0;

impl Mapper<'_> {
    /// The value of a layer at a cell, in the unit of [`Layer::description`]; NaN where
    /// there is none. Layers by tile have one value for all cells of a tile.
    ///
    /// ```
    /// use nalgebra::Isometry3;
    /// use rugosa::{Config, Layer, Mapper, Planes33};
    /// use rugosa_grid::Cell;
    /// use rugosa_terrain::{Noise, grid::View};
    /// # let mut planes = Box::new(Planes33::new());
    /// # let mut mapper = Mapper::new(Config::default(), planes.lend()).unwrap();
    /// let (above, noise) = (Isometry3::translation(0.0, 0.0, 9.0), Noise::new(0.02, 0.0, 0.0));
    /// let view = View { map_from_sensor: &above, noise: &noise, sweep: 0 };
    /// mapper.points(&[[0.0, 0.0, -8.5]], &view); // straight below
    /// let of = |layer| mapper.value(layer, Cell::new(0, 0));
    /// assert!((of(Layer::Elevation) - 0.5).abs() < 1e-5); // metres
    /// assert!((of(Layer::Variance) - 0.0004).abs() < 1e-6); // the noise squared
    /// assert!((of(Layer::UpperBound) - 0.54).abs() < 1e-5); // two deviations above
    /// assert!(mapper.value(Layer::Elevation, Cell::new(1, 0)).is_nan());
    /// ```
    pub fn value(&self, layer: Layer, cell: Cell) -> f32 {
        if layer.description().per_tile {
            let tile = self
                .tile(Tile::of(cell))
                .filter(|_| self.window().contains(cell));
            return match layer {
                Layer::Roughness => tile.map_or(f32::NAN, |g| self.at_wheel_base(g)),
                _ => tile.map_or(f32::NAN, |ground| of_tile(layer, ground)),
            };
        }
        self.of_cell(layer, cell).unwrap_or(f32::NAN)
    }

    /// σ(d) at the wheel base \[m\].
    fn at_wheel_base(&self, ground: &TileGround) -> f32 {
        ground.estimate.map_or(f32::NAN, |r| {
            r.sigma * math::powf(self.limits().wheel_base, r.hurst)
        })
    }

    fn of_cell(&self, layer: Layer, cell: Cell) -> Option<f32> {
        let grid = self.grid();
        match layer {
            Layer::Mean => return self.mean(cell),
            Layer::StandardDeviation => return self.deviation(cell),
            Layer::Realisation => return self.realisation(cell),
            Layer::UpperBound => return self.bound(cell, BOUND_SIGMAS),
            Layer::LowerBound => return self.bound(cell, -BOUND_SIGMAS),
            Layer::Inferred => {
                let inferred = grid.ground(cell).is_none();
                return self.mean(cell).map(|_| f32::from(u8::from(inferred)));
            }
            Layer::Traversability => return Some(grid_map(self.cost(cell).cost())),
            Layer::Criterion => return Some(f32::from(self.cost(cell).criterion as u8)),
            Layer::Slope | Layer::Step | Layer::HiddenStep => {
                return feature(layer, &self.features_of(Tile::of(cell)), cell);
            }
            _ => {}
        }
        if layer == Layer::State {
            return self
                .window()
                .contains(cell)
                .then(|| state_number(grid.state(cell)));
        }
        let ground = grid.ground(cell)?;
        Some(match layer {
            Layer::Elevation => ground.elevation,
            Layer::Variance => ground.variance,
            Layer::Lowest => ground.min,
            Layer::Highest => ground.max,
            Layer::Count => f32::from(ground.count),
            Layer::Age => f32::from((self.sweep() as u16).wrapping_sub(ground.last_sweep)),
            Layer::Sample => grid.sample_position(cell)?[2],
            _ => return None,
        })
    }
}

impl Mapper<'_> {
    /// The reconstruction's mean and so many of its deviations; of the fused elevation
    /// where no reconstruction is kept.
    fn bound(&self, cell: Cell, deviations: f32) -> Option<f32> {
        match (self.mean(cell), self.deviation(cell)) {
            (Some(mean), Some(deviation)) => Some(mean + deviations * deviation),
            _ => self
                .grid()
                .ground(cell)
                .map(|ground| ground.bound(deviations)),
        }
    }

    /// Slope, step and hidden step of the cells of a tile, row by row; `None` where a
    /// cell is not measured.
    ///
    /// ```
    /// # use nalgebra::Isometry3;
    /// # use rugosa::{Config, Mapper, Planes33};
    /// use rugosa_grid::Tile;
    /// # use rugosa_terrain::{Noise, grid::View};
    /// # let mut planes = Box::new(Planes33::new());
    /// # let mut mapper = Mapper::new(Config::default(), planes.lend()).unwrap();
    /// # let (above, noise) = (Isometry3::translation(0.0, 0.0, 9.0), Noise::new(0.0, 0.0, 0.0));
    /// # let view = View { map_from_sensor: &above, noise: &noise, sweep: 0 };
    /// // ground that rises by 0.2 m per metre to the north, north of the origin only
    /// let cells = mapper.window().cells().filter(|cell| cell.y >= 0);
    /// let places = cells.map(|cell| mapper.lattice().centre(cell));
    /// let points: Vec<_> = places.map(|(x, y)| [x, y, 0.2 * y - 9.0]).collect();
    /// mapper.points(&points, &view);
    /// let features = mapper.features_of(Tile::new(0, 0))[4][4].unwrap();
    /// assert!((features.slope() - 0.2f32.atan()).abs() < 0.001); // rad
    /// assert!((features.step - 0.06).abs() < 0.001); // metres, over 0.3 m
    /// assert!(mapper.features_of(Tile::new(0, -1))[4][4].is_none());
    /// ```
    pub fn features_of(&self, tile: Tile) -> [[Option<Features>; TILE as usize]; TILE as usize] {
        let roughness = self.tile(tile).and_then(|ground| ground.estimate.ok());
        let resolution = self.lattice().resolution();
        let mut around = Around::new(resolution, self.limits());
        around.set_roughness(roughness.as_ref());
        let mut patch = Patch::new();
        let grid = self.grid();
        let tiles = Tiles::of(grid.window());
        let measured = self.surface.structure.measured_around(&tiles, tile);
        patch.fill(grid, tile, &around, &measured);
        let mut features = [[None; TILE as usize]; TILE as usize];
        patch.each_cell(&around, &mut |place, of_cell| {
            features[place / TILE as usize][place % TILE as usize] = Some(of_cell);
        });
        features
    }

    /// Fills a plane of `side²` values of a layer, row by row from the south-west corner;
    /// the same values as [`Mapper::value`], tile by tile.
    ///
    /// ```
    /// # use nalgebra::Isometry3;
    /// use rugosa::{Config, Layer, Mapper, Planes33};
    /// # use rugosa_terrain::{Noise, grid::View};
    /// # let mut planes = Box::new(Planes33::new());
    /// # let mut mapper = Mapper::new(Config::default(), planes.lend()).unwrap();
    /// # let (above, noise) = (Isometry3::translation(0.0, 0.0, 9.0), Noise::new(0.0, 0.0, 0.0));
    /// # let view = View { map_from_sensor: &above, noise: &noise, sweep: 0 };
    /// // one return in the south-east corner of 33 × 33 cells around the origin
    /// mapper.points(&[[1.65, -1.55, 0.25 - 9.0]], &view);
    /// let mut plane = [0.0; 33 * 33];
    /// mapper.fill(Layer::Elevation, &mut plane);
    /// assert!((plane[32] - 0.25).abs() < 1e-5); // the last of the first row
    /// assert_eq!(plane.iter().filter(|z| z.is_nan()).count(), 33 * 33 - 1);
    /// ```
    pub fn fill(&self, layer: Layer, plane: &mut [f32]) {
        let window = *self.window();
        let is_feature = matches!(layer, Layer::Slope | Layer::Step | Layer::HiddenStep);
        let place = |cell: Cell| {
            let (x, y) = (cell.x - window.origin().x, cell.y - window.origin().y);
            y as usize * window.side() + x as usize
        };
        for tile in Tiles::of(&window).tiles() {
            let features = is_feature.then(|| self.features_of(tile));
            for cell in tile.cells().filter(|&cell| window.contains(cell)) {
                plane[place(cell)] = match &features {
                    Some(features) => feature(layer, features, cell).unwrap_or(f32::NAN),
                    None => self.value(layer, cell),
                };
            }
        }
    }
}

fn feature(
    layer: Layer,
    features: &[[Option<Features>; TILE as usize]; TILE as usize],
    cell: Cell,
) -> Option<f32> {
    let (row, column) = (cell.y.rem_euclid(TILE), cell.x.rem_euclid(TILE));
    let features = features[row as usize][column as usize]?;
    Some(match layer {
        Layer::Slope => features.slope(),
        Layer::Step => features.step,
        _ => features.hidden_step(),
    })
}

fn of_tile(layer: Layer, ground: &TileGround) -> f32 {
    let roughness = match ground.estimate {
        Ok(roughness) => roughness,
        Err(reason) if layer == Layer::Reason => return reason_number(reason),
        Err(_) => return f32::NAN,
    };
    match layer {
        Layer::Dimension => roughness.dimension,
        Layer::Hurst => roughness.hurst,
        Layer::Sigma => roughness.sigma,
        Layer::DimensionError => roughness.standard_error,
        Layer::RangeFrom => roughness.range[0],
        Layer::RangeTo => roughness.range[1],
        Layer::Residual => roughness.residual,
        Layer::Pairs => roughness.pairs as f32,
        Layer::Reason => 0.0,
        _ => f32::NAN,
    }
}

/// Number of a state in [`Layer::State`].
fn state_number(state: State) -> f32 {
    match state {
        State::Unknown => 0.0,
        State::Measured => 1.0,
        State::SeenThrough => 2.0,
    }
}

/// Number of a reason in [`Layer::Reason`]; 0 where there is a dimension.
///
/// ```
/// use rugosa::{Config, Layer, Mapper, Planes33, values::reason_number};
/// use rugosa_fractal::roughness::Reason;
/// # let mut planes = Box::new(Planes33::new());
/// let mapper = Mapper::new(Config::default(), planes.lend()).unwrap();
/// let reason = mapper.value(Layer::Reason, rugosa_grid::Cell::new(0, 0));
/// assert_eq!(reason, reason_number(Reason::TooFewPairs));
/// assert_eq!(reason_number(Reason::Slope), 4.0);
/// ```
pub fn reason_number(reason: Reason) -> f32 {
    match reason {
        Reason::TooFewPairs => 1.0,
        Reason::Noise => 2.0,
        Reason::NoLine => 3.0,
        Reason::Slope => 4.0,
    }
}
