//! Patches of the map for the link: what changed, the nearest first.
//!
//! A tile that changed waits until it is sent. Of the waiting tiles the one with the
//! greatest (1 + waited) / √(1 + d²) goes first, d tiles from the map's centre, so that
//! the ground before the robot is fresh and no tile waits for ever. The root is
//! micromath's: its error (a few per cent) only swaps tiles of nearly equal priority, and
//! it is the same bit operations on every platform.
//!
//! A patch carries 16-bit numbers with a scale and an offset of its own; the rounding is
//! at most half a scale, 1/65 000 of the range of values in the tile.

use crate::Mapper;
use crate::layer::Layer;
use heapless::Vec;
use micromath::F32Ext;
use rugosa_grid::{Cell, TILE, Tile, Tiles, math};
use rugosa_wire::{MAX_PATCH, Patch};

/// Group of layers: elevations.
pub const CELLS: u8 = 1;
/// Group of layers: roughness.
pub const ROUGHNESS: u8 = 2;

/// Group of layers: costs.
pub const COSTS: u8 = 4;

/// Group of layers: the reconstruction.
pub const MEANS: u8 = 8;

/// Layers that are sent, by group.
const SENT: &[(u8, Layer)] = &[
    (CELLS, Layer::Elevation),
    (CELLS, Layer::Variance),
    (CELLS, Layer::State),
    (ROUGHNESS, Layer::Dimension),
    (ROUGHNESS, Layer::Sigma),
    (ROUGHNESS, Layer::DimensionError),
    (COSTS, Layer::Traversability),
    (MEANS, Layer::Mean),
    (MEANS, Layer::StandardDeviation),
    (MEANS, Layer::Realisation),
];

/// Number for unknown.
pub const UNKNOWN: i16 = i16::MIN;

/// What is left to send of the tile in hand.
#[derive(Clone, Copy, Debug, Default)]
pub struct Outbox {
    tile: Tile,
    /// bit i: layer i of [`SENT`]
    left: u32,
}

impl Outbox {
    /// Nothing in hand.
    pub const fn new() -> Self {
        Outbox {
            tile: Tile::new(0, 0),
            left: 0,
        }
    }

    /// The next patch, if anything changed.
    ///
    /// ```
    /// use rugosa::{Config, Layer, Mapper, Outbox, Planes33};
    /// # use nalgebra::Isometry3;
    /// # use rugosa_terrain::{Noise, grid::View};
    /// # let mut planes = Box::new(Planes33::new());
    /// # let mut mapper = Mapper::new(Config::default(), planes.lend()).unwrap();
    /// # let (above, noise) = (Isometry3::translation(0.0, 0.0, 9.0), Noise::new(0.01, 0.0, 0.0));
    /// # let view = View { map_from_sensor: &above, noise: &noise, sweep: 0 };
    /// // returns in two tiles, one of them under the robot
    /// mapper.points(&[[1.05, 0.05, -9.0], [0.05, 0.05, -9.0]], &view);
    /// mapper.commit(&mut |_| {});
    /// let mut outbox = Outbox::new();
    /// let first = outbox.next(&mut mapper).unwrap();
    /// // the nearest tile goes first; its lowest cell is (0, 0)
    /// assert_eq!((first.layer, first.x, first.y), (Layer::Elevation as u8, 0, 0));
    /// let rest: Vec<_> = std::iter::from_fn(|| outbox.next(&mut mapper)).collect();
    /// assert!(rest.iter().any(|patch| (patch.x, patch.y) == (8, 0)));
    /// assert_eq!(outbox.next(&mut mapper), None); // until something changes
    /// ```
    pub fn next(&mut self, mapper: &mut Mapper) -> Option<Patch> {
        if self.left == 0 {
            let (tile, groups) = most_urgent(mapper)?;
            self.tile = tile;
            self.left = layers_of(groups);
        }
        let index = self.left.trailing_zeros() as usize;
        self.left &= self.left - 1;
        Some(patch(mapper, SENT[index].1, self.tile))
    }
}

/// Marks every tile as changed: after a restart of the receiver.
///
/// ```
/// use rugosa::{Config, Mapper, Outbox, Planes33, outbox};
/// # let mut planes = Box::new(Planes33::new());
/// let mut mapper = Mapper::new(Config::default(), planes.lend()).unwrap();
/// let mut out = Outbox::new();
/// assert_eq!(out.next(&mut mapper), None);
/// outbox::refresh(&mut mapper);
/// let patches = std::iter::from_fn(|| out.next(&mut mapper)).count();
/// // three layers of cells, three of roughness and the cost, of 25 tiles
/// assert_eq!(patches, 25 * 7);
/// ```
pub fn refresh(mapper: &mut Mapper) {
    let tiles = Tiles::of(mapper.window());
    let groups = mapper.surface.ground.groups();
    for tile in tiles.tiles() {
        if let Some(ground) = mapper.surface.ground.get_mut(&tiles, tile) {
            ground.unsent = groups;
        }
    }
}

fn layers_of(groups: u8) -> u32 {
    let wanted = |&(i, (group, _)): &(usize, &(u8, Layer))| groups & group != 0 && i < 32;
    SENT.iter()
        .enumerate()
        .filter(wanted)
        .fold(0, |bits, (i, _)| bits | 1 << i)
}

/// Takes the waiting tile of the greatest priority and what changed in it.
fn most_urgent(mapper: &mut Mapper) -> Option<(Tile, u8)> {
    let tiles = Tiles::of(mapper.window());
    let centre = Tile::of(mapper.window().centre());
    let mut best: Option<(f32, Tile)> = None;
    for tile in tiles.tiles() {
        let Some(ground) = mapper.surface.ground.get_mut(&tiles, tile) else {
            continue;
        };
        if ground.unsent == 0 {
            continue;
        }
        let priority = priority(ground.waited, tile.x - centre.x, tile.y - centre.y);
        ground.waited = ground.waited.saturating_add(1);
        if best.is_none_or(|(least, _)| priority > least) {
            best = Some((priority, tile));
        }
    }
    let (_, tile) = best?;
    let ground = mapper.surface.ground.get_mut(&tiles, tile)?;
    ground.waited = 0;
    Some((tile, core::mem::take(&mut ground.unsent)))
}

fn priority(waited: u8, dx: i32, dy: i32) -> f32 {
    let distance2 = (dx * dx + dy * dy) as f32;
    (1.0 + f32::from(waited)) * F32Ext::invsqrt(1.0 + distance2)
}

/// One layer of one tile.
///
/// ```
/// use rugosa::{Config, Layer, Mapper, Planes33, outbox};
/// use rugosa_grid::Tile;
/// # use nalgebra::Isometry3;
/// # use rugosa_terrain::{Noise, grid::View};
/// # let mut planes = Box::new(Planes33::new());
/// # let mut mapper = Mapper::new(Config::default(), planes.lend()).unwrap();
/// # let (above, noise) = (Isometry3::translation(0.0, 0.0, 9.0), Noise::new(0.01, 0.0, 0.0));
/// # let view = View { map_from_sensor: &above, noise: &noise, sweep: 0 };
/// // ground that rises by 0.2 m per metre to the east
/// let cells = mapper.window().cells().map(|cell| mapper.lattice().centre(cell));
/// let points: Vec<_> = cells.map(|(x, y)| [x, y, 0.2 * x - 9.0]).collect();
/// mapper.points(&points, &view);
/// let patch = outbox::patch(&mapper, Layer::Elevation, Tile::new(-1, 1));
/// assert_eq!((patch.x, patch.y, patch.width), (-8, 8, 8));
/// let value = |i: usize| outbox::value_of(&patch, patch.values[i]);
/// assert!((value(1) - value(0) - 0.02).abs() < 1e-4); // the next cell to the east
/// assert!((value(8) - value(0)).abs() < 1e-4); // the next row to the north
/// ```
pub fn patch(mapper: &Mapper, layer: Layer, tile: Tile) -> Patch {
    let stride = if layer.description().per_tile {
        TILE
    } else {
        1
    };
    let per_side = TILE / stride;
    let values = |i: i32| {
        let cell = tile
            .origin()
            .offset(i % per_side * stride, i / per_side * stride);
        mapper.value(layer, nearest_held(mapper, cell, stride))
    };
    let (scale, offset) = scale_of((0..per_side * per_side).map(values));
    Patch {
        layer: layer as u8,
        sweep: mapper.sweep(),
        x: tile.origin().x,
        y: tile.origin().y,
        width: per_side as u8,
        stride: stride as u8,
        scale,
        offset,
        values: (0..per_side * per_side)
            .map(|i| number(values(i), scale, offset))
            .collect::<Vec<i16, MAX_PATCH>>(),
    }
}

/// A cell of a tile that stands for it: tiles at the border are partly outside.
fn nearest_held(mapper: &Mapper, cell: Cell, stride: i32) -> Cell {
    if stride == 1 {
        return cell;
    }
    let origin = mapper.window().origin();
    Cell::new(cell.x.max(origin.x), cell.y.max(origin.y))
}

/// Scale and offset that bring finite values to −32 500 … 32 500.
fn scale_of(values: impl Iterator<Item = f32>) -> (f32, f32) {
    let (mut low, mut high) = (f32::INFINITY, f32::NEG_INFINITY);
    for value in values.filter(|v| v.is_finite()) {
        low = if value < low { value } else { low };
        high = if value > high { value } else { high };
    }
    if low > high {
        return (1.0, 0.0);
    }
    let scale = (high - low) / 65_000.0;
    (if scale > 1e-9 { scale } else { 1e-9 }, 0.5 * (low + high))
}

fn number(value: f32, scale: f32, offset: f32) -> i16 {
    if value.is_finite() {
        math::round_index((value - offset) / scale).clamp(-32_767, 32_767) as i16
    } else {
        UNKNOWN
    }
}

/// The value of a number in a patch; NaN for unknown.
///
/// ```
/// use rugosa::{Layer, outbox::{UNKNOWN, value_of}};
/// let patch = rugosa_wire::Patch {
///     layer: Layer::Elevation as u8,
///     sweep: 1,
///     x: 0,
///     y: 0,
///     width: 8,
///     stride: 1,
///     scale: 0.001,
///     offset: 2.0,
///     values: Default::default(),
/// };
/// assert!((value_of(&patch, -500) - 1.5).abs() < 1e-6); // metres
/// assert!(value_of(&patch, UNKNOWN).is_nan());
/// ```
pub fn value_of(patch: &Patch, number: i16) -> f32 {
    if number == UNKNOWN {
        f32::NAN
    } else {
        patch.offset + patch.scale * f32::from(number)
    }
}
