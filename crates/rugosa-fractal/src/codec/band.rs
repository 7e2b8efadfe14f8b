//! Where the coefficients of a band lie in the grid.

use super::lifting;
use crate::surfaces::Shape;

/// One kind of detail at one level: coefficient (i, j) is element
/// `first + i · down + j · right` of the grid.
#[derive(Clone, Copy, Debug)]
pub(super) struct Band {
    pub level: u32,
    pub rows_high: bool,
    pub columns_high: bool,
    pub rows: usize,
    pub columns: usize,
    pub first: usize,
    pub down: usize,
    pub right: usize,
}

impl Band {
    /// The details of `level` (1 is the finest) that are high in the directions named.
    pub fn new(shape: Shape, level: u32, rows_high: bool, columns_high: bool) -> Self {
        let half = 1usize << (level - 1);
        let count = |side: usize, high: bool| {
            let all = lifting::on(side, half);
            if high { all / 2 } else { all.div_ceil(2) }
        };
        let start = |high: bool| if high { half } else { 0 };
        Band {
            level,
            rows_high,
            columns_high,
            rows: count(shape.rows, rows_high),
            columns: count(shape.columns, columns_high),
            first: start(rows_high) * shape.columns + start(columns_high),
            down: 2 * half * shape.columns,
            right: 2 * half,
        }
    }

    /// The three kinds of detail of a level, in the order of the stream.
    pub fn of_level(shape: Shape, level: u32) -> [Band; 3] {
        [(true, false), (false, true), (true, true)]
            .map(|(rows_high, columns_high)| Band::new(shape, level, rows_high, columns_high))
    }

    pub fn is_empty(&self) -> bool {
        self.rows == 0 || self.columns == 0
    }

    /// Index in the grid of coefficient (i, j).
    #[inline]
    pub fn at(&self, i: usize, j: usize) -> usize {
        self.first + i * self.down + j * self.right
    }

    /// Indices of the coefficients of an area.
    pub fn indices(self, area: Area) -> impl Iterator<Item = usize> {
        (area.top..area.bottom)
            .flat_map(move |i| (area.left..area.right).map(move |j| self.at(i, j)))
    }

    /// All of it.
    pub fn all(&self) -> Area {
        Area {
            top: 0,
            bottom: self.rows,
            left: 0,
            right: self.columns,
        }
    }
}

/// Rows `top .. bottom`, columns `left .. right` of a band.
#[derive(Clone, Copy, Debug)]
pub(super) struct Area {
    pub top: usize,
    pub bottom: usize,
    pub left: usize,
    pub right: usize,
}

impl Area {
    /// The area of the parents in the band `parent`.
    pub fn of_parents(&self, parent: &Band) -> Area {
        Area {
            top: self.top / 2,
            bottom: self.bottom.div_ceil(2).min(parent.rows),
            left: self.left / 2,
            right: self.right.div_ceil(2).min(parent.columns),
        }
    }
}

/// Which bands hold anything.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Occupied(u64);

impl Occupied {
    fn bit(level: u32, rows_high: bool, columns_high: bool) -> u64 {
        1 << (4 * level + 2 * u32::from(rows_high) + u32::from(columns_high))
    }

    pub fn add(&mut self, band: &Band) {
        self.0 |= Self::bit(band.level, band.rows_high, band.columns_high);
    }

    pub fn holds(&self, band: &Band) -> bool {
        self.0 & Self::bit(band.level, band.rows_high, band.columns_high) != 0
    }

    /// (any detail of this level along columns, any along rows).
    pub fn directions(&self, level: u32) -> (bool, bool) {
        let both = Self::bit(level, true, true);
        (
            self.0 & (Self::bit(level, true, false) | both) != 0,
            self.0 & (Self::bit(level, false, true) | both) != 0,
        )
    }
}
