//! Any layer of the map, cell by cell, in SI units.

use crate::Mapper;
use crate::layer::Layer;
use crate::tiles::TileGround;
use rugosa_fractal::roughness::Reason;
use rugosa_grid::{Cell, State, Tile};

/// Standard deviations between the elevation and its bounds.
const BOUND_SIGMAS: f32 = 2.0;

impl Mapper<'_> {
    /// The value of a layer at a cell, in the unit of [`Layer::description`]; NaN where
    /// there is none. Layers by tile have one value for all cells of a tile.
    pub fn value(&self, layer: Layer, cell: Cell) -> f32 {
        if layer.description().per_tile {
            let tile = self
                .tile(Tile::of(cell))
                .filter(|_| self.window().contains(cell));
            return tile.map_or(f32::NAN, |ground| of_tile(layer, ground));
        }
        self.of_cell(layer, cell).unwrap_or(f32::NAN)
    }

    fn of_cell(&self, layer: Layer, cell: Cell) -> Option<f32> {
        let grid = self.grid();
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
            Layer::UpperBound => ground.bound(BOUND_SIGMAS),
            Layer::LowerBound => ground.bound(-BOUND_SIGMAS),
            Layer::Lowest => ground.min,
            Layer::Highest => ground.max,
            Layer::Count => f32::from(ground.count),
            Layer::Age => f32::from((self.sweep() as u16).wrapping_sub(ground.last_sweep)),
            Layer::Sample => grid.sample_position(cell)?[2],
            _ => return None,
        })
    }
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
pub fn reason_number(reason: Reason) -> f32 {
    match reason {
        Reason::TooFewPairs => 1.0,
        Reason::Noise => 2.0,
        Reason::NoLine => 3.0,
        Reason::Slope => 4.0,
    }
}
