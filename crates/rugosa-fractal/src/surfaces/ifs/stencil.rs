//! Which four points and which weights make each of the 100 points of a subdivided patch.
//!
//! Everything is written in a patch's own indices, 0 … 3 and 0 … 9 both ways; only the
//! mirrored variant turns them over on the way in and out ([`turned`]).

use super::Variant;
use alloc::vec::Vec;

/// Points per side of a patch, and of a subdivided one.
pub(super) const COARSE: usize = 4;
pub(super) const FINE: usize = 10;

/// One point of the subdivided patch.
#[derive(Clone, Copy, Debug)]
pub(super) struct Point {
    /// its index in the 10 × 10 grid
    pub target: usize,
    /// indices of its sources in the 4 × 4 patch
    pub sources: [usize; 4],
    /// first of its three weights; 0 for a copy of the first source
    pub weight: usize,
    /// which group of points with the same sources it belongs to
    pub group: usize,
}

/// A set of four sources shared by several points: one of 4 row lines, 4 column lines, 9
/// cells.
#[derive(Clone, Copy, Debug)]
pub(super) struct Group {
    pub sources: [usize; 4],
    /// groups of the same class have the same weights
    pub class: usize,
}

/// The 100 points of one subdivision.
pub(super) struct Stencil {
    pub variant: Variant,
    pub points: Vec<Point>,
    pub groups: Vec<Group>,
    /// per class: the first weights of its members
    pub classes: Vec<Vec<usize>>,
}

/// The number of the copies' group.
pub(super) const COPY: usize = usize::MAX;

impl Stencil {
    pub fn new(variant: Variant) -> Stencil {
        let mut stencil = Stencil {
            variant,
            points: Vec::new(),
            groups: Vec::new(),
            classes: Vec::new(),
        };
        let lines = variant.lines();
        let columns_from = 16 + 18 * lines;
        let cells_from = columns_from + 18 * lines;
        stencil.copies();
        for axis in 0..2 {
            for line in 0..COARSE {
                let from = if axis == 0 { 16 } else { columns_from };
                stencil.line(axis, line, (line % lines, from + 18 * (line % lines)));
            }
        }
        for cell in 0..9 {
            stencil.cell(
                cell / 3,
                cell % 3,
                (2 * lines + cell, cells_from + 12 * cell),
            );
        }
        stencil
    }

    fn copies(&mut self) {
        for i in 0..16 {
            let target = 3 * (i / COARSE) * FINE + 3 * (i % COARSE);
            self.points.push(Point {
                target,
                sources: [i; 4],
                weight: 0,
                group: COPY,
            });
        }
    }

    /// Six new points on row line (axis 0) or column line (axis 1) `line`.
    fn line(&mut self, axis: usize, line: usize, (class, first_weight): (usize, usize)) {
        let place = |along: usize, side: usize, at: usize| match axis {
            0 => at * side + along,
            _ => along * side + at,
        };
        let sources = core::array::from_fn(|c| place(c, COARSE, line));
        let class = class + axis * self.variant.lines();
        let group = self.group(sources, class);
        for new in 0..6 {
            let along = 3 * (new / 2) + 1 + new % 2;
            let weight = first_weight + 3 * new;
            self.add(
                Point {
                    target: place(along, FINE, 3 * line),
                    sources,
                    weight,
                    group,
                },
                class,
            );
        }
    }

    /// Four new points inside cell (a, b).
    fn cell(&mut self, a: usize, b: usize, (class, first_weight): (usize, usize)) {
        let corner = a * COARSE + b;
        let sources = [corner, corner + 1, corner + COARSE, corner + COARSE + 1];
        let group = self.group(sources, class);
        for new in 0..4 {
            let target = (3 * a + 1 + new / 2) * FINE + 3 * b + 1 + new % 2;
            let weight = first_weight + 3 * new;
            self.add(
                Point {
                    target,
                    sources,
                    weight,
                    group,
                },
                class,
            );
        }
    }

    fn group(&mut self, sources: [usize; 4], class: usize) -> usize {
        self.groups.push(Group { sources, class });
        if self.classes.len() <= class {
            self.classes.resize(class + 1, Vec::new());
        }
        self.groups.len() - 1
    }

    fn add(&mut self, point: Point, class: usize) {
        if !self.classes[class].contains(&point.weight) {
            self.classes[class].push(point.weight);
        }
        self.points.push(point);
    }

    /// Writes the weights of bilinear interpolation.
    pub fn set_bilinear(&self, parameters: &mut [f64]) {
        for point in self.points.iter().filter(|p| p.weight > 0) {
            let (row, column) = (point.target / FINE, point.target % FINE);
            for c in 1..4 {
                let source = point.sources[c];
                let hat = |fine: usize, coarse: usize| {
                    (1.0 - (fine as f64 / 3.0 - coarse as f64).abs()).max(0.0)
                };
                parameters[point.weight + c - 1] =
                    hat(row, source / COARSE) * hat(column, source % COARSE);
            }
        }
    }

    /// The four weights of a point.
    pub fn weights(point: &Point, parameters: &[f64]) -> [f64; 4] {
        if point.weight == 0 {
            return [1.0, 0.0, 0.0, 0.0];
        }
        let w = &parameters[point.weight..point.weight + 3];
        [1.0 - w[0] - w[1] - w[2], w[0], w[1], w[2]]
    }
}

/// Local ↔ global index along one axis of patch number `patch`, `last` = 3 or 9.
#[inline]
pub(super) fn turned(variant: Variant, patch: usize, local: usize, last: usize) -> usize {
    if variant == Variant::Mirrored && patch % 2 == 1 {
        last - local
    } else {
        local
    }
}
