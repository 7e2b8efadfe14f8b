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
//! shifted row, eight cells at a time. A slope needs at least [`LEAST`] measured cells that
//! do not lie on a line; otherwise it is NaN.
//!
//! Cost: about 25 operations per offset and cell (29 offsets at 3 cells), without branches.

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

/// Elevations and variances of a tile and its margin.
pub(crate) struct Patch {
    elevation: [[f32; SIDE]; SIDE],
    variance: [[f32; SIDE]; SIDE],
    /// 1 where measured, else 0
    mask: [[f32; SIDE]; SIDE],
}

/// What the features of a tile depend on besides its elevations.
pub(crate) struct Around<'a> {
    /// cell edge \[m\]
    pub resolution: f32,
    /// radius of the disc \[m\]
    pub radius: f32,
    /// the step that must not be exceeded \[m\]
    pub limit: f32,
    /// roughness of the tile, where there is one
    pub roughness: Option<&'a Roughness>,
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
        let mut sums = Sums::new(self, row);
        let radius = disc(around.radius / around.resolution);
        for y in -radius..=radius {
            for x in -radius..=radius {
                let square = x * x + y * y;
                if square > 0 && square <= radius * radius + 1 {
                    let hidden = around.hidden_variance(square);
                    sums.add(self, [x, y], [around.limit, hidden]);
                }
            }
        }
        sums.finish(around)
    }

    /// Is this cell of the tile measured?
    pub(crate) fn is_measured(&self, row: usize, column: usize) -> bool {
        self.mask[row + REACH as usize][column + REACH as usize] > 0.0
    }
}

/// Radius in whole cells, 1 … [`REACH`].
pub(crate) fn disc(cells: f32) -> i32 {
    math::round_index(cells).clamp(1, REACH)
}

impl Around<'_> {
    /// σ² d^{2H} of the squared distance in cells; 0 where the roughness is not known.
    fn hidden_variance(&self, square: i32) -> f32 {
        self.roughness.map_or(0.0, |r| {
            let square = square as f32 * self.resolution * self.resolution;
            r.sigma * r.sigma * math::powf(square, r.hurst)
        })
    }
}

type Lanes = [f32; LANES];

/// Sums over the offsets, for eight cells.
struct Sums {
    row: usize,
    centre: Lanes,
    variance: Lanes,
    count: Lanes,
    /// Σx, Σy, Σz
    first: [Lanes; 3],
    /// Σxx, Σxy, Σyy, Σxz, Σyz
    second: [Lanes; 5],
    step: Lanes,
    /// |Δ| and s² of the neighbour most likely to exceed the limit
    worst: [Lanes; 2],
    /// its (limit − |Δ|) |limit − |Δ|| / s², the least of all
    margin: Lanes,
}

impl Sums {
    fn new(patch: &Patch, row: usize) -> Self {
        let at = row + REACH as usize;
        let lanes =
            |plane: &[[f32; SIDE]; SIDE]| core::array::from_fn(|i| plane[at][i + REACH as usize]);
        let variance: Lanes = lanes(&patch.variance);
        Sums {
            row,
            centre: lanes(&patch.elevation),
            variance,
            count: lanes(&patch.mask),
            first: [[0.0; LANES]; 3],
            second: [[0.0; LANES]; 5],
            step: [0.0; LANES],
            worst: [[0.0; LANES], variance],
            margin: [f32::INFINITY; LANES],
        }
    }

    #[inline(always)]
    fn add(&mut self, patch: &Patch, [x, y]: [i32; 2], [limit, hidden]: [f32; 2]) {
        let row = (self.row as i32 + REACH + y) as usize;
        let first = (REACH + x) as usize;
        let (fx, fy) = (x as f32, y as f32);
        for i in 0..LANES {
            let mask = patch.mask[row][first + i];
            let dz = (patch.elevation[row][first + i] - self.centre[i]) * mask;
            self.count[i] += mask;
            self.first[0][i] += fx * mask;
            self.first[1][i] += fy * mask;
            self.first[2][i] += dz;
            self.second[0][i] += fx * fx * mask;
            self.second[1][i] += fx * fy * mask;
            self.second[2][i] += fy * fy * mask;
            self.second[3][i] += fx * dz;
            self.second[4][i] += fy * dz;
            let rise = math::abs(dz);
            self.step[i] = if rise > self.step[i] {
                rise
            } else {
                self.step[i]
            };
            let seen = patch.variance[row][first + i];
            let spread = self.variance[i] + if mask > 0.0 { seen } else { hidden } + TINY;
            let short = limit - rise;
            let margin = short * math::abs(short) / spread;
            let is_worse = margin < self.margin[i];
            self.margin[i] = if is_worse { margin } else { self.margin[i] };
            self.worst[0][i] = if is_worse { rise } else { self.worst[0][i] };
            self.worst[1][i] = if is_worse { spread } else { self.worst[1][i] };
        }
    }

    fn finish(&self, around: &Around) -> [Features; LANES] {
        core::array::from_fn(|i| Features {
            slope: self.slope(i, around.resolution),
            step: self.step[i],
            hidden_step: exceeds(self.worst[0][i], self.worst[1][i], around.limit),
            uncertainty: math::sqrt(self.variance[i]),
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

/// P(|Δ| > limit) for Δ ~ N(mean, variance).
fn exceeds(mean: f32, variance: f32, limit: f32) -> f32 {
    if variance <= 0.0 {
        return if mean > limit { 1.0 } else { 0.0 };
    }
    let scale = 1.0 / math::sqrt(2.0 * variance);
    0.5 * (math::erfc((limit - mean) * scale) + math::erfc((limit + mean) * scale))
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

    fn around(roughness: Option<&Roughness>) -> Around<'_> {
        Around {
            resolution: 0.1,
            radius: 0.3,
            limit: 0.2,
            roughness,
        }
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
        let chance = |sigma| patch.row(4, &around(Some(&rough(sigma))))[7].hidden_step;
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
