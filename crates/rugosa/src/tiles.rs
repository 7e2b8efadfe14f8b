//! Roughness by tile: refreshed where the counters changed, and only there.
//!
//! The estimate of a tile rests on the pooled counters of 3 × 3 tiles, so a tile is
//! refreshed when one of these nine changed. Where nothing is measured nothing is stated.

use crate::outbox;
use rugosa_fractal::roughness::estimate::{Reason, Roughness, Settings, estimate};
use rugosa_fractal::roughness::{Pools, TileSums};
use rugosa_grid::{Tile, Tiles};

/// What is known of a tile beyond its counters.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TileGround {
    /// roughness of the 3 × 3 tiles around, or why there is none; none where nothing is
    /// measured in the tile itself
    pub estimate: Result<Roughness, Reason>,
    stale: bool,
    /// its costs are out of date
    cost_stale: bool,
    /// a cell of it changed in this sweep
    touched: bool,
    /// groups of layers that changed since they were sent, see `outbox`
    pub(crate) unsent: u8,
    /// how often other tiles were sent before this one
    pub(crate) waited: u8,
}

impl TileGround {
    /// Nothing is known.
    pub const EMPTY: TileGround = TileGround {
        estimate: Err(Reason::TooFewPairs),
        stale: false,
        cost_stale: false,
        touched: false,
        unsent: 0,
        waited: 0,
    };
}

/// The roughness of all tiles of a window.
pub(crate) struct Ground<'m> {
    tiles: &'m mut [TileGround],
    /// `outbox::MEANS` where a reconstruction is kept
    means: u8,
}

impl<'m> Ground<'m> {
    pub(crate) fn new(tiles: &'m mut [TileGround], is_reconstructed: bool) -> Self {
        tiles.fill(TileGround::EMPTY);
        let means = if is_reconstructed { outbox::MEANS } else { 0 };
        Ground { tiles, means }
    }

    /// All groups of layers that there are.
    pub(crate) fn groups(&self) -> u8 {
        outbox::CELLS | outbox::ROUGHNESS | outbox::COSTS | self.means
    }

    pub(crate) fn get(&self, tiles: &Tiles, tile: Tile) -> Option<&TileGround> {
        tiles.slot(tile).map(|slot| &self.tiles[slot])
    }

    pub(crate) fn get_mut(&mut self, tiles: &Tiles, tile: Tile) -> Option<&mut TileGround> {
        tiles.slot(tile).map(|slot| &mut self.tiles[slot])
    }

    /// The elevation of a cell of a tile changed.
    pub(crate) fn changed(&mut self, tiles: &Tiles, tile: Tile) {
        if let Some(ground) = self.get_mut(tiles, tile)
            && !core::mem::replace(&mut ground.touched, true)
        {
            ground.unsent |= outbox::CELLS;
            let means = self.means;
            self.each_around(tiles, tile, |near| {
                near.cost_stale = true;
                near.unsent |= means;
            });
        }
    }

    /// A new sweep begins: no tile has been touched in it.
    pub(crate) fn untouched(&mut self) {
        for tile in self.tiles.iter_mut() {
            tile.touched = false;
        }
    }

    /// Does the tile want new costs? Asking resets it.
    pub(crate) fn take_cost_stale(&mut self, tiles: &Tiles, tile: Tile) -> bool {
        self.get_mut(tiles, tile)
            .is_some_and(|ground| core::mem::take(&mut ground.cost_stale))
    }

    fn each_around(&mut self, tiles: &Tiles, tile: Tile, apply: impl Fn(&mut TileGround)) {
        for slot in tiles.around(tile) {
            if let Some(near) = self.tiles.get_mut(slot) {
                apply(near);
            }
        }
    }

    /// The window has moved: slots have new owners.
    pub(crate) fn all_stale(&mut self) {
        for tile in self.tiles.iter_mut() {
            tile.stale = true;
            tile.cost_stale = true;
        }
    }

    /// Marks the neighbours of every tile whose counters changed.
    pub(crate) fn mark(&mut self, sums: &mut [TileSums], tiles: &Tiles) {
        for tile in tiles.tiles() {
            let Some(slot) = tiles.slot(tile) else {
                continue;
            };
            if sums[slot].take_changed() {
                self.each_around(tiles, tile, |near| near.stale = true);
            }
        }
    }

    /// Estimates the stale tiles anew; returns in how many of them something is measured. The
    /// others have no roughness.
    pub(crate) fn refresh(&mut self, sums: &[TileSums], tiles: &Tiles, by: &Settings) -> u32 {
        let mut refreshed = 0;
        let mut pools = Pools::new(sums, tiles);
        for tile in tiles.tiles() {
            let Some(slot) = tiles.slot(tile) else {
                continue;
            };
            let ground = &mut self.tiles[slot];
            if !core::mem::take(&mut ground.stale) {
                continue;
            }
            let is_measured = sums[slot].measured() != 0;
            refreshed += u32::from(is_measured);
            let fresh = if is_measured {
                estimate(&pools.around(tile), by)
            } else {
                TileGround::EMPTY.estimate
            };
            if fresh != ground.estimate {
                ground.estimate = fresh;
                ground.unsent |= outbox::ROUGHNESS;
                ground.cost_stale = true;
            }
        }
        refreshed
    }
}
