//! Tiles: squares of 8 × 8 cells, aligned to absolute addresses.
//!
//! Tile (i, j) covers the cells `8 i … 8 i + 7` × `8 j … 8 j + 7`, wherever the window
//! stands. A window of 8 k + 1 cells touches exactly k + 1 tiles per axis at every
//! position, so the tiles live in a ring of their own.

use crate::window::{Cell, Window};
use core::array::from_fn;

/// Cells per edge of a tile.
pub const TILE: i32 = 8;

/// Some cells of a tile: bit 8 y + x for the cell in row y and column x of it.
pub type TileBits = u64;

/// Absolute address of a tile.
///
/// ```
/// use rugosa_grid::{Cell, Tile};
/// let tile = Tile::of(Cell::new(-1, 8));
/// assert_eq!((tile, tile.origin()), (Tile::new(-1, 1), Cell::new(-8, 8)));
/// // its 64 cells, x fastest
/// let cells: Vec<Cell> = tile.cells().collect();
/// assert_eq!((cells.len(), cells[1], cells[8]), (64, Cell::new(-7, 8), Cell::new(-8, 9)));
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Tile {
    /// column of tiles
    pub x: i32,
    /// row of tiles
    pub y: i32,
}

impl Tile {
    /// The tile (x, y).
    pub const fn new(x: i32, y: i32) -> Self {
        Tile { x, y }
    }

    /// The tile that holds a cell.
    #[inline]
    pub const fn of(cell: Cell) -> Self {
        Tile::new(cell.x.div_euclid(TILE), cell.y.div_euclid(TILE))
    }

    /// Its lowest cell.
    pub const fn origin(self) -> Cell {
        Cell::new(self.x * TILE, self.y * TILE)
    }

    /// The 3 × 3 tiles around it, row by row from the south-west, itself in the middle.
    ///
    /// ```
    /// use rugosa_grid::Tile;
    /// let around = Tile::new(5, 7).around();
    /// assert_eq!([around[0], around[2], around[4]], [Tile::new(4, 6), Tile::new(6, 6), Tile::new(5, 7)]);
    /// ```
    pub fn around(self) -> [Tile; 9] {
        from_fn(|i| {
            let (x, y) = (i as i32 % 3 - 1, i as i32 / 3 - 1);
            Tile::new(self.x.wrapping_add(x), self.y.wrapping_add(y))
        })
    }

    /// Its 64 cells, row by row, whether the window holds them or not.
    pub fn cells(self) -> impl Iterator<Item = Cell> {
        (0..(TILE * TILE) as usize).map(move |place| self.cell(place))
    }

    /// Its cell in row `place / 8` and column `place % 8`.
    ///
    /// ```
    /// use rugosa_grid::{Cell, Tile};
    /// assert_eq!(Tile::new(1, -1).cell(10), Cell::new(10, -7));
    /// ```
    #[inline]
    pub fn cell(self, place: usize) -> Cell {
        let place = place as i32;
        self.origin().offset(place % TILE, place / TILE)
    }

    /// The place of a cell in the tile that holds it, as [`Tile::cell`] takes it.
    ///
    /// ```
    /// use rugosa_grid::{Cell, Tile};
    /// assert_eq!(Tile::place_of(Cell::new(10, -7)), 10);
    /// assert_eq!(Tile::of(Cell::new(10, -7)).cell(10), Cell::new(10, -7));
    /// ```
    #[inline]
    pub const fn place_of(cell: Cell) -> usize {
        (cell.y.rem_euclid(TILE) * TILE + cell.x.rem_euclid(TILE)) as usize
    }

    /// Those of its cells that `bits` names, row by row.
    ///
    /// ```
    /// use rugosa_grid::{Cell, Tile};
    /// let (west, north) = (1 << 0, 1 << 56);
    /// let cells: Vec<Cell> = Tile::new(1, -1).cells_of(west | north).collect();
    /// assert_eq!(cells, [Cell::new(8, -8), Cell::new(8, -1)]);
    /// ```
    #[inline]
    pub fn cells_of(self, bits: TileBits) -> impl Iterator<Item = Cell> {
        places_of(bits).map(move |place| self.cell(place))
    }
}

/// The places of the bits that are set, ascending.
///
/// ```
/// assert!(rugosa_grid::tile::places_of(0b1001_0010).eq([1, 4, 7]));
/// ```
#[inline(always)]
pub fn places_of(bits: u64) -> impl Iterator<Item = usize> {
    // word by word, which is all at once on a processor of 64 bits
    let rest = bits.checked_shr(usize::BITS).unwrap_or(0) as usize;
    let rest = places_in(rest).map(|place| place + usize::BITS as usize);
    places_in(bits as usize).chain(rest)
}

#[inline(always)]
fn places_in(mut word: usize) -> impl Iterator<Item = usize> {
    core::iter::from_fn(move || {
        (word != 0).then(|| {
            let place = word.trailing_zeros() as usize;
            word &= word - 1;
            place
        })
    })
}

/// Where the 64 cells of a tile live in a plane of the elements of a window: each slot is
/// the sum of a part of the row and one of the column, and lies beyond all planes where the
/// window does not hold the cell.
///
/// ```
/// use rugosa_grid::{Cell, Tile, Window, tile::TileSlots};
/// let window = Window::new(33, Cell::new(-3, 5));
/// let slots = TileSlots::of(&window, Tile::new(-1, 0)); // cells −8 … −1 × 0 … 7
/// let (outside, inside) = (slots.row(4).nth(7), slots.row(5).nth(7));
/// assert!(outside > Some(33 * 33));
/// assert_eq!(inside, window.slot(Cell::new(-1, 5)));
/// assert_eq!(Some(slots.slot(8 * 5 + 7)), inside);
/// ```
#[derive(Clone, Copy, Debug)]
pub struct TileSlots {
    rows: [usize; TILE as usize],
    columns: [usize; TILE as usize],
}

impl TileSlots {
    /// Those of `tile` in `window`.
    pub fn of(window: &Window, tile: Tile) -> Self {
        let corner = tile.origin();
        TileSlots {
            rows: window.row_parts(corner.y),
            columns: window.column_parts(corner.x),
        }
    }

    /// That of the cell in row `place / 8` and column `place % 8`, `place` below 64.
    #[inline(always)]
    pub fn slot(&self, place: usize) -> usize {
        const LAST: usize = TILE as usize - 1;
        self.rows[(place / TILE as usize) & LAST] + self.columns[place & LAST]
    }

    /// Those of the cells of a row, where they follow each other: `None` across the seam of the
    /// window's ring and its border.
    ///
    /// ```
    /// use rugosa_grid::{Cell, Tile, Window, tile::TileSlots};
    /// let window = Window::new(33, Cell::new(-12, 0)); // columns −12 … 20
    /// let span = |x| TileSlots::of(&window, Tile::new(x, 0)).span(2);
    /// let first = window.slot(Cell::new(8, 2)).unwrap();
    /// assert_eq!(span(1), Some(first..first + 8));
    /// assert_eq!([span(-2), span(2)], [None, None]); // columns −16 … −9 and 16 … 23
    /// // no such row in the window
    /// let south = |x| TileSlots::of(&window, Tile::new(x, -1)).span(2);
    /// assert!(south(1).unwrap().start > 33 * 33 && south(9).is_none());
    /// ```
    ///
    /// # Panics
    /// If there is no such row.
    #[inline(always)]
    pub fn span(&self, row: usize) -> Option<core::ops::Range<usize>> {
        const LENGTH: usize = TILE as usize;
        let [first, .., last] = self.columns;
        (last == first + LENGTH - 1).then(|| {
            let start = self.rows[row] + first;
            start..start + LENGTH
        })
    }

    /// Those of the cells of a row.
    ///
    /// # Panics
    /// If there is no such row.
    #[inline(always)]
    pub fn row(&self, row: usize) -> impl Iterator<Item = usize> {
        let start = self.rows[row];
        self.columns.iter().map(move |column| start + column)
    }
}

/// The square of tiles that a window touches.
///
/// ```
/// use rugosa_grid::{Cell, Tile, Tiles, Window};
/// let tiles = Tiles::of(&Window::around(33, Cell::new(0, 0))); // cells −16 … 16
/// assert_eq!((tiles.side(), tiles.len()), (Tiles::per_side(33), 25));
/// assert_eq!(tiles.origin(), Tile::new(-2, -2));
/// assert_eq!(tiles.tiles().last(), Some(Tile::new(2, 2)));
/// // a tile keeps its slot when the window moves, until it is left behind
/// let moved = Tiles::of(&Window::around(33, Cell::new(9, 0)));
/// assert_eq!(tiles.slot(Tile::new(1, 0)), moved.slot(Tile::new(1, 0)));
/// assert_eq!(moved.slot(Tile::new(-2, 0)), None);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Tiles(Window);

impl Tiles {
    /// Tiles per axis for a window of `side` = 8 k + 1 cells: k + 1.
    pub const fn per_side(side: usize) -> usize {
        (side - 1) / TILE as usize + 1
    }

    /// The tiles that `window` touches.
    #[inline]
    pub fn of(window: &Window) -> Self {
        Tiles(window.of_tiles())
    }

    /// Tiles in all.
    pub fn len(&self) -> usize {
        self.0.len()
    }

    /// Never.
    pub fn is_empty(&self) -> bool {
        false
    }

    /// Tiles per axis.
    pub fn side(&self) -> usize {
        self.0.side()
    }

    /// The lowest tile.
    pub fn origin(&self) -> Tile {
        Tile::new(self.0.origin().x, self.0.origin().y)
    }

    /// Where this tile lives in a plane of `side²` elements; `None` outside.
    #[inline]
    pub fn slot(&self, tile: Tile) -> Option<usize> {
        self.0.slot(Cell::new(tile.x, tile.y))
    }

    /// Where the tiles of [`Tile::around`] live; beyond all planes where there is none.
    ///
    /// ```
    /// use rugosa_grid::{Cell, Tile, Tiles, Window};
    /// let tiles = Tiles::of(&Window::around(33, Cell::new(0, 0)));
    /// let corner = Tile::new(-2, -2);
    /// for (near, slot) in corner.around().into_iter().zip(tiles.around(corner)) {
    ///     assert_eq!(tiles.slot(near), (slot < tiles.len()).then_some(slot));
    /// }
    /// ```
    pub fn around(&self, tile: Tile) -> [usize; 9] {
        let around =
            self.rectangle::<3, 3>(Tile::new(tile.x.wrapping_sub(1), tile.y.wrapping_sub(1)));
        from_fn(|i| around[i / 3][i % 3])
    }

    /// Where the tiles of a rectangle live, row by row from its lowest tile; beyond all planes
    /// where there is none.
    ///
    /// ```
    /// use rugosa_grid::{Cell, Tile, Tiles, Window};
    /// let tiles = Tiles::of(&Window::around(33, Cell::new(0, 0))); // tiles −2 … 2
    /// let [[first, second, none]] = tiles.rectangle::<3, 1>(Tile::new(1, 0));
    /// assert_eq!(Some(first), tiles.slot(Tile::new(1, 0)));
    /// assert_eq!(Some(second), tiles.slot(Tile::new(2, 0)));
    /// assert!(none > 1000 * tiles.len());
    /// ```
    #[inline]
    pub fn rectangle<const ACROSS: usize, const UP: usize>(
        &self,
        lowest: Tile,
    ) -> [[usize; ACROSS]; UP] {
        let columns: [usize; ACROSS] = self.0.column_parts(lowest.x);
        let rows: [usize; UP] = self.0.row_parts(lowest.y);
        rows.map(|row| columns.map(|column| row + column))
    }

    /// All tiles, row by row from the south-west corner.
    pub fn tiles(&self) -> impl Iterator<Item = Tile> + use<> {
        self.0.cells().map(|c| Tile::new(c.x, c.y))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_window_touches_k_plus_one_tiles_everywhere() {
        for shift in -20..20 {
            let window = Window::new(65, Cell::new(shift, -3 * shift));
            let tiles = Tiles::of(&window);
            assert_eq!(tiles.len(), 81);
            for cell in window.cells() {
                assert!(tiles.slot(Tile::of(cell)).is_some());
            }
        }
    }

    #[test]
    fn negative_cells_belong_to_negative_tiles() {
        assert_eq!(Tile::of(Cell::new(-1, -8)), Tile::new(-1, -1));
        assert_eq!(Tile::of(Cell::new(-9, 7)), Tile::new(-2, 0));
        assert!(
            Tile::new(-2, 0)
                .cells()
                .all(|c| Tile::of(c) == Tile::new(-2, 0))
        );
    }
}
