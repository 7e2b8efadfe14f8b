//! One number for all bits of a map, to compare a module's with another's.
//!
//! FNV-1a over 32-bit words (Fowler, Noll & Vo, RFC 9923), cells and tiles in the order
//! of their places on the ground. Two maps with the same digest are the same but for a
//! chance of 1 in 2³²; two maps that differ anywhere differ here but for the same.
//! Costs about 200 operations per cell.

use crate::{Layer, Mapper};
use rugosa_grid::{Cell, Tile, Tiles};

const BASIS: u32 = 0x811c_9dc5;
const PRIME: u32 = 0x0100_0193;

fn fold(digest: u32, word: u32) -> u32 {
    let mixed = (digest ^ word).wrapping_mul(PRIME);
    mixed ^ (mixed >> 15)
}

/// All NaN are one: processors sign theirs differently.
fn fold_float(digest: u32, x: f32) -> u32 {
    fold(digest, if x.is_nan() { 0x7fc0_0000 } else { x.to_bits() })
}

impl Mapper<'_> {
    /// The digest of cells, samples, roughness, reconstruction and cost.
    ///
    /// ```
    /// use nalgebra::Isometry3;
    /// use rugosa::{Config, Mapper, Planes33};
    /// use rugosa_terrain::{Noise, grid::View};
    /// # let (mut a, mut b) = (Box::new(Planes33::new()), Box::new(Planes33::new()));
    /// let mut one = Mapper::new(Config::default(), a.lend()).unwrap();
    /// let mut other = Mapper::new(Config::default(), b.lend()).unwrap();
    /// assert_eq!(one.digest(), other.digest());
    /// let (above, noise) = (Isometry3::translation(0.0, 0.0, 5.0), Noise::new(0.01, 0.0, 0.0));
    /// let view = View { map_from_sensor: &above, noise: &noise, sweep: 0 };
    /// one.points(&[[0.55, 0.0, -5.0]], &view);
    /// assert_ne!(one.digest(), other.digest());
    /// other.points(&[[0.55, 0.0, -5.0]], &view);
    /// assert_eq!(one.digest(), other.digest());
    /// ```
    pub fn digest(&self) -> u32 {
        let origin = self.window().origin();
        let start = [origin.x as u32, origin.y as u32, self.grid().datum() as u32];
        let start = start.into_iter().fold(BASIS, fold);
        let cells = self
            .window()
            .cells()
            .fold(start, |d, cell| self.fold_cell(d, cell));
        let tiles = Tiles::of(self.window());
        tiles.tiles().fold(cells, |d, tile| self.fold_tile(d, tile))
    }

    fn fold_cell(&self, digest: u32, cell: Cell) -> u32 {
        let derived = [
            Layer::Mean,
            Layer::StandardDeviation,
            Layer::Realisation,
            Layer::Traversability,
        ]
        .map(|layer| self.value(layer, cell));
        let state = fold(digest, self.grid().state(cell) as u32);
        let digest = derived.into_iter().fold(state, fold_float);
        let Some(ground) = self.grid().ground(cell) else {
            return digest;
        };
        let sample = self.grid().sample(cell);
        let fused = [ground.elevation, ground.variance, ground.min, ground.max];
        [
            u32::from(ground.count) << 16 | u32::from(ground.last_sweep),
            u32::from(sample.height as u16) << 16 | u32::from(sample.variance),
            u32::from(sample.east as u8) << 8 | u32::from(sample.north as u8),
        ]
        .into_iter()
        .fold(fused.into_iter().fold(digest, fold_float), fold)
    }

    fn fold_tile(&self, digest: u32, tile: Tile) -> u32 {
        let Some(Ok(roughness)) = self.tile(tile).map(|ground| ground.estimate) else {
            return fold(digest, 1);
        };
        [
            roughness.dimension,
            roughness.sigma,
            roughness.standard_error,
            roughness.residual,
            roughness.range[0],
            roughness.range[1],
        ]
        .into_iter()
        .fold(digest, fold_float)
    }
}
