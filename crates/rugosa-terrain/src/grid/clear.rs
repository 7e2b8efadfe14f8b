//! Ghosts: what stood where a beam has now passed.
//!
//! A beam that returned from farther away crossed the cells before its hit. Where it
//! passed below a cell's fused elevation, the thing that was measured there is gone:
//!
//! ```text
//! gap = elevation − (highest point of the beam in the cell) − margin
//! cleared if gap > 0 and gap² > k² variance
//! ```
//!
//! k is the gate of the fusion. The cell becomes [`State::SeenThrough`]: known to be lower than it was, not known
//! where. Never cleared: the cell that was hit, and cells that were measured in the same
//! sweep (a beam below an overhang does not outvote the returns from its top).
//!
//! The cells are walked in the order the beam crosses them, with one comparison and one
//! addition per cell (Amanatides & Woo 1987, "A fast voxel traversal algorithm for ray
//! tracing"), after the beam was cut to the window and to the heights below the highest
//! cell: most of a beam is above everything. Cost: about 40 instructions per cell, at
//! most 2 × side cells. A caller short of time walks every n-th beam only. Not for beams without a return: nothing says how far they went.
//!
//! [`State::SeenThrough`]: rugosa_grid::State::SeenThrough

use super::ElevationGrid;
use crate::Ray;
use rugosa_grid::{Cell, Sample, Window, math};

/// A beam over the cells, and the sweep it belongs to.
struct Walk {
    origin: [f32; 3],
    /// from the origin to the hit
    reach: [f32; 3],
    /// the part of the beam inside the window, as fractions of its length
    span: [f32; 2],
    sweep: u16,
}

impl Walk {
    fn at(&self, t: f32) -> [f32; 3] {
        core::array::from_fn(|i| self.origin[i] + t * self.reach[i])
    }

    /// The higher of the beam's heights at two fractions of its length.
    fn highest(&self, t: [f32; 2]) -> f32 {
        let t = if self.reach[2] > 0.0 { t[1] } else { t[0] };
        self.origin[2] + t * self.reach[2]
    }
}

/// The borders that a beam crosses along one axis.
struct Axis {
    /// +1 or −1
    step: i32,
    /// fraction of the beam at which it crosses the next border
    next: f32,
    /// fraction of the beam per cell
    per_cell: f32,
}

impl Axis {
    /// `offset` from the centre of the first cell and `reach`, both in cells; `start` is
    /// the fraction at which the walk begins.
    fn new(offset: f32, reach: f32, start: f32) -> Self {
        if reach == 0.0 {
            return Axis {
                step: 0,
                next: f32::INFINITY,
                per_cell: f32::INFINITY,
            };
        }
        let per_cell = 1.0 / math::abs(reach);
        let (step, to_border) = if reach > 0.0 {
            (1, 0.5 - offset)
        } else {
            (-1, 0.5 + offset)
        };
        Axis {
            step,
            next: start + to_border * per_cell,
            per_cell,
        }
    }

    fn cross(&mut self) -> i32 {
        self.next += self.per_cell;
        self.step
    }
}

impl ElevationGrid<'_> {
    /// Clears the cells that a beam of this sweep passed below (the ray must be in the
    /// map frame and have a return at its end). Returns how many;
    /// `forget(window, samples, cell, old)` is called for each.
    ///
    /// ```
    /// use rugosa_grid::{Cell, Sample, State, Window};
    /// use rugosa_terrain::{ElevationGrid, GridConfig, GroundCell, Point, Ray};
    /// # let (mut cells, mut samples) = ([GroundCell::EMPTY; 1089], [Sample::UNKNOWN; 1089]);
    /// # let window = Window::around(33, Cell::new(0, 0));
    /// # let config = GridConfig::new(0.1);
    /// let mut grid = ElevationGrid::new(config, window, &mut cells, &mut samples).unwrap();
    /// for (x, z) in [(0.35, 1.5), (0.75, 0.2)] {
    ///     grid.fuse(&Point { position: [x, 0.05, z], variance: 1e-4, depression: 0.0 }, 1);
    /// }
    /// // in the next sweep a level beam at 0.5 m returns from 1.25 m: below the first only
    /// let ray = Ray { origin: [0.0, 0.05, 0.5], direction: [1.0, 0.0, 0.0], length: 1.25 };
    /// assert_eq!(grid.see_through(&ray, 2, |_, _, cell, _| assert_eq!(cell.x, 3)), 1);
    /// assert_eq!(grid.state(Cell::new(3, 0)), State::SeenThrough);
    /// assert_eq!(grid.state(Cell::new(7, 0)), State::Measured);
    /// ```
    pub fn see_through(
        &mut self,
        ray: &Ray,
        sweep: u16,
        mut forget: impl FnMut(&Window, &[Sample], Cell, &Sample),
    ) -> u32 {
        let reach = ray.direction.map(|u| u * ray.length);
        let Some(span) = self.inside(&ray.origin, &reach) else {
            return 0;
        };
        let walk = Walk {
            origin: ray.origin,
            reach,
            span,
            sweep,
        };
        self.walk(&walk, &mut forget)
    }

    fn walk(
        &mut self,
        walk: &Walk,
        forget: &mut impl FnMut(&Window, &[Sample], Cell, &Sample),
    ) -> u32 {
        let [enter, leave] = walk.span;
        let (hit, start, end) = (walk.at(1.0), walk.at(enter), walk.at(leave));
        let (hit, ..) = self.lattice.locate(hit[0], hit[1]);
        let (end, ..) = self.lattice.locate(end[0], end[1]);
        let (mut cell, east, north) = self.lattice.locate(start[0], start[1]);
        let per_metre = 1.0 / self.lattice.resolution();
        let mut x = Axis::new(east, walk.reach[0] * per_metre, enter);
        let mut y = Axis::new(north, walk.reach[1] * per_metre, enter);
        let (mut t, mut cleared) = (enter, 0);
        for _ in 0..end.x.abs_diff(cell.x) + end.y.abs_diff(cell.y) + 1 {
            let exit = if x.next < y.next { x.next } else { y.next };
            if cell != hit && self.is_ghost(cell, walk, [t, exit]) {
                self.release(cell, Sample::seen_through(), forget);
                cleared += 1;
            }
            t = exit;
            cell = if x.next < y.next {
                cell.offset(x.cross(), 0)
            } else {
                cell.offset(0, y.cross())
            };
        }
        cleared
    }

    /// Did the beam pass below what stands in this cell, between two fractions of its
    /// length?
    fn is_ghost(&self, cell: Cell, walk: &Walk, t: [f32; 2]) -> bool {
        let Some(slot) = self.window.slot(cell) else {
            return false;
        };
        let held = &self.cells[slot];
        if held.count() == 0 || held.last_sweep == walk.sweep {
            return false;
        }
        let gap = held.elevation - walk.highest(t) - self.config.clearing_margin;
        gap > 0.0 && gap * gap > self.gate.sigmas2 * held.variance
    }

    /// The part of a beam over the window and low enough to be below a cell, as fractions
    /// of its length; `None` where there is none or the beam is not finite.
    fn inside(&self, origin: &[f32; 3], reach: &[f32; 3]) -> Option<[f32; 2]> {
        // one sum is finite only if all its terms are
        let sum = origin[0] + origin[1] + origin[2] + reach[0] + reach[1] + reach[2];
        if !sum.is_finite() {
            return None;
        }
        let resolution = self.lattice.resolution();
        let low = self.window.origin();
        let mut span = [0.0, 1.0];
        for (axis, low) in [low.x, low.y].into_iter().enumerate() {
            let low = low as f32 * resolution - origin[axis];
            let high = low + self.window.side() as f32 * resolution;
            span = cut(span, [low, high], reach[axis])?;
        }
        let top = self.ceiling - self.config.clearing_margin - origin[2];
        cut(span, [f32::NEG_INFINITY, top], reach[2])
    }
}

/// Cuts the fractions `span` of a reach to those that lie in `slab`.
fn cut(span: [f32; 2], slab: [f32; 2], reach: f32) -> Option<[f32; 2]> {
    if reach == 0.0 {
        return (slab[0] <= 0.0 && slab[1] > 0.0).then_some(span);
    }
    let (a, b) = (slab[0] / reach, slab[1] / reach);
    let (a, b) = if a < b { (a, b) } else { (b, a) };
    let cut = [
        if a > span[0] { a } else { span[0] },
        if b < span[1] { b } else { span[1] },
    ];
    (cut[0] < cut[1]).then_some(cut)
}
