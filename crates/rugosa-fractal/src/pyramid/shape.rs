//! Sizes and addresses of a pyramid.
//!
//! A pyramid over side × side cells, side = 2^k + 1, has the levels 0 … top with
//! (2·2^l + 1)² nodes each, a ghost node beyond each border, and the cells themselves as
//! the finest level top + 1. What lives on levels 0 … top is kept in one packed vector:
//! the plane's three numbers (slope in x, slope in y, mean level), then the levels from
//! the coarsest to the finest, each row by row. It has about a third as many elements as
//! there are cells.

use core::ops::Range;

/// Smallest side of a pyramid.
pub const MIN_SIDE: usize = 17;
/// Largest side of a pyramid.
pub const MAX_SIDE: usize = 4097;
/// Elements of the plane at the head of a packed vector.
pub(crate) const PLANE: usize = 3;

/// The sizes of a pyramid.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Shape {
    /// cells per edge
    pub side: usize,
    /// finest of the packed levels
    pub top: usize,
    /// the levels below this one are solved densely by the preconditioner
    pub dense: usize,
}

impl Shape {
    /// `None` if `side` is not 2^k + 1 between [`MIN_SIDE`] and [`MAX_SIDE`].
    pub const fn new(side: usize) -> Option<Shape> {
        if side < MIN_SIDE || side > MAX_SIDE || !(side - 1).is_power_of_two() {
            return None;
        }
        let top = (side - 1).trailing_zeros() as usize - 2;
        let dense = if side > 65 { 2 } else { 1 };
        Some(Shape { side, top, dense })
    }

    /// Nodes per edge of level `l`, ghosts included; of the cells for `l` = top + 1.
    pub const fn size(l: usize) -> usize {
        (2 << l) + 3
    }

    /// Where level `l` begins in a packed vector.
    pub const fn start(l: usize) -> usize {
        // Σ (2·2^i + 3)² = 4 (4^l − 1)/3 + 12 (2^l − 1) + 9 l
        PLANE + 4 * ((1 << (2 * l)) - 1) / 3 + 12 * ((1 << l) - 1) + 9 * l
    }

    /// Elements of a packed vector.
    pub const fn packed(&self) -> usize {
        Self::start(self.top + 1)
    }

    /// Unknowns of the dense block.
    pub const fn block(&self) -> usize {
        Self::start(self.dense)
    }

    /// Where level `l` stands in a packed vector.
    pub fn level(l: usize) -> Range<usize> {
        Self::start(l)..Self::start(l + 1)
    }

    /// Levels of noise, the finest one included.
    pub const fn levels(&self) -> usize {
        self.top + 2
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_follow_each_other() {
        let mut next = PLANE;
        for l in 0..9 {
            assert_eq!(Shape::start(l), next);
            next += Shape::size(l) * Shape::size(l);
        }
        for (side, top) in [(17, 2), (33, 3), (65, 4), (257, 6), (1025, 8)] {
            let shape = Shape::new(side).unwrap();
            assert_eq!(shape.top, top);
            assert_eq!(Shape::size(top + 1), side + 2);
        }
        for side in [0, 1, 2, 5, 9, 16, 18, 64, 66, 16385] {
            assert_eq!(Shape::new(side), None, "{side}");
        }
    }
}
