//! Cells on the map plane and the square window of them that is kept in memory.
//!
//! A cell is half-open: cell (x, y) covers `[x, x + 1) × [y, y + 1)` resolutions, its
//! index is `floor(p / resolution)` and its centre lies at index + 0.5. The map frame's
//! origin is the corner of cell (0, 0); there is no other anchor, so a cell has one
//! address for ever ("absolute address"), however the window moves.
//!
//! The window keeps `side × side` cells in a ring: the cell (x, y) always lives in the
//! slot (x mod side, y mod side). Slots never leave the modules that own a plane of
//! cells; everybody else speaks of [`Cell`]s.
//!
//! Cost: a slot is two subtractions, two comparisons and a multiplication.

use crate::math;
use crate::tile::{Tile, Tiles};
use core::array::from_fn;

/// Absolute address of a cell: column `x` to the east, row `y` to the north.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Cell {
    /// column, growing with the map's x
    pub x: i32,
    /// row, growing with the map's y
    pub y: i32,
}

impl Cell {
    /// The cell (x, y).
    pub const fn new(x: i32, y: i32) -> Self {
        Cell { x, y }
    }

    /// The cell `dx` columns and `dy` rows further; wraps at the ends of the integers.
    ///
    /// ```
    /// use rugosa_grid::Cell;
    /// // two cells to the west, one to the north
    /// assert_eq!(Cell::new(1, 1).offset(-2, 1), Cell::new(-1, 2));
    /// ```
    pub const fn offset(self, dx: i32, dy: i32) -> Self {
        Cell::new(self.x.wrapping_add(dx), self.y.wrapping_add(dy))
    }
}

/// Metres ↔ cells.
///
/// ```
/// use rugosa_grid::{Cell, Lattice};
/// let lattice = Lattice::new(0.5); // metres
/// let (cell, east, north) = lattice.locate(1.375, -0.125);
/// assert_eq!(cell, Cell::new(2, -1));
/// // a quarter of a cell east and north of the centre
/// assert_eq!((east, north), (0.25, 0.25));
/// assert_eq!(lattice.centre(cell), (1.25, -0.25));
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lattice {
    resolution: f32,
    per_metre: f32,
}

impl Lattice {
    /// Cells with an edge of `resolution` metres (positive and finite).
    pub fn new(resolution: f32) -> Self {
        Lattice {
            resolution,
            per_metre: 1.0 / resolution,
        }
    }

    /// Cell edge \[m\].
    pub fn resolution(&self) -> f32 {
        self.resolution
    }

    /// The cell that holds the point (x, y) \[m\] and the point's offset from the
    /// cell's centre, in cells, in \[−0.5, 0.5\].
    #[inline]
    pub fn locate(&self, x: f32, y: f32) -> (Cell, f32, f32) {
        let (cx, cy) = (x * self.per_metre, y * self.per_metre);
        let cell = Cell::new(math::floor_index(cx), math::floor_index(cy));
        (cell, cx - cell.x as f32 - 0.5, cy - cell.y as f32 - 0.5)
    }

    /// Centre of a cell \[m\].
    pub fn centre(&self, cell: Cell) -> (f32, f32) {
        (
            (cell.x as f32 + 0.5) * self.resolution,
            (cell.y as f32 + 0.5) * self.resolution,
        )
    }
}

/// A square of cells in a ring buffer.
///
/// `side` is 2^k + 1 with 33 ≤ side ≤ 1025 where the pyramid is wanted; the window
/// itself takes any side of the form 8 k + 1.
///
/// ```
/// use rugosa_grid::{Cell, Window};
/// let window = Window::around(33, Cell::new(0, 0));
/// assert_eq!((window.origin(), window.len()), (Cell::new(-16, -16), 1089));
/// let (first, second) = (window.cells().next(), window.cells().nth(1));
/// assert_eq!((first, second), (Some(Cell::new(-16, -16)), Some(Cell::new(-15, -16))));
/// // two columns to the east, one row to the north: what stays keeps its slot
/// let moved = Window::around(33, Cell::new(2, 1));
/// assert_eq!(window.slot(Cell::new(16, 5)), moved.slot(Cell::new(16, 5)));
/// assert_eq!(window.leaving(&moved).count(), 2 * 33 + 31);
/// assert!(window.leaving(&moved).all(|cell| cell.x < -14 || cell.y < -15));
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Window {
    side: i32,
    origin: Cell,
    start: Cell,
    /// the start of the ring of tiles, which would be two divisions for each [`Tiles::of`]
    tiles_start: Cell,
}

impl Window {
    /// A window whose lowest cell (least x, least y) is `origin`.
    pub fn new(side: usize, origin: Cell) -> Self {
        let side = side as i32;
        let tile = Tile::of(origin);
        let tiles = Tiles::per_side(side as usize) as i32;
        Window {
            side,
            origin,
            start: Cell::new(origin.x.rem_euclid(side), origin.y.rem_euclid(side)),
            tiles_start: Cell::new(tile.x.rem_euclid(tiles), tile.y.rem_euclid(tiles)),
        }
    }

    /// The tiles that it touches, as a window of their own.
    #[inline]
    pub(crate) fn of_tiles(&self) -> Self {
        let lowest = Tile::of(self.origin);
        Window {
            side: Tiles::per_side(self.side()) as i32,
            origin: Cell::new(lowest.x, lowest.y),
            start: self.tiles_start,
            tiles_start: Cell::default(),
        }
    }

    /// A window with `centre` in its middle.
    pub fn around(side: usize, centre: Cell) -> Self {
        let half = (side / 2) as i32;
        Window::new(side, centre.offset(-half, -half))
    }

    /// Cells per edge.
    pub fn side(&self) -> usize {
        self.side as usize
    }

    /// Cells in all.
    pub fn len(&self) -> usize {
        self.side() * self.side()
    }

    /// Never: a window holds at least one cell.
    pub fn is_empty(&self) -> bool {
        false
    }

    /// The lowest cell.
    pub fn origin(&self) -> Cell {
        self.origin
    }

    /// The cell in the middle.
    pub fn centre(&self) -> Cell {
        self.origin.offset(self.side / 2, self.side / 2)
    }

    /// Does the window hold this cell?
    #[inline]
    pub fn contains(&self, cell: Cell) -> bool {
        (cell.x.wrapping_sub(self.origin.x) as u32) < self.side as u32
            && (cell.y.wrapping_sub(self.origin.y) as u32) < self.side as u32
    }

    /// Where this cell lives in a plane of `side²` elements; `None` outside the window.
    #[inline]
    pub fn slot(&self, cell: Cell) -> Option<usize> {
        Some(self.row_part(cell.y)? + self.column_part(cell.x)?)
    }

    /// What the row `y` adds to the slots of its cells; `None` outside the window. With
    /// [`Window::column_part`], for those who visit many cells of a few rows and columns.
    ///
    /// ```
    /// use rugosa_grid::{Cell, Window};
    /// let window = Window::around(33, Cell::new(40, -7));
    /// let row = window.row_part(-7).unwrap();
    /// for x in 24..57 {
    ///     let slot = row + window.column_part(x).unwrap();
    ///     assert_eq!(window.slot(Cell::new(x, -7)), Some(slot));
    /// }
    /// assert_eq!((window.column_part(57), window.row_part(10)), (None, None));
    /// ```
    #[inline]
    pub fn row_part(&self, y: i32) -> Option<usize> {
        let row = y.wrapping_sub(self.origin.y);
        ((row as u32) < self.side as u32)
            .then(|| (wrap(row + self.start.y, self.side) * self.side) as usize)
    }

    /// What the column `x` adds to the slots of its cells; `None` outside the window.
    #[inline]
    pub fn column_part(&self, x: i32) -> Option<usize> {
        let column = x.wrapping_sub(self.origin.x);
        ((column as u32) < self.side as u32)
            .then(|| wrap(column + self.start.x, self.side) as usize)
    }

    /// The parts of `N` rows from `y` on; half of `usize::MAX` for those outside the window.
    ///
    /// ```
    /// use rugosa_grid::{Cell, Window};
    /// let window = Window::around(33, Cell::new(40, -7)); // rows −23 … 9
    /// let [first, second, outside] = window.row_parts(8);
    /// assert_eq!((Some(first), Some(second)), (window.row_part(8), window.row_part(9)));
    /// assert_eq!(outside, usize::MAX / 2);
    /// ```
    #[inline]
    pub fn row_parts<const N: usize>(&self, y: i32) -> [usize; N] {
        parts(self.side(), |i| self.row_part(y.wrapping_add(i)))
    }

    /// The parts of `N` columns from `x` on, in the same way.
    #[inline]
    pub fn column_parts<const N: usize>(&self, x: i32) -> [usize; N] {
        parts(1, |i| self.column_part(x.wrapping_add(i)))
    }

    /// All cells, row by row from the south-west corner, x fastest.
    pub fn cells(&self) -> impl Iterator<Item = Cell> + use<> {
        let (origin, side) = (self.origin, self.side);
        (0..side * side).map(move |i| origin.offset(i % side, i / side))
    }

    /// The cells of this window that `next` does not hold: what a move leaves behind.
    /// Same order as [`Window::cells`].
    pub fn leaving(&self, next: &Window) -> impl Iterator<Item = Cell> + use<> {
        let next = *next;
        self.cells().filter(move |&cell| !next.contains(cell))
    }
}

/// Parts that are `step` apart unless the ring is joined between them.
#[inline]
fn parts<const N: usize>(step: usize, part: impl Fn(i32) -> Option<usize>) -> [usize; N] {
    if let (Some(first), Some(last)) = (part(0), part(N as i32 - 1))
        && last == first + step * (N - 1)
    {
        return from_fn(|i| first + step * i);
    }
    from_fn(|i| part(i as i32).unwrap_or(usize::MAX / 2))
}

#[inline]
fn wrap(i: i32, side: i32) -> i32 {
    if i >= side { i - side } else { i }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_cell_keeps_its_slot_wherever_the_window_goes(
            x in -5000..5000i32, y in -5000..5000i32, dx in -64..65i32, dy in -64..65i32
        ) {
            let side = 65;
            let cell = Cell::new(x, y);
            let a = Window::around(side, cell);
            let b = Window::around(side, cell.offset(dx / 2, dy / 2));
            prop_assert_eq!(a.slot(cell), b.slot(cell));
            let expected = y.rem_euclid(65) * 65 + x.rem_euclid(65);
            prop_assert_eq!(a.slot(cell), Some(expected as usize));
        }

        #[test]
        fn a_point_lies_in_its_cell(x in -100f32..100.0, y in -100f32..100.0) {
            let lattice = Lattice::new(0.1);
            let (cell, ex, ey) = lattice.locate(x, y);
            let (cx, cy) = lattice.centre(cell);
            prop_assert!((cx + ex * 0.1 - x).abs() < 2e-5 && (cy + ey * 0.1 - y).abs() < 2e-5);
            prop_assert!(ex.abs() <= 0.5 && ey.abs() <= 0.5);
        }
    }

    #[test]
    fn slots_are_a_permutation_after_a_move() {
        let window = Window::new(33, Cell::new(-7, 100));
        let mut seen = [false; 33 * 33];
        for cell in window.cells() {
            let slot = window.slot(cell).unwrap();
            assert!(!core::mem::replace(&mut seen[slot], true));
        }
        assert!(seen.iter().all(|&s| s));
        assert_eq!(window.slot(Cell::new(-8, 100)), None);
        assert_eq!(window.slot(Cell::new(-7, 133)), None);
    }

    #[test]
    fn leaving_is_the_set_difference() {
        let a = Window::new(33, Cell::new(0, 0));
        let b = Window::new(33, Cell::new(2, -1));
        assert_eq!(a.leaving(&b).count(), 33 * 33 - 31 * 32);
        assert!(a.leaving(&b).all(|c| c.x < 2 || c.y > 31));
        assert_eq!(a.leaving(&a).count(), 0);
    }
}
