//! Slope, step height and the chance of a hidden step around each cell of a tile.
//!
//! Within a disc of radius r around a cell, from the elevations z_j (variance v_j) of its
//! measured cells at offsets (x_j, y_j) from it, relative to the cell's own elevation:
//!
//! ```text
//! slope   atan |∇|, ∇ from the least-squares plane through the z_j
//! step    max_j |z_j − z_0|
//! hidden  max_j P(|z_j − z_0| > limit),  z_j − z_0 ~ N(Δ_j, s_j²)
//!         measured j: Δ_j = z_j − z_0, s_j² = v_0 + v_j
//!         unseen j:   Δ_j = 0,         s_j² = v_0 + σ² d_j^{2H}
//! ```
//!
//! The greatest chance is that of the least (limit − |Δ_j|) / s_j, up to the far tail, which
//! doubles it at most. The last line is the roughness map at work: E|Δz| = σ d^H √(2/π), so rough ground is
//! more likely to hide a step in what was not seen. The maximum over j is a lower bound of
//! the chance that any step exceeds the limit; neighbouring cells are far from independent,
//! so the product of their chances would be no better.
//!
//! The cells of a tile and its margin are unpacked once; then each offset of the disc is a
//! shifted row, eight cells at a time, and the powers d^{2H} come from a table by squared
//! distance. Rows without a measured cell are passed over. A slope needs at least [`LEAST`] measured cells that
//! do not lie on a line; otherwise it is NaN.
//!
//! Cost: about 20 operations per offset and cell (29 offsets at 3 cells), without branches.
//! `cargo bench -p rugosa` prints the time.

use super::Limits;
use rugosa_fractal::roughness::Roughness;
use rugosa_grid::{Cell, TILE, Tile, math};
use rugosa_terrain::ElevationGrid;

/// Fewest measured cells of a slope.
pub const LEAST: f32 = 4.0;
/// Greatest radius of the disc in cells.
pub const REACH: i32 = 8;

/// Keeps variances positive \[m²\].
const TINY: f32 = 1e-12;

const LANES: usize = TILE as usize;
const SIDE: usize = LANES + 2 * REACH as usize;

/// What the ground around a cell is like.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Features {
    /// slope \[rad\]; NaN where too little was measured
    pub slope: f32,
    /// greatest difference of elevation to the cell \[m\]
    pub step: f32,
    /// chance that a step exceeds the limit
    pub hidden_step: f32,
    /// standard deviation of the cell's elevation \[m\]
    pub uncertainty: f32,
}

impl Features {
    /// Of a cell that is not measured: they mean nothing.
    const NONE: Features = Features {
        slope: f32::NAN,
        step: 0.0,
        hidden_step: 0.0,
        uncertainty: 0.0,
    };
}

/// Elevations and variances of a tile and its margin.
pub(crate) struct Patch {
    elevation: [[f32; SIDE]; SIDE],
    variance: [[f32; SIDE]; SIDE],
    /// 1 where measured, else 0
    mask: [[f32; SIDE]; SIDE],
}

/// Squared distances in cells that occur in a disc.
const SQUARES: usize = (REACH * REACH + 2) as usize;

/// What the features of a tile depend on besides its elevations.
pub(crate) struct Around {
    /// cell edge \[m\]
    resolution: f32,
    /// radius of the disc in cells
    radius: i32,
    /// the step that must not be exceeded \[m\]
    limit: f32,
    /// σ² d^{2H} by squared distance in cells; 0 where the roughness is not known
    hidden: [f32; SQUARES],
}

impl Around {
    /// For cells of `resolution` \[m\], in the limits' window, on ground of this roughness.
    pub(crate) fn new(resolution: f32, limits: &Limits, roughness: Option<&Roughness>) -> Self {
        let mut around = Around {
            resolution,
            radius: disc(limits.window / resolution),
            limit: limits.step.critical,
            hidden: [0.0; SQUARES],
        };
        let Some(r) = roughness else {
            return around;
        };
        for y in 1..=around.radius {
            for x in 0..=y.min(around.half_width(y)) {
                let square = (x * x + y * y) as usize;
                let metres = square as f32 * resolution * resolution;
                around.hidden[square] = r.sigma * r.sigma * math::powf(metres, r.hurst);
            }
        }
        around
    }

    /// Cells to the side of the middle that the disc holds in row `y`.
    fn half_width(&self, y: i32) -> i32 {
        let most = self.radius * self.radius + 1 - y * y;
        (0..=self.radius).rev().find(|x| x * x <= most).unwrap_or(0)
    }

    /// Cells around a tile that its features depend on.
    pub(crate) fn margin(&self) -> i32 {
        self.radius
    }
}

impl Patch {
    /// Nothing measured.
    pub(crate) const fn new() -> Self {
        Patch {
            elevation: [[0.0; SIDE]; SIDE],
            variance: [[0.0; SIDE]; SIDE],
            mask: [[0.0; SIDE]; SIDE],
        }
    }

    /// Unpacks a tile and `margin` cells around it.
    pub(crate) fn fill(&mut self, grid: &ElevationGrid, tile: Tile, margin: i32) {
        let corner = tile.origin().offset(-REACH, -REACH);
        for y in REACH - margin..TILE + REACH + margin {
            for x in REACH - margin..TILE + REACH + margin {
                let ground = grid.ground(Cell::offset(corner, x, y));
                let (x, y) = (x as usize, y as usize);
                self.mask[y][x] = f32::from(u8::from(ground.is_some()));
                let (z, v) = ground.map_or((0.0, 0.0), |g| (g.elevation, g.variance));
                self.elevation[y][x] = z;
                self.variance[y][x] = v;
            }
        }
    }

    /// Features of the eight cells of one row of the tile; of unmeasured cells they mean
    /// nothing.
    pub(crate) fn row(&self, row: usize, around: &Around) -> [Features; LANES] {
        if !(0..LANES).any(|column| self.is_measured(row, column)) {
            return [Features::NONE; LANES];
        }
        let mut sums = Sums::new(self, row);
        for y in -around.radius..=around.radius {
            let half = around.half_width(y);
            let mut line = Line::default();
            for x in (-half..=half).filter(|&x| x != 0 || y != 0) {
                let hidden = around.hidden[(x * x + y * y) as usize];
                let near = sums.neighbours(self, [x, y]);
                line.add(&near, x as f32);
                sums.meet(&near, [around.limit, hidden]);
            }
            sums.enter(&line, y as f32);
        }
        sums.finish(around)
    }

    /// Is this cell of the tile measured?
    pub(crate) fn is_measured(&self, row: usize, column: usize) -> bool {
        self.mask[row + REACH as usize][column + REACH as usize] > 0.0
    }
}

/// Radius in whole cells, 1 … [`REACH`].
fn disc(cells: f32) -> i32 {
    math::round_index(cells).clamp(1, REACH)
}

type Lanes = [f32; LANES];

/// Sums over the offsets of one row of the disc, for eight cells.
#[derive(Default)]
struct Line {
    count: Lanes,
    x: Lanes,
    xx: Lanes,
    z: Lanes,
    xz: Lanes,
}

impl Line {
    #[inline(always)]
    fn add(&mut self, near: &Neighbours, x: f32) {
        for i in 0..LANES {
            self.count[i] += near.mask[i];
            self.x[i] += x * near.mask[i];
            self.xx[i] += x * x * near.mask[i];
            self.z[i] += near.rise[i];
            self.xz[i] += x * near.rise[i];
        }
    }
}

/// The cells at one offset from eight cells.
struct Neighbours {
    /// 1 where measured, else 0
    mask: Lanes,
    /// elevation above that of the cell; 0 where not measured
    rise: Lanes,
    variance: Lanes,
}

/// Sums over the offsets, for eight cells.
struct Sums {
    row: usize,
    centre: Lanes,
    variance: Lanes,
    measured: Lanes,
    count: Lanes,
    /// Σx, Σy, Σz
    first: [Lanes; 3],
    /// Σxx, Σxy, Σyy, Σxz, Σyz
    second: [Lanes; 5],
    step: Lanes,
    /// |Δ| and s² of the neighbour most likely to exceed the limit: that of the least
    /// (limit − |Δ|) |limit − |Δ|| / s²
    worst: [Lanes; 2],
    /// the numerator of its quotient; the denominator is its s²
    margin: Lanes,
}

/// Greater than any numerator.
const FAR: f32 = 1e30;

impl Sums {
    fn new(patch: &Patch, row: usize) -> Self {
        let at = row + REACH as usize;
        let lanes =
            |plane: &[[f32; SIDE]; SIDE]| core::array::from_fn(|i| plane[at][i + REACH as usize]);
        let variance: Lanes = lanes(&patch.variance);
        let measured = lanes(&patch.mask);
        Sums {
            row,
            centre: lanes(&patch.elevation),
            variance,
            measured,
            count: measured,
            first: [[0.0; LANES]; 3],
            second: [[0.0; LANES]; 5],
            step: [0.0; LANES],
            worst: [[0.0; LANES], variance.map(|v| v + TINY)],
            margin: [FAR; LANES],
        }
    }

    /// What lies at an offset from the eight cells.
    #[inline(always)]
    fn neighbours(&self, patch: &Patch, [x, y]: [i32; 2]) -> Neighbours {
        let row = (self.row as i32 + REACH + y) as usize;
        let first = (REACH + x) as usize;
        // one check of the bounds for all eight
        let lanes = |plane: &[[f32; SIDE]; SIDE]| -> Lanes {
            let eight = &plane[row][first..first + LANES];
            eight.try_into().unwrap_or([0.0; LANES])
        };
        let (mask, heights) = (lanes(&patch.mask), lanes(&patch.elevation));
        Neighbours {
            mask,
            rise: core::array::from_fn(|i| (heights[i] - self.centre[i]) * mask[i]),
            variance: lanes(&patch.variance),
        }
    }

    /// Is a neighbour the highest step so far, or the most likely to exceed the limit?
    #[inline(always)]
    fn meet(&mut self, near: &Neighbours, [limit, hidden]: [f32; 2]) {
        let rise = near.rise.map(math::abs);
        for (step, rise) in self.step.iter_mut().zip(rise) {
            *step = select(mask_of(rise > *step), rise, *step);
        }
        // the variance of what was not measured is 0, so this is one or the other
        let spread: Lanes = core::array::from_fn(|i| {
            self.variance[i] + (near.variance[i] + hidden * (1.0 - near.mask[i])) + TINY
        });
        let margin = rise.map(|rise| (limit - rise) * math::abs(limit - rise));
        // a / b < c / d without a division, b and d being positive
        let worse: [u32; LANES] = core::array::from_fn(|i| {
            mask_of(margin[i] * self.worst[1][i] < self.margin[i] * spread[i])
        });
        for i in 0..LANES {
            self.margin[i] = select(worse[i], margin[i], self.margin[i]);
            self.worst[0][i] = select(worse[i], rise[i], self.worst[0][i]);
            self.worst[1][i] = select(worse[i], spread[i], self.worst[1][i]);
        }
    }

    /// Takes over the sums of the disc's row `y`.
    #[inline(always)]
    fn enter(&mut self, line: &Line, y: f32) {
        for i in 0..LANES {
            self.count[i] += line.count[i];
            self.first[0][i] += line.x[i];
            self.first[1][i] += y * line.count[i];
            self.first[2][i] += line.z[i];
            self.second[0][i] += line.xx[i];
            self.second[1][i] += y * line.x[i];
            self.second[2][i] += y * y * line.count[i];
            self.second[3][i] += line.xz[i];
            self.second[4][i] += y * line.z[i];
        }
    }

    fn finish(&self, around: &Around) -> [Features; LANES] {
        core::array::from_fn(|i| match self.measured[i] > 0.0 {
            false => Features::NONE,
            true => Features {
                slope: self.slope(i, around.resolution),
                step: self.step[i],
                hidden_step: exceeds(self.worst[0][i], self.worst[1][i], around.limit),
                uncertainty: math::sqrt(self.variance[i]),
            },
        })
    }

    fn slope(&self, i: usize, resolution: f32) -> f32 {
        let n = self.count[i];
        let [x, y, z] = self.first.map(|s| s[i]);
        let [xx, xy, yy, xz, yz] = self.second.map(|s| s[i]);
        let (xx, xy, yy) = (xx - x * x / n, xy - x * y / n, yy - y * y / n);
        let (xz, yz) = (xz - x * z / n, yz - y * z / n);
        let det = xx * yy - xy * xy;
        if n < LEAST || det < 0.1 {
            return f32::NAN;
        }
        let east = (xz * yy - yz * xy) / det;
        let north = (yz * xx - xz * xy) / det;
        math::atan2(math::sqrt(east * east + north * north), resolution)
    }
}

/// All bits, or none.
#[inline(always)]
fn mask_of(is: bool) -> u32 {
    u32::from(is).wrapping_neg()
}

/// `a` where the mask has all bits, else `b`: no compiler makes a branch of it.
#[inline(always)]
fn select(mask: u32, a: f32, b: f32) -> f32 {
    f32::from_bits((a.to_bits() & mask) | (b.to_bits() & !mask))
}

/// P(|Δ| > limit) for Δ ~ N(mean, variance); 0 below 10⁻⁸.
fn exceeds(mean: f32, variance: f32, limit: f32) -> f32 {
    if variance <= 0.0 {
        return if mean > limit { 1.0 } else { 0.0 };
    }
    let scale = 1.0 / math::sqrt(2.0 * variance);
    let tail = |x: f32| if x > 4.0 { 0.0 } else { math::erfc(x) };
    0.5 * (tail((limit - mean) * scale) + tail((limit + mean) * scale))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn patch(height: impl Fn(f32, f32) -> Option<f32>) -> Patch {
        let mut patch = Patch::new();
        for y in 0..SIDE {
            for x in 0..SIDE {
                if let Some(z) = height(x as f32 * 0.1, y as f32 * 0.1) {
                    patch.elevation[y][x] = z;
                    patch.variance[y][x] = 1e-6;
                    patch.mask[y][x] = 1.0;
                }
            }
        }
        patch
    }

    fn around(roughness: Option<&Roughness>) -> Around {
        let mut limits = Limits::default();
        limits.step.critical = 0.2;
        Around::new(0.1, &limits, roughness)
    }

    #[test]
    fn a_plane_has_its_slope_and_the_step_of_its_window() {
        let patch = patch(|x, y| Some(5.0 + 0.3 * x - 0.4 * y));
        for features in patch.row(3, &around(None)) {
            assert!((features.slope - 0.5f32.atan()).abs() < 1e-4);
            assert!((features.step - 0.15).abs() < 0.01, "{}", features.step);
            assert!(features.hidden_step < 1e-6);
        }
    }

    #[test]
    fn a_step_is_seen_from_its_neighbourhood_only() {
        let patch = patch(|x, _| Some(if x > 1.15 { 0.5 } else { 0.0 }));
        let row = patch.row(0, &around(None));
        // the tile begins at column 8; the wall stands between columns 11 and 12
        assert_eq!(row[0].step, 0.0);
        assert!((row[1].step - 0.5).abs() < 1e-6 && (row[6].step - 0.5).abs() < 1e-6);
        assert_eq!(row[7].step, 0.0);
        assert!(row[3].hidden_step > 0.999 && row[0].hidden_step < 1e-6);
    }

    #[test]
    fn rough_ground_hides_steps_where_nothing_was_seen() {
        let patch = patch(|x, y| (x + y < 2.25).then_some(0.0));
        let rough = |sigma| Roughness {
            hurst: 0.5,
            sigma,
            ..Roughness::default()
        };
        let chance = |sigma| patch.row(4, &around(Some(&rough(sigma))))[2].hidden_step;
        assert!(chance(0.05) < 1e-4);
        // σ(0.3 m) = 0.5 √0.3 = 0.274: P(|Δ| > 0.2) = erfc(0.2 / (0.274 √2)) = 0.465
        assert!((chance(0.5) - 0.465).abs() < 0.03, "{}", chance(0.5));
        assert!(patch.row(0, &around(Some(&rough(0.5))))[0].hidden_step < 1e-4);
    }

    #[test]
    fn too_little_is_no_slope() {
        let patch = patch(|x, y| ((y - 1.2).abs() < 0.05 && x < 1.25).then_some(x));
        assert!(patch.row(4, &around(None))[2].slope.is_nan());
    }
}
