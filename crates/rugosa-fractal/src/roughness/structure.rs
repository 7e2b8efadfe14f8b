//! The structure function of a moving map, incremental and exact.
//!
//! For each tile of 8 × 8 cells and each lag the integer [sums](LagSums) over all pairs of
//! counted samples are kept, whatever happens to the map. A sweep is one transaction:
//!
//! 1. Whenever the sample of a cell was replaced, made or cleared, whatever it was
//!    before, the caller says so with [`StructureFunction::replaced`]; the old sample's
//!    pairs are taken out. The new sample is in the plane but not yet counted.
//! 2. At the end of the sweep [`StructureFunction::commit`] adds the pairs of all new
//!    samples, once, however often a cell changed in between.
//!
//! Before the window moves, the samples that it leaves behind are cleared and reported in
//! the same way, with the window as it was. A tile whose cells have all gone is then
//! empty, so its slot in the ring can serve another tile.
//!
//! Where only a few samples within a tile's reach change, single pairs are taken out and added;
//! from a number of changes on, which grows with the measured cells, the tile is recomputed at
//! the commit in one pass. Both give the same integers; after any history they equal those of
//! a pass over the current samples, bit for bit (test `any_history_equals_a_pass_over_all_pairs`).
//!
//! Cost: a changed cell meets 2 × [`OFFSETS`](super::OFFSETS) neighbours, whatever the size
//! and the history of the map; figures in `docs/results-roughness.md`. Memory: 400 bytes per tile
//! and one [`Block`].

use super::block::Block;
use super::offsets::{LAGS, REACH, offsets};
use super::sums::{LagSums, TileSums};
use rugosa_grid::tile::{TileSlots, places_of};
use rugosa_grid::{Cell, Sample, TILE, Tile, TileBits, Tiles, Window};

/// Are so many changed samples, in a tile with so many measured cells and in those that its
/// pairs reach into, cheaper by a pass over the tile? The choice depends on the machine (vector
/// instructions), the result does not.
#[inline]
fn is_pass_cheaper(changes: u16, measured: TileBits) -> bool {
    let (few, per_cell) = if cfg!(target_arch = "arm") {
        (20, 0)
    } else {
        (24, 6)
    };
    changes >= few && u32::from(changes) >= u32::from(few) + per_cell * measured.count_ones() / 4
}

/// What a commit did.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Committed {
    /// samples whose pairs were added
    pub added: u32,
    /// tiles recomputed in one pass
    pub recomputed: u32,
    /// tiles in whose reach something changed; ask [`TileSums::take_changed`]
    pub changed: u32,
}

/// The sums of all tiles of a window, over lent memory.
///
/// ```
/// use rugosa_fractal::roughness::{Block, StructureFunction, TileSums};
/// # use rugosa_grid::{Cell, Sample, Window};
/// # let window = Window::new(33, Cell::new(0, 0));
/// # let mut samples = [Sample::UNKNOWN; 33 * 33];
/// # let mut tiles = [TileSums::EMPTY; StructureFunction::tiles_needed(33)];
/// # let mut block = Block::new();
/// let mut structure = StructureFunction::new(33, &mut tiles, &mut block);
/// let mut put = |x, height| {
///     let (cell, slot) = (Cell::new(x, 0), window.slot(Cell::new(x, 0)).unwrap());
///     let old = core::mem::replace(&mut samples[slot], Sample::measured(height, 0, 0, 0, 0));
///     structure.replaced(&window, &samples, cell, &old);
///     structure.commit(&window, &mut samples);
///     let lag = structure.tiles()[0].lags[0]; // of about one cell
///     (lag.pairs, lag.absolute)
/// };
/// assert_eq!((put(0, 10), put(1, 17)), ((0, 0), (1, 7))); // height steps
/// assert_eq!(put(1, 12), (1, 2)); // the old pair is taken out again
/// ```
#[derive(Debug)]
pub struct StructureFunction<'m> {
    tiles: &'m mut [TileSums],
    block: &'m mut Block,
}

impl<'m> StructureFunction<'m> {
    /// Starts empty. `tiles` holds [`StructureFunction::tiles_needed`] elements.
    ///
    /// # Panics
    /// If `tiles` is too short for a window of `side` cells.
    pub fn new(side: usize, tiles: &'m mut [TileSums], block: &'m mut Block) -> Self {
        let tiles = &mut tiles[..Self::tiles_needed(side)];
        tiles.fill(TileSums::default());
        StructureFunction { tiles, block }
    }

    /// Tiles that a window of `side` = 8 k + 1 cells touches: (k + 1)².
    pub const fn tiles_needed(side: usize) -> usize {
        Tiles::per_side(side) * Tiles::per_side(side)
    }

    /// The sums, tile by tile, in the slots of [`Tiles`].
    pub fn tiles(&self) -> &[TileSums] {
        self.tiles
    }

    /// The sums, to ask [`TileSums::take_changed`] of them.
    pub fn tiles_mut(&mut self) -> &mut [TileSums] {
        self.tiles
    }

    /// The sample of `cell` was `old` and is now what `samples` says; to be called after
    /// every change of a sample, whatever the old one was. `window` holds the cell.
    pub fn replaced(&mut self, window: &Window, samples: &[Sample], cell: Cell, old: &Sample) {
        let tiles = Tiles::of(window);
        let Some(own) = tiles.slot(Tile::of(cell)) else {
            return;
        };
        let own = &mut self.tiles[own];
        let pending = old.is_measured() && !old.is_counted();
        own.changes = own.changes.saturating_add(u16::from(!pending));
        own.stale |= is_pass_cheaper(own.changes, own.measured);
        if old.is_counted() {
            let around = Surroundings::of(&tiles, Tile::of(cell));
            around.each(self.tiles, |near| near.changed = true);
            let around = around.without_stale(self.tiles);
            self.each_pair(
                &around,
                &Neighbours::of(window, cell),
                samples,
                old,
                |sums, pair| *sums -= pair,
            );
        }
    }

    /// Adds the pairs of all samples that are measured and not counted, and marks them.
    pub fn commit(&mut self, window: &Window, samples: &mut [Sample]) -> Committed {
        let mut done = Committed::default();
        self.block.forget();
        let tiles = Tiles::of(window);
        let place = |tile| (tile, tiles.slot(tile).unwrap_or_default());
        for (tile, slot) in tiles.tiles().map(place) {
            if self.tiles[slot].changes > 0 {
                self.look_at(window, samples, tile);
            }
        }
        for (tile, slot) in tiles.tiles().map(place) {
            if self.tiles[slot].changes > 0 {
                done.added += self.add_pending(window, samples, tile);
            }
        }
        for (tile, slot) in tiles.tiles().map(place) {
            done.recomputed += u32::from(self.finish(slot, window, samples, tile));
            done.changed += u32::from(self.tiles[slot].changed);
        }
        done
    }

    /// Notes which samples of a tile are measured, and in which tiles their pairs are news.
    fn look_at(&mut self, window: &Window, samples: &[Sample], tile: Tile) {
        let around = Surroundings::of(&Tiles::of(window), tile);
        let Some(own) = self.tiles.get_mut(around.slot) else {
            return;
        };
        own.measured = TileSlots::of(window, tile).measured(samples);
        let changes = own.changes;
        around.each(self.tiles, |near| {
            near.changed = true;
            near.news = near.news.saturating_add(changes);
            near.stale |= is_pass_cheaper(near.news, near.measured);
        });
    }

    fn add_pending(&mut self, window: &Window, samples: &mut [Sample], tile: Tile) -> u32 {
        let around = Surroundings::of(&Tiles::of(window), tile).without_stale(self.tiles);
        let is_asked_for = !around.is_empty();
        let slots = TileSlots::of(window, tile);
        let measured = self.tiles.get(around.slot).map_or(0, |own| own.measured);
        let mut added = 0;
        for place in places_of(measured) {
            let slot = slots.slot(place);
            let Some(sample) = samples.get_mut(slot).filter(|s| !s.is_counted()) else {
                continue;
            };
            added += 1;
            if is_asked_for {
                let (sample, cell) = (*sample, tile.cell(place));
                let neighbours = Neighbours::of(window, cell);
                self.each_pair(&around, &neighbours, samples, &sample, |sums, pair| {
                    *sums += pair
                });
            }
            samples[slot].set_counted(true);
        }
        added
    }

    fn finish(&mut self, slot: usize, window: &Window, samples: &[Sample], tile: Tile) -> bool {
        let sums = &mut self.tiles[slot];
        (sums.changes, sums.news) = (0, 0);
        let stale = core::mem::take(&mut sums.stale);
        if stale {
            let tiles = Tiles::of(window);
            let measured = |near| tiles.slot(near).map_or(0, |slot| self.tiles[slot].measured);
            let lags = self.block.sums(window, samples, tile, measured);
            let sums = &mut self.tiles[slot];
            (sums.lags, sums.changed) = (lags, true);
        }
        stale
    }

    /// Applies each pair of `sample` with a counted neighbour to the sums it belongs to.
    #[inline(always)]
    fn each_pair(
        &mut self,
        around: &Surroundings,
        neighbours: &Neighbours,
        samples: &[Sample],
        sample: &Sample,
        apply: impl Fn(&mut LagSums, &LagSums),
    ) {
        for lag in 0..LAGS {
            let mut own = LagSums::default();
            for &(x, y) in offsets(lag) {
                let (x, y) = (i32::from(x), i32::from(y));
                if let Some(upper) = neighbours.counted(samples, x, y) {
                    own += &LagSums::of_pair(sample, upper, (x, y));
                }
                if let Some(lower) = neighbours.counted(samples, -x, -y)
                    && let Some(tile) = self.tiles.get_mut(around.tile(neighbours, -x, -y))
                {
                    apply(
                        &mut tile.lags[lag],
                        &LagSums::of_pair(lower, sample, (x, y)),
                    );
                }
            }
            if let Some(tile) = self.tiles.get_mut(around.own()) {
                apply(&mut tile.lags[lag], &own);
            }
        }
    }
}

/// Tiles to the west and east, and to the south, that offsets reach.
const TILES_REACHED: i32 = REACH / TILE;
const ACROSS: usize = 2 * TILES_REACHED as usize + 1;
const DOWN: usize = TILES_REACHED as usize + 1;
const NONE: u32 = u32::MAX >> 2;

/// The slots of the tiles that can own a pair with a cell of a tile; `NONE` where there
/// is none or its sums are not to be touched.
struct Surroundings {
    slots: [[u32; ACROSS]; DOWN],
    /// that of the tile itself, to be touched or not
    slot: usize,
}

impl Surroundings {
    fn of(tiles: &Tiles, tile: Tile) -> Self {
        let slots: [[u32; ACROSS]; DOWN] = core::array::from_fn(|down| {
            core::array::from_fn(|across| {
                let x = tile.x.wrapping_add(across as i32 - TILES_REACHED);
                let y = tile.y.wrapping_sub(down as i32);
                tiles.slot(Tile::new(x, y)).map_or(NONE, |slot| slot as u32)
            })
        });
        let slot = slots[0][TILES_REACHED as usize] as usize;
        Surroundings { slots, slot }
    }

    fn without_stale(mut self, tiles: &[TileSums]) -> Self {
        for slot in self.slots.iter_mut().flatten() {
            if tiles.get(*slot as usize).is_some_and(|tile| tile.stale) {
                *slot = NONE;
            }
        }
        self
    }

    fn each(&self, tiles: &mut [TileSums], act: impl Fn(&mut TileSums)) {
        for &slot in self.slots.iter().flatten() {
            if let Some(tile) = tiles.get_mut(slot as usize) {
                act(tile);
            }
        }
    }

    fn is_empty(&self) -> bool {
        self.slots.iter().flatten().all(|&slot| slot == NONE)
    }

    #[inline(always)]
    fn own(&self) -> usize {
        self.slots[0][TILES_REACHED as usize] as usize
    }

    /// The tile of the neighbour (x, y) cells away, y ≤ 0.
    #[inline(always)]
    fn tile(&self, neighbours: &Neighbours, x: i32, y: i32) -> usize {
        let across = ((neighbours.place.0 + x) >> 3) + TILES_REACHED;
        let down = -((neighbours.place.1 + y) >> 3);
        self.slots[down as usize][across as usize] as usize
    }
}

const SPAN: usize = 2 * REACH as usize + 1;

/// Where the neighbours of a cell live in the plane of samples: slot = row + column.
struct Neighbours {
    rows: [u32; SPAN],
    columns: [u32; SPAN],
    /// the cell's place in its tile
    place: (i32, i32),
}

impl Neighbours {
    fn of(window: &Window, cell: Cell) -> Self {
        let part = |part: Option<usize>| part.map_or(NONE, |part| part as u32);
        let near = |i: usize| cell.offset(i as i32 - REACH, i as i32 - REACH);
        Neighbours {
            rows: core::array::from_fn(|i| part(window.row_part(near(i).y))),
            columns: core::array::from_fn(|i| part(window.column_part(near(i).x))),
            place: (cell.x.rem_euclid(TILE), cell.y.rem_euclid(TILE)),
        }
    }

    /// The neighbour (x, y) cells away, if the window holds it and it is counted.
    #[inline(always)]
    fn counted<'s>(&self, samples: &'s [Sample], x: i32, y: i32) -> Option<&'s Sample> {
        let slot = self.rows[(y + REACH) as usize] + self.columns[(x + REACH) as usize];
        samples
            .get(slot as usize)
            .filter(|sample| sample.is_counted())
    }
}
