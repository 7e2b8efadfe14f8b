//! Which samples near a tile are measured, and where they live.
//!
//! Of each row the measured cells are bits of one word. A single sample's partners in a row are
//! the bits that this word has in common with the offsets of the row.
//! The pairs of a whole tile at an offset are the bits that it has in common with the eight by
//! eight cells there. What was not measured costs nothing either way.
//!
//! Cost on x86-64, on the rings of a first sweep: 1,300 instructions to look at what is near,
//! 7,700 for a tile with 45 pairs, 3,100 for a single sample.
//!
//! Rejected: a tile's samples one by one, each with its partners of all lags (half as many
//! instructions again on x86-64, twice as many on a Cortex-M); keeping what two neighbouring tiles
//! know in common (2 % of the counters' time, 1.5 kB of flash).

use super::offsets::{LAGS, NEAR_LAGS, REACH, lag_of, offsets, partners};
use super::sums::LagSums;
use core::array::from_fn;
use rugosa_grid::tile::places_of;
use rugosa_grid::{Sample, TILE, Tile, TileBits, Window};

/// Cells along an edge of what is near a tile: itself and the reach to both sides.
const SPAN: usize = (TILE + 2 * REACH) as usize;
/// Tiles along that edge, and the tile's own place among them.
const TILES: i32 = SPAN as i32 / TILE;
const OWN: i32 = REACH / TILE;

/// No lag has more offsets (test `each_offset_lies_in_the_half_annulus_of_one_lag`: 24 at most).
/// All ones, to mask with.
const LAST: usize = 31;

/// No slot.
const NOWHERE: usize = usize::MAX / 2;

/// The samples near a tile: 2 kB. A slot is the sum of a part of the row and one of the column.
#[derive(Clone, Debug)]
pub(super) struct Nearby {
    /// bit x: is the cell in column x of the row measured?
    measured: [u64; SPAN],
    rows: [usize; SPAN],
    columns: [usize; SPAN],
    /// near which tile of which window
    held: Option<(Window, Tile)>,
    known: Known,
    /// the tile's own samples
    own: [Sample; 64],
}

impl Nearby {
    /// Near nothing; all zeros, so that it takes no flash.
    pub(super) const fn new() -> Self {
        Nearby {
            measured: [0; SPAN],
            rows: [0; SPAN],
            columns: [0; SPAN],
            held: None,
            known: Known::NOTHING,
            own: [Sample::UNKNOWN; 64],
        }
    }

    /// What is measured has changed.
    pub(super) fn forget(&mut self) {
        self.held = None;
    }

    /// Looks at what is near `tile`; `measured` tells of each tile. Keeps what it shares with
    /// the tile to the west, if it was there before.
    pub(super) fn look(
        &mut self,
        window: &Window,
        tile: Tile,
        measured: impl Fn(Tile) -> TileBits,
    ) {
        let west = Tile::new(tile.x.wrapping_sub(1), tile.y);
        let first = match self.held.replace((*window, tile)) {
            Some(held) if held == (*window, tile) => return,
            Some(held) if held == (*window, west) => {
                self.measured = self.measured.map(|row| row >> TILE);
                TILES - 1
            }
            _ => {
                self.measured = [0; SPAN];
                self.rows = window.row_parts(tile.origin().y.wrapping_sub(REACH));
                0
            }
        };
        self.columns = window.column_parts(tile.origin().x.wrapping_sub(REACH));
        for (y, rows) in self.measured.chunks_exact_mut(TILE as usize).enumerate() {
            for x in first..TILES {
                let [east, north] = [x - OWN, y as i32 - OWN];
                let near = Tile::new(tile.x.wrapping_add(east), tile.y.wrapping_add(north));
                let bits = measured(near);
                if bits == 0 {
                    continue;
                }
                for (row, bits) in rows.iter_mut().zip(bits.to_le_bytes()) {
                    *row |= u64::from(bits) << (TILE * x);
                }
            }
        }
    }

    /// The measured upper or lower partners of the tile's cell at `place`: lag, offset from it,
    /// and where it lives.
    #[inline(always)]
    pub(super) fn partners(
        &self,
        place: usize,
        is_upper: bool,
    ) -> impl Iterator<Item = (usize, (i32, i32), usize)> {
        let (column, row) = (place % 8, place / 8 + REACH as usize);
        (0..=REACH).flat_map(move |rows| {
            let y = if is_upper { rows } else { -rows };
            let row = row.wrapping_add_signed(y as isize);
            let measured = self.measured.get(row).map_or(0, |row| row >> column);
            let start = self.rows.get(row).map_or(NOWHERE, |start| *start);
            places_of(measured & partners(rows as usize, is_upper)).map(move |i| {
                let part = self.columns.get(column + i).map_or(NOWHERE, |part| *part);
                let x = i as i32 - REACH;
                (lag_of(x, rows), (x, y), start + part)
            })
        })
    }

    /// The sums of the tile, whose samples `own` names, over all that is measured.
    pub(super) fn sums(&mut self, samples: &[Sample], own: TileBits) -> [LagSums; LAGS] {
        self.known.look(&self.measured);
        for place in places_of(own) {
            if let Some(sample) = samples.get(self.slot(place, (0, 0))) {
                self.own[place] = *sample;
            }
        }
        from_fn(|lag| self.lag(lag, samples, own))
    }

    #[inline(never)] // eight times would be too much flash
    fn lag(&self, lag: usize, samples: &[Sample], own: TileBits) -> LagSums {
        let mut sums = LagSums::EMPTY;
        let (found, count) = self.offsets_with_pairs(lag, own);
        for &offset in &found[..count & LAST] {
            let pairs = own & self.known.at(offset);
            self.add_pairs(&mut sums, lag, samples, pairs, offset);
        }
        sums
    }

    /// Which offsets of a lag have pairs, and how many these are. Sought before any is added: few
    /// have any, and a processor cannot foresee which.
    #[inline(always)]
    fn offsets_with_pairs(&self, lag: usize, own: TileBits) -> ([(i8, i8); LAST + 1], usize) {
        let (mut found, mut count) = ([(0, 0); LAST + 1], 0);
        for &offset in offsets(lag) {
            found[count & LAST] = offset;
            count += usize::from(own & self.known.at(offset) != 0);
        }
        (found, count)
    }

    /// Adds the pairs of an offset.
    #[inline(always)]
    fn add_pairs(
        &self,
        sums: &mut LagSums,
        lag: usize,
        samples: &[Sample],
        pairs: TileBits,
        offset: (i8, i8),
    ) {
        let (mut rise, mut count) = (0, 0);
        for place in places_of(pairs) {
            let lower = &self.own[place];
            if let Some(upper) = samples.get(self.slot(place, offset)) {
                rise += sums.add_heights(lower, upper);
                count += 1;
                if lag < NEAR_LAGS {
                    sums.add_places(lower, upper, wide(offset));
                }
            }
        }
        sums.add_offset(rise, count, wide(offset));
    }

    /// Where the cell lives that is (x, y) away from that at `place` of the tile.
    #[inline(always)]
    fn slot(&self, place: usize, (x, y): (i8, i8)) -> usize {
        let near = |i: usize, o: i8| (i + REACH as usize).wrapping_add_signed(o.into());
        let part = |parts: &[usize; SPAN], i: usize| parts.get(i).map_or(NOWHERE, |part| *part);
        part(&self.rows, near(place / 8, y)) + part(&self.columns, near(place % 8, x))
    }
}

fn wide((x, y): (i8, i8)) -> (i32, i32) {
    (x.into(), y.into())
}

/// Which cells are measured of a tile and of those to the north, west and east that offsets
/// reach: for each column, and each row, those of the next eight columns.
#[derive(Clone, Debug)]
struct Known([u8; COLUMNS * HEIGHT]);

const COLUMNS: usize = 2 * REACH as usize + 1;
const HEIGHT: usize = (TILE + REACH) as usize;

impl Known {
    const NOTHING: Known = Known([0; COLUMNS * HEIGHT]);

    fn look(&mut self, measured: &[u64; SPAN]) {
        self.0 = Known::NOTHING.0;
        let rows = measured[REACH as usize..].iter().enumerate();
        for (y, &row) in rows.filter(|(_, row)| **row != 0) {
            let mut row = row;
            for column in self.0.chunks_exact_mut(HEIGHT) {
                column[y] = row as u8;
                row >>= 1;
            }
        }
    }

    /// The cells of the tile that have a measured one at an offset.
    #[inline(always)]
    fn at(&self, (x, y): (i8, i8)) -> TileBits {
        let start = (i32::from(x) + REACH) as usize * HEIGHT + y as usize;
        let rows = self.0.get(start..).and_then(<[u8]>::first_chunk);
        rows.map_or(0, |rows| TileBits::from_le_bytes(*rows))
    }
}
