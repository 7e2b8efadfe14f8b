//! The structure function of a moving map, incremental and exact.
//!
//! For each tile of 8 × 8 cells and each lag the integer [sums](LagSums) over all pairs of
//! counted samples are kept, whatever happens to the map. A sweep is one transaction:
//!
//! 1. Whenever the sample of a cell was replaced, made or cleared, whatever it was
//!    before, the caller says so with [`StructureFunction::replaced`] (or, of a new return, with
//!    [`StructureFunction::sampled`]); the old sample's
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
//! the commit in one pass. What needed a pass at one commit will need it at the next one, so
//! nothing is taken out of it in between. Both give the same integers; after any history they
//! equal those of a pass over the current samples, bit for bit (test
//! `any_history_equals_a_pass_over_all_pairs`).
//!
//! Cost: a changed cell meets those of 2 × [`OFFSETS`](super::OFFSETS) neighbours that are
//! measured, whatever the size and the history of the map; figures in
//! `docs/results-roughness.md`. Memory: 400 bytes per tile and one [`Block`].

use super::block::{Block, HAS_VECTORS};
use super::offsets::{LAGS, REACH};
use super::sums::{LagSums, TileSums};
use rugosa_grid::tile::{TileSlots, places_of};
use rugosa_grid::{Cell, Sample, TILE, Tile, TileBits, Tiles, Window};

/// Are so many changed samples, in a tile with so many measured cells and in those that its
/// pairs reach into, cheaper by a pass over the tile? The choice depends on the machine (vector
/// instructions), the result does not.
#[inline]
fn is_pass_cheaper(changes: u16, measured: TileBits) -> bool {
    match HAS_VECTORS {
        true => changes >= 6 && u32::from(changes) >= 6 + measured.count_ones() / 2,
        false => changes >= 20,
    }
}

/// From so many samples of a tile on, its rows are worth vectors.
const FULL: u32 = 12;

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

    /// Which cells are measured, of the tiles of [`Tile::around`].
    pub fn measured_around(&self, tiles: &Tiles, tile: Tile) -> [TileBits; 9] {
        let measured = |slot: usize| self.tiles.get(slot).map_or(0, |tile| tile.measured);
        tiles.around(tile).map(measured)
    }

    /// The sample of `cell` was `old` and is now what `samples` says; to be called after
    /// every change of a sample, whatever the old one was. `window` holds the cell.
    pub fn replaced(&mut self, window: &Window, samples: &[Sample], cell: Cell, old: &Sample) {
        let slot = window.slot(cell);
        let is_measured = slot.is_some_and(|slot| samples[slot].is_measured());
        self.note(window, samples, cell, old, is_measured);
    }

    /// The same where the new sample is a return.
    #[inline]
    pub fn sampled(&mut self, window: &Window, samples: &[Sample], cell: Cell, old: &Sample) {
        // a return that is not counted yet has been noted
        if !old.is_measured() || old.is_counted() {
            self.note(window, samples, cell, old, true);
        }
    }

    fn note(
        &mut self,
        window: &Window,
        samples: &[Sample],
        cell: Cell,
        old: &Sample,
        is_measured: bool,
    ) {
        let tiles = Tiles::of(window);
        let Some(own) = tiles.slot(Tile::of(cell)) else {
            return;
        };
        let own = &mut self.tiles[own];
        own.set_measured(Tile::place_of(cell), is_measured);
        let pending = old.is_measured() && !old.is_counted();
        own.changes = own.changes.saturating_add(u16::from(!pending));
        if old.is_counted() {
            own.stale |= is_pass_cheaper(own.changes, own.measured);
            self.take_out(window, samples, cell, old);
        }
    }

    /// Takes out the pairs of the sample that the cell held.
    #[inline(never)] // new ground has none
    fn take_out(&mut self, window: &Window, samples: &[Sample], cell: Cell, old: &Sample) {
        let around = Surroundings::of(&Tiles::of(window), Tile::of(cell));
        around.each(self.tiles, |near| {
            near.changed = true;
            near.stale |= near.is_busy;
        });
        let around = around.without_stale(self.tiles);
        if !around.is_empty() {
            self.look_near(window, Tile::of(cell));
            self.each_pair(&around, Tile::place_of(cell), samples, old, false);
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
                self.spread_news(window, tile);
            }
        }
        for tile in self.tiles.iter_mut() {
            tile.stale |= is_pass_cheaper(tile.news, tile.measured);
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

    /// The changes of a tile are news in all tiles that may own a pair with it.
    fn spread_news(&mut self, window: &Window, tile: Tile) {
        let around = Surroundings::of(&Tiles::of(window), tile);
        let changes = self.tiles.get(around.slot).map_or(0, |own| own.changes);
        around.each(self.tiles, |near| {
            near.changed = true;
            near.news = near.news.saturating_add(changes);
        });
    }

    fn add_pending(&mut self, window: &Window, samples: &mut [Sample], tile: Tile) -> u32 {
        let around = Surroundings::of(&Tiles::of(window), tile).without_stale(self.tiles);
        let is_asked_for = !around.is_empty();
        if is_asked_for {
            self.look_near(window, tile);
        }
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
                let sample = *sample;
                self.each_pair(&around, place, samples, &sample, true);
            }
            samples[slot].set_counted(true);
        }
        added
    }

    /// The sums of a tile, whose samples `own` names.
    fn pass(
        &mut self,
        window: &Window,
        samples: &[Sample],
        tile: Tile,
        own: TileBits,
    ) -> [LagSums; LAGS] {
        if own == 0 {
            return [LagSums::EMPTY; LAGS];
        }
        if HAS_VECTORS && own.count_ones() >= FULL {
            let (tiles, ring) = (&self.tiles, Tiles::of(window));
            let measured = |near| ring.slot(near).map_or(0, |slot| tiles[slot].measured);
            if let Some(sums) = self.block.sums(window, samples, tile, measured) {
                return sums;
            }
        }
        self.look_near(window, tile);
        self.block.nearby.sums(samples, own)
    }

    /// Looks at what is measured near a tile.
    fn look_near(&mut self, window: &Window, tile: Tile) {
        let (tiles, ring) = (&self.tiles, Tiles::of(window));
        self.block.nearby.look(window, tile, |near| {
            ring.slot(near).map_or(0, |slot| tiles[slot].measured)
        });
    }

    fn finish(&mut self, slot: usize, window: &Window, samples: &[Sample], tile: Tile) -> bool {
        let sums = &mut self.tiles[slot];
        sums.is_busy = is_pass_cheaper(sums.news, sums.measured);
        (sums.changes, sums.news) = (0, 0);
        let (measured, stale) = (sums.measured, core::mem::take(&mut sums.stale));
        if stale {
            let lags = self.pass(window, samples, tile, measured);
            let sums = &mut self.tiles[slot];
            (sums.lags, sums.changed) = (lags, true);
        }
        stale
    }

    /// Adds each pair of `sample` with a counted neighbour to the sums it belongs to, or takes
    /// it out again.
    #[inline(never)] // twice would be too much flash
    fn each_pair(
        &mut self,
        around: &Surroundings,
        place: usize,
        samples: &[Sample],
        sample: &Sample,
        is_added: bool,
    ) {
        for is_upper in [true, false] {
            let partners = self.block.nearby.partners(place, is_upper);
            partners.for_each(|(lag, (x, y), slot)| {
                let tile = match is_upper {
                    true => around.own(),
                    false => around.tile(place, (x, y)),
                };
                if let Some(other) = samples.get(slot).filter(|other| other.is_counted())
                    && let Some(tile) = self.tiles.get_mut(tile)
                {
                    let pair = match is_upper {
                        true => LagSums::of_pair(lag, sample, other, (x, y)),
                        false => LagSums::of_pair(lag, other, sample, (-x, -y)),
                    };
                    match is_added {
                        true => tile.lags[lag] += &pair,
                        false => tile.lags[lag] -= &pair,
                    }
                }
            });
        }
    }
}

/// Tiles to the west and east, and to the south, that offsets reach.
const TILES_REACHED: i32 = REACH / TILE;
const ACROSS: usize = 2 * TILES_REACHED as usize + 1;
const DOWN: usize = TILES_REACHED as usize + 1;
const NONE: usize = usize::MAX / 2;

/// The slots of the tiles that can own a pair with a cell of a tile; `NONE` or beyond where there
/// is none or its sums are not to be touched.
struct Surroundings {
    slots: [[usize; ACROSS]; DOWN],
    /// that of the tile itself, to be touched or not
    slot: usize,
}

impl Surroundings {
    fn of(tiles: &Tiles, tile: Tile) -> Self {
        let x = tile.x.wrapping_sub(TILES_REACHED);
        let y = tile.y.wrapping_sub(TILES_REACHED);
        let mut slots = tiles.rectangle::<ACROSS, DOWN>(Tile::new(x, y));
        slots.reverse(); // southward
        let slot = slots[0][TILES_REACHED as usize];
        Surroundings { slots, slot }
    }

    fn without_stale(mut self, tiles: &[TileSums]) -> Self {
        for slot in self.slots.iter_mut().flatten() {
            if tiles.get(*slot).is_some_and(|tile| tile.stale) {
                *slot = NONE;
            }
        }
        self
    }

    fn each(&self, tiles: &mut [TileSums], act: impl Fn(&mut TileSums)) {
        for &slot in self.slots.iter().flatten() {
            if let Some(tile) = tiles.get_mut(slot) {
                act(tile);
            }
        }
    }

    fn is_empty(&self) -> bool {
        self.slots.iter().flatten().all(|&slot| slot >= NONE)
    }

    #[inline(always)]
    fn own(&self) -> usize {
        self.slots[0][TILES_REACHED as usize]
    }

    /// The tile of the neighbour (x, y) cells from that at `place`, y ≤ 0.
    #[inline(always)]
    fn tile(&self, place: usize, (x, y): (i32, i32)) -> usize {
        let across = ((place as i32 % TILE + x) >> 3) + TILES_REACHED;
        let down = -((place as i32 / TILE + y) >> 3);
        self.slots[down as usize][across as usize]
    }
}
